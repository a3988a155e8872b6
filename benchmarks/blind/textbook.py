"""Textbook forms of the catalogued effects, used only to say which names a plan cannot tell apart.

`forms(scene, triad)` gives, by name, a list of candidates (one per value of the nuisance grid); a
candidate maps channels to an (n, 3, q) array of output changes. They see what an analyst sees: the
logged probe temperature, time, positions and reference inputs, never the hidden states of `truth.py`.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import chebyshev
from table import Plan
from world import relax, steps_of


@dataclass
class View:
    """What the log shows."""

    plan: Plan
    triad: str
    probe: np.ndarray
    ideal: np.ndarray  # (n, 3) reference input
    force: np.ndarray  # g
    earth: np.ndarray
    gravity: float
    slope: np.ndarray  # (n, 3) output per °C from the calibration
    curve: Callable[[np.ndarray], np.ndarray]  # output at another temperature

    @property
    def scaled(self):
        low, high = self.probe.min(), self.probe.max()
        return (2 * self.probe - low - high) / max(high - low, 1e-9)


Candidate = Callable[[list[int]], np.ndarray]


def _each(columns: Callable[[int], list[np.ndarray]]) -> Candidate:
    """A sensor effect: own coefficients on every channel asked for."""

    def make(channels):
        out = []
        for c in channels:
            for column in columns(c):
                one = np.zeros((len(column), 3))
                one[:, c] = column
                out.append(one)
        return np.stack(out, -1)

    return make


def _joint(*signals: np.ndarray) -> Candidate:
    """A rig effect: the same few coefficients for all three channels."""
    return lambda channels: np.stack(signals, -1)


def _smooth(v: View) -> np.ndarray:
    """Probe temperature without its converter's steps."""
    dt = steps_of(v.plan)
    forward = relax(v.probe, dt, 8.0)
    backward = relax(v.probe[::-1], dt[::-1], 8.0)[::-1]
    return 0.5 * (forward + backward)


def _rate(v: View) -> np.ndarray:
    out = np.empty_like(v.probe)
    smooth = _smooth(v)
    for s in np.unique(v.plan.session):
        rows = v.plan.session == s
        out[rows] = np.gradient(smooth[rows], v.plan.time[rows])
    return out


def _since_power(v: View) -> np.ndarray:
    out = np.empty_like(v.plan.time)
    for s in np.unique(v.plan.session):
        rows = v.plan.session == s
        out[rows] = v.plan.time[rows] - v.plan.time[rows][0]
    return out


def _log_grid(low, high, count):
    return np.geomspace(low, high, count)


def thermal(v: View) -> Iterator[tuple[str, Candidate]]:
    """Names that need the temperature to change."""
    degree = int(v.plan.model.get("temperature_degree", 0))
    x = v.scaled
    basis = chebyshev.chebvander(x, degree + 2)
    if degree == 0:
        for q in (1, 2, 3):
            cols = [basis[:, k] for k in range(1, min(q, 2) + 1)]
            scale = [] if q < 3 else [x]
            yield (
                "temperature_dependence",
                _each(lambda c, cols=cols, scale=scale: cols + [z * v.ideal[:, c] for z in scale]),
            )
            yield (
                "temperature_order",
                _each(lambda c, cols=cols, scale=scale: cols + [z * v.ideal[:, c] for z in scale]),
            )
        return
    for q in (1, 2):
        cols = [basis[:, degree + k] for k in range(1, q + 1)]
        yield "temperature_order", _each(lambda c, cols=cols: cols)
    last = basis[:, degree + 1]
    yield "temperature_order", _each(lambda c: [last, last * v.ideal[:, c]])
    rate = _rate(v)
    yield "temperature_rate", _each(lambda c: [rate])
    yield "temperature_rate", _each(lambda c: [rate, rate * v.ideal[:, c]])
    dt = steps_of(v.plan)
    smooth = _smooth(v)
    for tau in _log_grid(3, 1200, 14):
        inner = relax(smooth, dt, tau)
        change = v.curve(inner) - v.curve(smooth)
        yield "thermal_lag", _each(lambda c, change=change: [change[:, c]])
    for loop in _loops(v):
        yield "thermal_hysteresis", _each(lambda c, loop=loop: [loop])


def _loops(v: View) -> Iterator[np.ndarray]:
    """Branch sign (held in soaks), Rayleigh loop, and single and double plays."""
    smooth = _smooth(v)
    half = np.ptp(smooth) / 2
    branch = np.zeros_like(smooth)
    state, last = 0.0, smooth[0]
    for i, t in enumerate(smooth):
        if abs(t - last) > 0.05 * half:
            state, last = np.sign(t - last), t
        branch[i] = state
    x = v.scaled
    yield branch
    yield branch * (1 - x**2)
    backlash = []
    for part in (0.08, 0.15, 0.25, 0.4, 0.6):
        inside, out = smooth[0], np.empty_like(smooth)
        for i, t in enumerate(smooth):
            inside = min(max(inside, t - part * half), t + part * half)
            out[i] = inside
        backlash.append(out - smooth)
        yield out - smooth
    yield backlash[1] + backlash[3]
    yield backlash[0] + backlash[2] + backlash[3]


def temporal(v: View) -> Iterator[tuple[str, Candidate]]:
    """Names that need only time."""
    t, plan = v.plan.time, v.plan
    yield "drift", _each(lambda c: [t / t[-1]])
    since = _since_power(v)
    for tau in _log_grid(30, 1800, 10):
        yield "warm_up", _each(lambda c, tau=tau: [np.exp(-since / tau)])
    for when in np.quantile(t, np.linspace(0.04, 0.96, 70)):
        yield "bias_step", _each(lambda c, when=when: [(t >= when) * 1.0])
    move = np.concatenate([[True], (np.diff(plan.dwell) != 0) | (np.diff(plan.session) != 0)])
    start = np.flatnonzero(move)
    in_dwell = t - t[start[np.cumsum(move) - 1]]
    rest = plan.resting & (plan.dwell >= 0)
    for tau in (2.0, 3.5, 5.0, 7.0, 10.0, 30.0):
        form = np.exp(-in_dwell / tau) * rest
        yield "settling", _each(lambda c, form=form: [form])
        yield "settling", _each(lambda c, form=form: [form * plan.move_size[:, c]])
    yield from _periodic(v)


def _periodic(v: View) -> Iterator[tuple[str, Candidate]]:
    t = v.plan.time
    awake = float(np.sum(steps_of(v.plan)[np.diff(v.plan.session, prepend=1) == 0]))
    low, high = 2.5 * v.plan.block_seconds, min(awake / 6, 40 * v.plan.block_seconds)
    if high <= low:
        return
    count = int(min(800, 8 * awake * (1 / low - 1 / high)))
    for f in np.linspace(1 / high, 1 / low, count):
        w = 2 * np.pi * f * t
        yield "interference", _each(lambda c, w=w: [np.sin(w), np.cos(w)])


def forces(v: View) -> Iterator[tuple[str, Candidate]]:
    """Names that need positions, accelerometers."""
    f = v.force
    yield "second_order", _each(lambda c: [f[:, c] ** 2])
    yield "third_order", _each(lambda c: [f[:, c] ** 3])
    yield "odd_quadratic", _each(lambda c: [f[:, c] * np.abs(f[:, c])])
    yield "scale_asymmetry", _each(lambda c: [np.abs(f[:, c])])
    for j, k in ((0, 1), (1, 2), (0, 2)):
        own = lambda c, j=j, k=k: [f[:, j] * f[:, k]]
        yield "cross_coupling", _each(own)
    yield (
        "cross_coupling",
        _each(lambda c: [f[:, 0] * f[:, 1], f[:, 1] * f[:, 2], f[:, 0] * f[:, 2]]),
    )
    w = v.plan.rate
    if np.abs(w).max() > 0:
        arms = [np.cross(w, np.cross(w, e)) for e in np.eye(3)]
        yield "size_effect", _each(lambda c: [a[:, c] for a in arms])
    for level in (0.6, 0.75, 0.9, 0.97):
        over = lambda c, level=level: [np.sign(f[:, c]) * np.maximum(np.abs(f[:, c]) - level, 0)]
        yield "saturation", _each(over)
    for width in (0.02, 0.1, 0.3):
        x = np.sign(f) * np.sqrt(np.maximum(f**2 - width**2, 0)) - f
        yield "dead_band", _each(lambda c, x=x: [x[:, c]])


def rates(v: View) -> Iterator[tuple[str, Candidate]]:
    """Names that need the table to turn, gyros; and what gravity does to them."""
    w, f = v.ideal, v.force
    yield "g_sensitivity", _each(lambda c: [f[:, j] for j in range(3)])
    pairs = [(i, j) for i in range(3) for j in range(i + 1)]
    yield "g2_sensitivity", _each(lambda c: [f[:, i] * f[:, j] for i, j in pairs])
    top = np.abs(w).max()
    if top < 1e-3:
        return  # Earth rate alone: a scale factor wrong by 100 % is nobody's answer
    cubic = lambda c: w[:, c] ** 3 / top**3
    squared = lambda c: w[:, c] * np.abs(w[:, c]) / top**2
    yield "rate_nonlinearity", _each(lambda c: [cubic(c)])
    yield "rate_nonlinearity", _each(lambda c: [squared(c)])
    yield "rate_nonlinearity", _each(lambda c: [cubic(c), squared(c)])
    yield "scale_asymmetry", _each(lambda c: [np.abs(w[:, c])])
    for j, k in ((0, 1), (1, 2), (0, 2)):
        yield "cross_axis_rate", _each(lambda c, j=j, k=k: [w[:, j] * w[:, k]])
    yield (
        "cross_axis_rate",
        _each(lambda c: [w[:, 0] * w[:, 1], w[:, 1] * w[:, 2], w[:, 0] * w[:, 2]]),
    )
    for width in _log_grid(1e-5, np.deg2rad(5), 24):
        x = np.sign(w) * np.sqrt(np.maximum(w**2 - width**2, 0)) - w
        yield "dead_band", _each(lambda c, x=x: [x[:, c]])
    for level in (0.5, 0.6, 0.7, 0.8, 0.9, 0.97):
        tops = np.abs(w).max(axis=0) * level
        x = np.clip(w, -tops, tops) - w
        yield "saturation", _each(lambda c, x=x: [x[:, c]])


def rig(v: View) -> Iterator[tuple[str, Candidate]]:
    """Names of the table, the pier, the place and the reference."""
    day = 2 * np.pi * v.plan.time / 86400.0
    north, up = v.plan.north, v.plan.up
    east = np.cross(north, up)
    for dip in np.deg2rad([55.0, 62.0, 70.0]):
        field = np.cos(dip) * north - np.sin(dip) * up
        yield "magnetic", _each(lambda c, field=field: [field[:, j] for j in range(3)])
    if v.triad == "accel":
        slow = (np.sin(day), np.cos(day))
        yield (
            "pier_tilt",
            _joint(*[h * s[:, None] * v.gravity for h in (east, north) for s in slow]),
        )
        b = v.plan.angles[:, 1]
        about = np.stack([np.sin(b), np.cos(b), 0 * b], 1)
        yield "table_axis_error", _joint(np.cross(about, up) * v.gravity)
        yield "gravity_error", _joint(v.force * v.gravity)
    else:
        yield "earth_rate", _joint(v.earth)
        yield "rate_scale_error", _joint(v.plan.rate)
    turning = v.ideal if v.triad == "accel" else v.plan.rate
    yield "table_misalignment", _joint(*[np.cross(e, turning) for e in np.eye(3)])


def forms(v: View) -> Iterator[tuple[str, Candidate]]:
    """Every catalogued name with its candidates, for one triad of one plan."""
    if np.ptp(v.probe) > 5:
        yield from thermal(v)
    yield from temporal(v)
    yield from forces(v) if v.triad == "accel" else rates(v)
    yield from rig(v)
