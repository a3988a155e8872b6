"""Test plans: programmes of positions, rates and chamber temperatures, drawn at random."""

import numpy as np
from table import attitude, directions, Plan, scattered, Table


def _constant(temperature):
    return lambda t: np.full_like(t, temperature)


def _tumble(table, dirs, headings, seconds, rng, order=None):
    for p in rng.permutation(len(dirs)) if order is None else order:
        target, table.angles = attitude(dirs[p], headings[p])
        table.move(target)
        table.rest(seconds, int(p))


def tumble(rng, *, count=None, sessions=None, model=None, turns_logged=False) -> Plan:
    """Positions at rest at one temperature, in several sessions with power off between them.

    With `turns_logged` the table's rates are in the log, which tell how each position was turned about the vertical.
    """
    count = count or int(rng.choice([12, 18, 24, 36]))
    sessions = sessions or int(rng.choice([1, 2, 3, 4]))
    free = count >= 18 and rng.random() < 0.25
    dirs = scattered(count, rng) if free else directions(count)
    headings = rng.choice(4, count) * np.pi / 2
    model = model or rng.choice(["invariant", "reference", "both", "static gyro"])
    table = Table(4.0)
    seconds = float(rng.choice([12.0, 16.0, 20.0]))
    passes = 2 if count * seconds < 500 else 1
    for s in range(sessions):
        table.experiment = s + 1
        for _ in range(passes):
            _tumble(table, dirs, headings, seconds, rng)
        if s + 1 < sessions:
            table.pause(float(rng.uniform(1200, 5000)))
    choice: dict[str, int | str] = {"temperature_degree": 0}
    refs = []
    if model in ("invariant", "both"):
        choice["accel_estimator"] = "invariant"
    if model == "reference":
        choice["accel_estimator"] = "reference"
        refs.append("accel")
    if model in ("both", "static gyro"):
        choice["gyro_estimator"] = "static"
        refs += ["gyro"] if model == "both" else ["gyro", "accel"]
    if turns_logged and "gyro" not in refs:
        refs.append("gyro")
    return table.plan(
        "tumble", _constant(float(rng.choice([0.0, 20.0, 25.0, 40.0]))), model=choice,
        block_seconds=seconds / 4, references=tuple(refs),
        options=dict(count=count, sessions=sessions, passes=passes, scattered=bool(free)),
    )  # fmt: skip


def chamber_profile(rng, *, shape="cycle", span=None):
    """Soaks and ramps: **returns** (times, temperatures, change times), the corners of the air's path."""
    low = float(rng.choice([-40.0, -20.0, -10.0, 0.0]))
    high = low + (span or float(rng.choice([50.0, 60.0, 70.0])))
    levels = {
        "cycle": [low, high, low, high] if rng.random() < 0.4 else [low, high, low],
        "steps": [low, (low + high) / 2, high, (low + high) / 2, low],
        "up": [low, high],
    }[shape]
    if rng.random() < 0.5 and shape != "up":
        levels = [low + high - x for x in levels]
    times, temps, changes = [0.0], [levels[0]], []
    for here, there in zip(levels, levels[1:], strict=False):
        soak = float(rng.uniform(450, 900))
        times.append(times[-1] + soak)
        temps.append(here)
        changes.append(times[-1])
        ramp = abs(there - here) / float(rng.uniform(1.0, 2.4)) * 60
        times.append(times[-1] + ramp)
        temps.append(there)
    times.append(times[-1] + float(rng.uniform(600, 900)))
    temps.append(levels[-1])
    return np.array(times), np.array(temps), np.array(changes)


def _follow(times, temps):
    return lambda t: np.interp(t, times, temps)


def sweep(rng, *, shape=None, model=None, degree=3) -> Plan:
    """A tumble that never stops while the chamber goes up and down."""
    shape = shape or str(rng.choice(["cycle", "steps"]))
    times, temps, changes = chamber_profile(rng, shape=shape)
    model = model or str(rng.choice(["invariant", "invariant", "reference"]))
    count = int(rng.choice([12, 18, 24]))
    dirs, headings = directions(count), np.zeros(count)
    table = Table(2.0)
    while table.clock < times[-1]:
        for p in rng.permutation(count):
            table.experiment = 1 + int(np.searchsorted(changes, table.clock, side="right"))
            _tumble(table, dirs, headings, 18.0, rng, order=[p])
            if table.clock >= times[-1]:
                break
    return table.plan(
        "sweep", _follow(times, temps), block_seconds=6.0,
        model={"accel_estimator": model, "temperature_degree": degree},
        references=("accel",) if model == "reference" else (),
        options=dict(shape=shape, count=count),
    )  # fmt: skip


def pose(rng, *, shape=None, triad=None, degree=3) -> Plan:
    """One pose for hours while the chamber goes up and down; biases only."""
    shape = shape or str(rng.choice(["cycle", "steps"]))
    times, temps, changes = chamber_profile(rng, shape=shape)
    triad = triad or str(rng.choice(["accel", "gyro", "both"]))
    table = Table(2.0)
    up = directions(18)[rng.integers(18)]
    target, table.angles = attitude(up, 0.0)
    table.move(target)
    table.experiment = 1
    for start, end in zip([table.clock, *changes], [*changes, times[-1]], strict=True):
        table.rest(end - start, 0)
        table.experiment += 1
    plan = table.plan(
        "pose", _follow(times, temps), block_seconds=12.0 if triad != "both" else 15.0,
        model={"temperature_degree": degree}, options=dict(shape=shape, triad=triad),
    )  # fmt: skip
    for name in ("accel", "gyro"):
        if triad in (name, "both"):
            plan.model[f"{name}_estimator"] = "static"
    plan.dwell = np.where(plan.position >= 0, 0, -1)  # one rest, whatever the chamber does
    return plan


def _spins(table, rng, axis_dirs, rates, seconds):
    for p, axis in enumerate(axis_dirs):
        target, table.angles = attitude(axis, 0.0)
        table.move(target)
        table.rest(12.0, p)
        signed = [s * r for r in rates for s in (1, -1)]
        for w in rng.permutation(signed):
            table.spin(axis, np.deg2rad(w), seconds)
        table.rest(12.0, p)


RATES = ([10, 30, 60, 100], [5, 20, 50, 100, 200], [2, 10, 40, 90, 150], [1, 5, 20, 60, 120])


def rate(rng, *, slow=False, oblique=None) -> Plan:
    """A rate table: several rates, both directions, three axes and sometimes oblique ones."""
    rates = list(RATES[rng.integers(len(RATES))])
    if slow:
        rates = [0.05, 0.1, 0.3, 1, 3, 10, 60]
    oblique = rng.random() < 0.4 if oblique is None else oblique
    axes = list(np.eye(3)) + ([-x for x in np.eye(3)] if rng.random() < 0.3 else [])
    if oblique:
        axes += [np.array(a, float) for a in ((1, 1, 0), (0, 1, 1), (1, 0, 1))]
    sessions = int(rng.choice([1, 2]))
    table = Table(4.0)
    for s in range(sessions):
        table.experiment = s + 1
        _spins(table, rng, axes, rates, 14.0 if len(axes) < 6 else 10.0)
        if s + 1 < sessions:
            table.pause(float(rng.uniform(600, 2000)))
    return table.plan(
        "rate", _constant(float(rng.choice([20.0, 25.0, 35.0]))), block_seconds=3.5, references=("gyro",),
        model={"gyro_estimator": "reference", "temperature_degree": 0},
        options=dict(rates=rates, sessions=sessions, oblique=bool(oblique), slow=bool(slow)),
    )  # fmt: skip


def mixed(rng, *, accel=None) -> Plan:
    """Positions at rest and rate plateaus in each session, both triads."""
    count = int(rng.choice([12, 18, 24]))
    sessions = int(rng.choice([2, 3]))
    dirs = directions(count)
    headings = rng.choice(4, count) * np.pi / 2
    accel = accel or str(rng.choice(["invariant", "reference"]))
    rates = list(RATES[rng.integers(len(RATES))])[1:4]
    table = Table(4.0)
    for s in range(sessions):
        table.experiment = s + 1
        _tumble(table, dirs, headings, 12.0, rng)
        for axis in np.eye(3):
            target, table.angles = attitude(axis, 0.0)
            table.move(target)
            for w in rng.permutation([sg * r for r in rates for sg in (1, -1)]):
                table.spin(axis, np.deg2rad(w), 10.0)
        if s + 1 < sessions:
            table.pause(float(rng.uniform(600, 2000)))
    model = {"accel_estimator": accel, "gyro_estimator": "reference", "temperature_degree": 0}
    if rng.random() < 0.3:
        model["g_sensitivity"] = True
    return table.plan(
        "mixed", _constant(25.0), model=model, block_seconds=3.0,
        references=("gyro", "accel") if accel == "reference" else ("gyro",),
        options=dict(count=count, sessions=sessions, rates=rates),
    )  # fmt: skip


def thermal_mixed(rng) -> Plan:
    """Rests and rate plateaus, both triads, while the chamber goes up and down."""
    times, temps, changes = chamber_profile(rng, shape="cycle", span=50.0)
    count = 18
    dirs = directions(count)
    headings = rng.choice(4, count) * np.pi / 2
    table = Table(2.0)
    while table.clock < times[-1]:
        table.experiment = 1 + int(np.searchsorted(changes, table.clock, side="right"))
        _tumble(table, dirs, headings, 16.0, rng, order=rng.permutation(count)[:6])
        axis = np.eye(3)[rng.integers(3)]
        target, table.angles = attitude(axis, 0.0)
        table.move(target)
        for w in rng.permutation([60.0, -60.0, 20.0, -20.0]):
            table.spin(axis, np.deg2rad(w), 14.0)
    degree = int(rng.choice([2, 3]))
    return table.plan(
        "thermal_mixed", _follow(times, temps), block_seconds=8.0, references=("gyro",),
        model={"accel_estimator": "invariant", "gyro_estimator": "reference", "temperature_degree": degree},
        options=dict(count=count),
    )  # fmt: skip


def thermal_rate(rng) -> Plan:
    """Rates about three axes at each of several soaks, up and down, and on the ramps between."""
    shape = str(rng.choice(["cycle", "steps"]))
    times, temps, changes = chamber_profile(rng, shape=shape, span=50.0)
    rates = [20, 80]
    table = Table(2.0)
    while table.clock < times[-1]:
        table.experiment = 1 + int(np.searchsorted(changes, table.clock, side="right"))
        for k, axis in enumerate(np.eye(3)):
            target, table.angles = attitude(axis, 0.0)
            table.move(target)
            table.rest(16.0, k)
            for w in rng.permutation([s * r for r in rates for s in (1, -1)]):
                table.spin(axis, np.deg2rad(w), 16.0)
    return table.plan(
        "thermal_rate", _follow(times, temps), block_seconds=8.0, references=("gyro",),
        model={"gyro_estimator": "reference", "temperature_degree": int(rng.choice([2, 3]))},
        options=dict(shape=shape, rates=rates),
    )  # fmt: skip
