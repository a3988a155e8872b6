"""Test plans: what the table and the chamber do, and how the device is therefore turned.

Nothing here knows of sensors. A plan is sampled at the rate of the log; `up` and `north` are unit
vectors of the room seen from the case, `rate` is the table's angular rate in case axes (rad/s).
"""

from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation


@dataclass
class Plan:
    """A sampled test plan; every array has one row a sample."""

    name: str
    time: np.ndarray  # s
    up: np.ndarray  # (n, 3)
    north: np.ndarray  # (n, 3)
    rate: np.ndarray  # (n, 3) rad/s, table only
    chamber: np.ndarray  # °C, air
    experiment: np.ndarray
    position: np.ndarray  # -1 while the table turns
    session: np.ndarray  # one power cycle, one recording file
    dwell: np.ndarray  # number of the rest or plateau, -1 in between
    resting: np.ndarray  # bool: the dwell is a rest
    move_size: np.ndarray  # (n, 3) change of `up` at the move that came before this dwell
    angles: np.ndarray  # (n, 2) outer and inner table angle at rests, rad
    model: dict  # the [model] section
    block_seconds: float
    references: tuple = ()  # "accel", "gyro": which reference columns are logged
    options: dict = field(default_factory=dict)

    @property
    def triads(self) -> list[str]:
        return [k for k in ("accel", "gyro") if f"{k}_estimator" in self.model]


class Table:
    """Builds a plan move by move, as an operator writes a programme."""

    def __init__(self, fs: float):
        self.fs = fs
        self.rows: list[dict] = []
        self.clock = 0.0
        self.room_to_case = Rotation.identity()
        self.session = self.experiment = 1
        self.dwells = 0
        self.last_up = np.array([0.0, 0.0, 1.0])
        self.angles = np.zeros(2)

    def _emit(self, rotations, rates, position, dwell, resting, change):
        n = len(rates)
        case = rotations.as_matrix()
        self.rows.append(
            dict(
                time=self.clock + (np.arange(n) + 0.5) / self.fs,
                up=case[:, :, 2],
                north=case[:, :, 1],
                rate=rates,
                position=np.full(n, position),
                dwell=np.full(n, dwell),
                resting=np.full(n, resting),
                session=np.full(n, self.session),
                experiment=np.full(n, self.experiment),
                move_size=np.broadcast_to(change, (n, 3)),
                angles=np.broadcast_to(self.angles, (n, 2)),
            )
        )
        self.clock += n / self.fs

    def _samples(self, seconds: float) -> int:
        return max(int(round(seconds * self.fs)), 1)

    def move(self, target: Rotation, seconds: float | None = None, top_rate: float = 0.6):
        """Turn to an attitude about one axis, smoothly (sin² rate), at most `top_rate` rad/s."""
        turn = (target * self.room_to_case.inv()).as_rotvec()
        angle = float(np.linalg.norm(turn))
        seconds = seconds or max(1.5, 2 * angle / top_rate)
        n = self._samples(seconds)
        s = (np.arange(n) + 0.5) / n
        gone = s - np.sin(2 * np.pi * s) / (2 * np.pi)
        speed = (1 - np.cos(2 * np.pi * s)) * self.fs / n
        path = Rotation.from_rotvec(gone[:, None] * turn) * self.room_to_case
        # The case turns by +φ when room vectors, seen from it, turn by -φ.
        self._emit(path, -speed[:, None] * turn, -1, -1, False, np.zeros(3))
        self.room_to_case = target

    def rest(self, seconds: float, position: int):
        n = self._samples(seconds)
        up = self.room_to_case.as_matrix()[:, 2]
        path = Rotation.concatenate([self.room_to_case] * n)
        self._emit(path, np.zeros((n, 3)), position, self.dwells, True, up - self.last_up)
        self.last_up = up
        self.dwells += 1

    def spin(self, axis: np.ndarray, rate: float, seconds: float, ramp: float = 3.0):
        """A plateau at `rate` (rad/s) about a case axis, with a linear run-up and run-down."""
        axis = np.asarray(axis, float) / np.linalg.norm(axis)
        for kind, t in (("up", ramp), ("flat", seconds), ("down", ramp)):
            n = self._samples(t)
            s = (np.arange(n) + 0.5) / self.fs
            end = n / self.fs
            if kind == "up":
                w, th, total = rate * s / end, rate * s**2 / (2 * end), rate * end / 2
            elif kind == "flat":
                w, th, total = np.full(n, rate), rate * s, rate * end
            else:
                w, th, total = rate * (1 - s / end), rate * (s - s**2 / (2 * end)), rate * end / 2
            path = Rotation.from_rotvec(-th[:, None] * axis) * self.room_to_case
            dwell = self.dwells if kind == "flat" else -1
            self._emit(path, w[:, None] * axis, -1, dwell, False, np.zeros(3))
            self.dwells += kind == "flat"
            self.room_to_case = Rotation.from_rotvec(-total * axis) * self.room_to_case

    def pause(self, seconds: float):
        """Power off: the log stops and a new session begins."""
        self.clock += seconds
        self.session += 1

    def plan(self, name, chamber_at, **rest) -> Plan:
        columns = {k: np.concatenate([r[k] for r in self.rows]) for k in self.rows[0]}
        return Plan(name=name, chamber=chamber_at(columns["time"]), **columns, **rest)


def attitude(up: np.ndarray, heading: float) -> tuple[Rotation, np.ndarray]:
    """Room-to-case rotation that puts `up` (case axes) upward, the table base turned by `heading`.

    Outer angle a about room x, inner angle b about case z: case to room is Rz(h) Rx(a) Rz(b), so
    up = (sin a sin b, sin a cos b, cos a). **Returns** the rotation and (a, b).
    """
    up = np.asarray(up, float) / np.linalg.norm(up)
    a = np.arccos(np.clip(up[2], -1, 1))
    b = np.arctan2(up[0], up[1]) if abs(up[2]) < 1 - 1e-12 else 0.0
    case_to_room = (
        Rotation.from_euler("z", heading)
        * Rotation.from_euler("x", a)
        * Rotation.from_euler("z", b)
    )
    return case_to_room.inv(), np.array([a, b])


def directions(count: int) -> np.ndarray:
    """Where `up` points in the case, for the usual tumbles of 6, 12, 18, 24 or 36 positions."""
    eye = np.eye(3)
    if count in (6, 18):
        faces = np.concatenate([eye, -eye])
        if count == 6:
            return faces
        edges = [
            s * eye[i] + t * eye[j]
            for i in range(3)
            for j in range(i)
            for s in (1, -1)
            for t in (1, -1)
        ]
        return np.concatenate([faces, np.array(edges) / np.sqrt(2)])
    per_plane = count // 3
    out = []
    for i, j in ((0, 1), (1, 2), (2, 0)):
        for k in range(per_plane):
            angle = 2 * np.pi * k / per_plane
            out.append(np.cos(angle) * eye[i] + np.sin(angle) * eye[j])
    return np.array(out)


def scattered(count: int, rng) -> np.ndarray:
    """Random but even directions: spread out a random start by a golden spiral, turned at random."""
    k = np.arange(count) + 0.5
    z, phi = 1 - 2 * k / count, np.pi * (1 + np.sqrt(5)) * k
    ring = np.sqrt(1 - z**2)
    points = np.stack([ring * np.cos(phi), ring * np.sin(phi), z], 1)
    return Rotation.random(rng=rng).apply(points)


def _constant(temperature):
    return lambda t: np.full_like(t, temperature)


def _tumble(table, dirs, headings, seconds, rng, order=None):
    for p in rng.permutation(len(dirs)) if order is None else order:
        target, table.angles = attitude(dirs[p], headings[p])
        table.move(target)
        table.rest(seconds, int(p))


def tumble(rng, *, count=None, sessions=None, model=None) -> Plan:
    """Positions at rest at one temperature, in several sessions with power off between them."""
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
