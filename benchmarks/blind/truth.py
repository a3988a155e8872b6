"""What really happens in the device or on the rig when an effect is present.

Each function returns an (n, 3) change of the triad's output for unit size, or a function of the
size where the effect is not proportional to it. Effects that begin with `x_` are in no catalogue.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from table import Plan
from world import Heat, plays, relax, Sensor, steps_of


@dataclass
class Scene:
    """All that an effect may depend on."""

    plan: Plan
    triad: str
    grade: str
    heat: Heat
    sensor: Sensor
    ideal: np.ndarray  # (n, 3) true input of the triad, SI
    force: np.ndarray  # (n, 3) specific force, g
    gravity: float
    earth: np.ndarray  # (n, 3) rad/s


@dataclass
class Effect:
    """A drawn effect: `signal(size)` is its output change (n, 3)."""

    name: str
    triad: str
    channels: list[int]
    signal: Callable[[float], np.ndarray]
    unit: str
    limit: float  # largest size that this grade may show
    linear: bool = True
    fixed: float | None = None  # the size, where nature sets it
    parameters: dict = field(default_factory=dict)  # nuisance truths for the answers
    coefficient: str | None = None  # unit of the size as a catalogue coefficient
    vector: list = field(default_factory=list)  # (share of the size, unit) of each coefficient
    span: list | None = None
    span_otherwise: list | None = None  # an equally good account of where
    detail: dict = field(default_factory=dict)


# Upper ends of realistic sizes, (navigation, tactical, consumer), in micro-g (per g², per g³) or
# degrees per hour (per g) or ppm. From field knowledge, not checked. A draw may be three times that.
MICRO_G = 9.81e-6
DEG_H = np.pi / 180 / 3600
LIMITS = {
    "accel": dict(
        bias=(80, 600, 5000),
        second=(40, 150, 1000),
        third=(5, 25, 100),
        odd=(20, 80, 300),
        ppm=(100, 400, 3000),
    ),
    "gyro": dict(bias=(0.5, 20, 200), g=(1.0, 20, 360), rate=(50, 300, 3000), ppm=(50, 300, 3000)),
}


def limit(s: Scene, kind: str) -> float:
    value = LIMITS[s.triad][kind][("navigation", "tactical", "consumer").index(s.grade)]
    if kind in ("ppm", "rate"):
        return value * 1e-6
    return value * (MICRO_G if s.triad == "accel" else DEG_H)


def on(channels, column) -> np.ndarray:
    out = np.zeros((len(column), 3))
    for c in channels:
        out[:, c] = column
    return out


def one(s: Scene, rng, name, column_of, kind, unit, **more) -> Effect:
    """An effect on one channel, proportional to its size."""
    c = int(rng.integers(3))
    column = column_of(c)
    return Effect(name, s.triad, [c], lambda a: a * on([c], column), unit, limit(s, kind), **more)


def _intervals(plan: Plan, wanted: np.ndarray) -> list:
    """[start, end] of the stretches where `wanted`; gaps below 30 s are bridged."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], wanted.astype(int), [0]])))
    pairs = [[float(plan.time[a]), float(plan.time[b - 1])] for a, b in edges.reshape(-1, 2)]
    merged = []
    for pair in pairs:
        if merged and pair[0] - merged[-1][1] < 30:
            merged[-1][1] = pair[1]
        else:
            merged.append(pair)
    return [p for p in merged if p[1] - p[0] > 30]


def gradient(s: Scene) -> np.ndarray:
    """Case temperature's rate, smoothed over a minute, K/s."""
    dt = steps_of(s.plan)
    return (s.heat.case - relax(s.heat.case, dt, 60.0)) / 60.0


def _poweron(s: Scene, tau: float) -> np.ndarray:
    """Self-heating of the element through its own thermal resistance."""
    out = np.empty_like(s.plan.time)
    for session in np.unique(s.plan.session):
        rows = s.plan.session == session
        out[rows] = relax(np.ones(rows.sum()), steps_of(s.plan)[rows], tau, start=0.0) - 1
    return -out


def thermal_lag(s: Scene, rng) -> Effect:
    low, high = {"navigation": (20, 900), "tactical": (8, 400), "consumer": (3, 160)}[s.grade]
    channels = [0, 1, 2] if rng.random() < 0.25 else [int(rng.integers(3))]
    dt = steps_of(s.plan)

    def signal(tau):
        inner = _inner(s, dt, tau)
        change = s.sensor.output(inner, s.ideal) - s.sensor.output(s.heat.case, s.ideal)
        return change * np.isin(np.arange(3), channels)

    moving = np.abs(gradient(s)) > 0.12 * np.abs(gradient(s)).max()
    return Effect(
        "thermal_lag", s.triad, channels, signal, "s", high, linear=False,
        parameters={"time_constant": "size"}, span=_intervals(s.plan, moving), detail={"low": low},
    )  # fmt: skip


def _inner(s: Scene, dt, tau):
    out = np.empty_like(s.heat.case)
    for session in np.unique(s.plan.session):
        rows = s.plan.session == session
        out[rows] = relax(s.heat.case[rows], dt[rows], tau)
    return out


def temperature_rate(s: Scene, rng) -> Effect:
    tau = float(rng.uniform(15, 40))
    gradient = (s.heat.case - _inner(s, steps_of(s.plan), tau)) / tau
    moving = np.abs(gradient) > 0.12 * np.abs(gradient).max()
    made = one(s, rng, "temperature_rate", lambda c: gradient, "bias", "SI per K/s")
    made.limit *= 60.0
    made.span = _intervals(s.plan, moving)
    return made


def thermal_hysteresis(s: Scene, rng) -> Effect:
    amplitude = np.ptp(s.heat.case) / 2
    widths = amplitude * np.array([0.1, 0.25, 0.5])
    weights = rng.uniform(0.5, 1.5, 3)
    loop = plays(s.heat.case, widths, weights)
    loop /= np.ptp(loop) / 2
    return one(s, rng, "thermal_hysteresis", lambda c: loop, "bias", "SI, half width")


def warm_up(s: Scene, rng) -> Effect:
    low, high = {"navigation": (250, 900), "tactical": (120, 600), "consumer": (60, 300)}[s.grade]
    tau = float(rng.uniform(low, high))
    made = one(s, rng, "warm_up", lambda c: _poweron(s, tau), "bias", "SI")
    made.parameters = {"time_constant": (tau, "s")}
    return made


def temperature_order(s: Scene, rng) -> Effect:
    x = s.sensor.scaled(s.heat.case)
    k = int(s.plan.model["temperature_degree"]) + 1
    wave = np.cos(k * np.arccos(np.clip(x, -1, 1)))
    return one(s, rng, "temperature_order", lambda c: wave, "bias", "SI")


def temperature_dependence(s: Scene, rng) -> Effect:
    x = s.sensor.scaled(s.heat.case)
    curve = x + float(rng.uniform(-0.15, 0.15)) * x**2
    made = one(s, rng, "temperature_dependence", lambda c: curve, "bias", "SI")
    made.limit *= 10
    return made


def drift(s: Scene, rng) -> Effect:
    t = s.plan.time / s.plan.time[-1]
    made = one(s, rng, "drift", lambda c: t, "bias", "SI over the campaign")
    made.limit *= 0.5
    made.detail = {"seconds": float(s.plan.time[-1])}
    return made


def bias_step(s: Scene, rng) -> Effect:
    when = float(s.plan.time[int(len(s.plan.time) * rng.uniform(0.15, 0.85))])
    made = one(s, rng, "bias_step", lambda c: (s.plan.time >= when) * 1.0, "bias", "SI")
    made.parameters = {"change_time": (when, "s"), "time": (when, "s")}
    made.coefficient = "m/s^2" if s.triad == "accel" else "rad/s"
    made.span = [[when, float(s.plan.time[-1])]]
    made.span_otherwise = [[float(s.plan.time[0]), when]]
    return made


def settling(s: Scene, rng) -> Effect:
    tau = float(rng.uniform(3, 9))
    since = _since_move(s.plan)
    form = np.exp(-since / tau) * (s.plan.resting & (s.plan.dwell >= 0))
    sized = rng.random() < 0.5
    made = one(
        s, rng, "settling",
        lambda c: form * (s.plan.move_size[:, c] if sized else 1.0), "bias", "SI",
    )  # fmt: skip
    made.limit *= 4
    made.parameters = {"time_constant": (tau, "s")}
    made.detail = {"proportional_to_move": bool(sized)}
    return made


def _since_move(plan: Plan) -> np.ndarray:
    """Seconds since the dwell began."""
    start = np.concatenate([[True], (np.diff(plan.dwell) != 0) | (np.diff(plan.session) != 0)])
    first = np.flatnonzero(start)
    return plan.time - plan.time[first[np.cumsum(start) - 1]]


def interference(s: Scene, rng) -> Effect:
    period = float(rng.uniform(8, 30)) * s.plan.block_seconds
    phase = float(rng.uniform(0, 2 * np.pi))
    wave = np.sin(2 * np.pi * s.plan.time / period + phase)
    made = one(s, rng, "interference", lambda c: wave, "bias", "SI")
    made.parameters = {"period": (period, "s"), "frequency": (1 / period, "Hz")}
    return made


def _accel_unit(power):
    return f"m/s^2/g^{power}"


def second_order(s, rng):
    return one(
        s, rng, "second_order", lambda c: s.force[:, c] ** 2, "second", "SI", coefficient=_accel_unit(2)
    )  # fmt: skip


def third_order(s, rng):
    return one(
        s, rng, "third_order", lambda c: s.force[:, c] ** 3, "third", "SI", coefficient=_accel_unit(3)
    )  # fmt: skip


def odd_quadratic(s, rng):
    column = lambda c: s.force[:, c] * np.abs(s.force[:, c])
    return one(s, rng, "odd_quadratic", column, "odd", "SI", coefficient=_accel_unit(2))


def scale_asymmetry(s, rng):
    if s.triad == "accel":
        made = one(s, rng, "scale_asymmetry", lambda c: np.abs(s.force[:, c]), "ppm", "SI")
        made.limit *= s.gravity
        made.coefficient = "m/s^2/g"
        return made
    return one(
        s, rng, "scale_asymmetry", lambda c: np.abs(s.ideal[:, c]), "ppm", "SI", coefficient="1"
    )


def cross_coupling(s, rng):
    c = int(rng.integers(3))
    j, k = [(a, b) for a in range(3) for b in range(a) if c in (a, b)][int(rng.integers(2))]
    column = s.force[:, j] * s.force[:, k]
    return Effect(
        "cross_coupling", s.triad, [c], lambda a: a * on([c], column), "m/s^2/g^2", limit(s, "second"),
        detail={"product": [int(j), int(k)]},
    )  # fmt: skip


def size_effect(s, rng):
    """Lever arm r of one accelerometer: ω × (ω × r) + ω̇ × r, its own component."""
    c = int(rng.integers(3))
    arm = rng.standard_normal(3)
    arm /= np.linalg.norm(arm)
    w = s.plan.rate
    faster = np.gradient(w, s.plan.time, axis=0)
    column = (np.cross(w, np.cross(w, arm)) + np.cross(faster, arm))[:, c]
    return Effect(
        "size_effect", s.triad, [c], lambda a: a * on([c], column), "m", 0.01,
        detail={"direction": arm.round(4).tolist()}, vector=[(float(x), "m") for x in arm],
    )  # fmt: skip


def g_sensitivity(s, rng):
    c = int(rng.integers(3))
    row = rng.standard_normal(3)
    row /= np.linalg.norm(row)
    return Effect(
        "g_sensitivity", s.triad, [c], lambda a: a * on([c], s.force @ row), "rad/s/g", limit(s, "g"),
        detail={"row": row.round(4).tolist()}, vector=[(float(x), "rad/s/g") for x in row],
    )  # fmt: skip


def g2_sensitivity(s, rng):
    c = int(rng.integers(3))
    form = rng.standard_normal((3, 3))
    form = (form + form.T) / np.linalg.norm(form + form.T)
    column = np.einsum("ni,ij,nj->n", s.force, form, s.force)
    return Effect(
        "g2_sensitivity", s.triad, [c], lambda a: a * on([c], column), "rad/s/g^2", limit(s, "g")
    )  # fmt: skip


def rate_nonlinearity(s, rng):
    top = np.abs(s.ideal).max()
    odd = rng.random() < 0.5
    column = lambda c: (
        (s.ideal[:, c] ** 3 / top**2) if odd else (s.ideal[:, c] * np.abs(s.ideal[:, c]) / top)
    )
    made = one(s, rng, "rate_nonlinearity", column, "rate", "relative at the highest rate")
    made.detail = {"form": "cubic" if odd else "odd quadratic"}
    return made


def dead_band(s, rng):
    c = int(rng.integers(3))

    def signal(width):
        x = s.ideal[:, c]
        out = np.sign(x) * np.sqrt(np.maximum(x**2 - width**2, 0))
        return on([c], out - x)

    return Effect("dead_band", s.triad, [c], signal, "rad/s", np.deg2rad(2.0), linear=False)


def saturation(s, rng):
    c = int(rng.integers(3))
    top = np.abs(s.ideal[:, c]).max()

    def signal(cut):
        level = top * (1 - cut)
        return on([c], np.clip(s.ideal[:, c], -level, level) - s.ideal[:, c])

    return Effect(
        "saturation", s.triad, [c], signal, "fraction of the highest rate", 0.3, linear=False
    )  # fmt: skip


def cross_axis_rate(s, rng):
    c = int(rng.integers(3))
    j, k = [(0, 1), (1, 2), (0, 2)][int(rng.integers(3))]
    column = s.ideal[:, j] * s.ideal[:, k] / np.abs(s.ideal).max()
    return Effect(
        "cross_axis_rate", s.triad, [c], lambda a: a * on([c], column), "relative", limit(s, "rate"),
        detail={"product": [j, k]},
    )  # fmt: skip


def magnetic(s, rng):
    dip = np.deg2rad(rng.uniform(55, 70))
    field_ = np.cos(dip) * s.plan.north - np.sin(dip) * s.plan.up
    c = int(rng.integers(3))
    row = rng.standard_normal(3)
    row /= np.linalg.norm(row)
    return Effect(
        "magnetic", s.triad, [c], lambda a: a * on([c], field_ @ row), "SI in the room's field",
        limit(s, "bias"),
    )  # fmt: skip
