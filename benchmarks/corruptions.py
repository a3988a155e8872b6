"""Plausible corruptions of good logs: is each refused, warned of, harmless, or silent and wrong?

Good logs with known truth come from a generator of this file (NumPy alone; it shares no code with the package): a
device turned by hand between rests, a table that states its positions and rates, and for false alarms also thermal
sweeps, phones, one pose and six faces. Each corruption is run through `calibrate` and scored:

* refused: no result, for a finding of a right kind (or, marked *, for another reason);
* warned: a result with a warning of a right kind;
* misfit: no such warning, but the quality is not "good";
* harmless: every parameter within 3 stated standard deviations of the truth;
* SILENT: none of these.

    python benchmarks/corruptions.py                       # all corruptions, some minutes
    python benchmarks/corruptions.py --only temperature    # those with the word in their name
    python benchmarks/corruptions.py --part 2/4 --seconds 400
    python benchmarks/corruptions.py --good 40             # false alarms on 40 good campaigns of each of six kinds
"""

import argparse
import collections
import dataclasses
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np


G = 9.81
RATE = 100.0  # Hz
LSB_ACCEL, LSB_GYRO = 9.80665 / 16384, np.pi / 180 / 131
Z_LIMIT = 3.0


# --- good logs -----------------------------------------------------------------------------------


@dataclasses.dataclass
class Logs:
    """Columns of one or more recordings of a device, and the truth behind them."""

    tables: list[dict[str, np.ndarray]]
    truth: dict[str, float]
    gravity: float = G
    latitude: float | None = None
    names: list[str] = dataclasses.field(default_factory=list)
    at: float = 25.0  # °C at which parameters are compared


def draw(rng: np.random.Generator) -> tuple[dict[str, np.ndarray], dict[str, float]]:
    """Errors of a consumer device: a' = M f + b, ω' = W ω + c."""
    accel = np.tril(0.01 * rng.standard_normal((3, 3)))
    gyro = 0.01 * rng.standard_normal((3, 3))
    device = {
        "M": np.eye(3) + accel,
        "W": np.eye(3) + gyro,
        "b": 0.15 * rng.standard_normal(3),
        "c": 0.01 * rng.standard_normal(3),
    }
    truth = {f"accel.bias[{i}]": device["b"][i] for i in range(3)}
    truth |= {f"gyro.bias[{i}]": device["c"][i] for i in range(3)}
    truth |= {f"accel.matrix[{i},{j}]": accel[i, j] for i in range(3) for j in range(i + 1)}
    truth |= {f"gyro.matrix[{i},{j}]": gyro[i, j] for i in range(3) for j in range(3)}
    return device, {k: float(v) for k, v in truth.items()}


def rotation(vector: np.ndarray) -> np.ndarray:
    """Rodrigues' formula, written out here so that nothing is shared."""
    angle = float(np.linalg.norm(vector))
    if angle < 1e-12:
        return np.eye(3)
    x, y, z = vector / angle
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * k @ k


def ride(
    turns: list[np.ndarray], rest: float, move: float, rate: float, start: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Force direction and rate in the case, and the number of the rest (−1 in motion), sample by sample."""
    attitude, up, omega, label = start, [], [], []
    num_rest, num_move = int(rest * rate), int(move * rate)
    s = np.arange(1, num_move + 1) / num_move
    done, speed = s - np.sin(2 * np.pi * s) / (2 * np.pi), (1 - np.cos(2 * np.pi * s)) / move
    for number in range(len(turns) + 1):
        up.append(np.tile(attitude.T @ [0, 0, 1.0], (num_rest, 1)))
        omega.append(np.zeros((num_rest, 3)))
        label.append(np.full(num_rest, number))
        if number == len(turns):
            break
        vector = turns[number]
        up.append(np.array([(attitude @ rotation(d * vector)).T @ [0, 0, 1.0] for d in done]))
        omega.append(speed[:, None] * vector)
        label.append(np.full(num_move, -1))
        attitude = attitude @ rotation(vector)
    return np.concatenate(up), np.concatenate(omega), np.concatenate(label)


def read(
    rng: np.random.Generator,
    device: dict[str, np.ndarray],
    force: np.ndarray,
    omega: np.ndarray,
    *,
    rate: float = RATE,
    noise: tuple[float, float] = (0.03, 0.0025),
    lsb: tuple[float, float] = (LSB_ACCEL, LSB_GYRO),
    temperature: np.ndarray | None = None,
) -> dict[str, np.ndarray]:
    """Outputs with white noise, rounded to the converter's steps."""
    n = len(force)
    accel = force @ device["M"].T + device["b"] + noise[0] * rng.standard_normal((n, 3))
    gyro = omega @ device["W"].T + device["c"] + noise[1] * rng.standard_normal((n, 3))
    if lsb[0]:
        accel, gyro = np.round(accel / lsb[0]) * lsb[0], np.round(gyro / lsb[1]) * lsb[1]
    if temperature is None:
        temperature = 26 + 1.5 * (1 - np.exp(-np.arange(n) / rate / 60))
    probe = np.round((temperature + 0.02 * rng.standard_normal(n)) * 340) / 340
    return {"time": np.arange(n) / rate, "accel": accel, "gyro": gyro, "temperature": probe}


def hand(seed: int, rests: int = 24, **changes: object) -> Logs:
    """Rests of 4 s with turns by hand between them; nothing is labelled."""
    rng = np.random.default_rng([seed, 1])
    device, truth = draw(rng)
    turns = []
    for _ in range(rests - 1):
        axis = rng.standard_normal(3)
        turns.append(rng.uniform(0.8, 2.2) * axis / np.linalg.norm(axis))
    up, omega, label = ride(turns, 4.0, 1.5, RATE, rotation(rng.standard_normal(3)))
    moving = label < 0
    shake = np.where(moving[:, None], 0.6 * rng.standard_normal(up.shape), 0.0)
    table = read(rng, device, G * up + shake, omega, **changes)  # pyright: ignore[reportArgumentType]
    return Logs([table], truth, names=["hand.csv"])


FACES = np.concatenate([np.eye(3), -np.eye(3)])


def upright(direction: np.ndarray) -> np.ndarray:
    """An attitude in which `direction` of the case points up."""
    cross = np.cross(direction, [0, 0, 1.0])
    sine, cosine = np.linalg.norm(cross), direction[2]
    if sine < 1e-9:
        return np.eye(3) if cosine > 0 else rotation(np.array([np.pi, 0, 0]))
    return rotation(cross / sine * np.arctan2(sine, cosine))


def table(seed: int, runs: tuple[float, ...] = (20.0, 30.0)) -> Logs:
    """A table: 20 labelled positions and turns both ways about three axes at each of two temperatures."""
    rng = np.random.default_rng([seed, 2])
    device, truth = draw(rng)
    corners = np.array([[a, b, c] for a in (1, -1) for b in (1, -1) for c in (1, -1)]) / 3**0.5
    edges = np.array([[1, 1, 0], [1, -1, 0], [0, 1, 1], [0, 1, -1], [1, 0, 1], [1, 0, -1]]) / 2**0.5
    directions = np.concatenate([FACES, corners, edges])
    parts = []
    for run, degrees in enumerate(runs):
        up, omega, label = [], [], []
        for number, direction in enumerate(directions):
            up.append(np.tile(direction, (300, 1)))
            omega.append(np.zeros((300, 3)))
            label.append(np.full(300, number))
            nearer = directions[(number + 1) % len(directions)]
            blend = np.linspace(0, 1, 100)[:, None]
            path = (1 - blend) * direction + blend * nearer + 0.02
            path = path / np.linalg.norm(path, axis=1, keepdims=True)
            up.append(path)
            turning = np.cross(path[1:], path[:-1]) * RATE
            omega.append(np.concatenate([turning, turning[-1:]]))
            label.append(np.full(100, -1))
        for axis in np.eye(3):
            for sign in (1.0, -1.0):
                angle = sign * np.linspace(0, 2 * np.pi, 400, endpoint=False)
                side = np.roll(axis, 1)
                up.append(
                    np.cos(angle)[:, None] * side - np.sin(angle)[:, None] * np.cross(axis, side)
                )
                omega.append(np.tile(sign * 2 * np.pi / 4.0 * axis, (400, 1)))
                label.append(np.full(400, -1))
        up, omega, label = map(np.concatenate, (up, omega, label))
        n = len(up)
        made = read(rng, device, G * up, omega, temperature=degrees + 0.3 * np.arange(n) / n)
        made["time"] = made["time"] + run * 3000.0
        made |= {
            "position": label,
            "experiment": np.full(n, run),
            "reference_accel": G * up,
            "reference_gyro": omega,
        }
        parts.append(made)
    joined = {k: np.concatenate([p[k] for p in parts]) for k in parts[0]}
    return Logs([joined], truth, names=["table.csv"])


def thermal(seed: int) -> Logs:
    """One labelled pose in a chamber from −20 to 70 °C and back, at 10 Hz."""
    rng = np.random.default_rng([seed, 3])
    device, truth = draw(rng)
    n = 20_000
    degrees = 25 - 45 * np.cos(2 * np.pi * np.arange(n) / n)
    force = np.tile(G * np.array([0.1, -0.2, 0.9747]), (n, 1)) + 0.002 * (degrees - 25)[:, None]
    made = read(rng, device, force, np.zeros((n, 3)), rate=10.0, temperature=degrees)
    made["position"] = np.zeros(n, int)
    return Logs([made], truth, names=["thermal.csv"])


def phone(seed: int) -> Logs:
    """A phone: both triads smoothed, slow noise of the zeros, tremor in the hand, jittering stamps, floats."""
    logs = hand(seed + 5000, rests=18, lsb=(0.0, 0.0))
    made, rng = logs.tables[0], np.random.default_rng([seed, 4])
    for name, wander in (("accel", 1e-4), ("gyro", 1e-5)):
        x = made[name] + np.cumsum(wander * rng.standard_normal(made[name].shape), axis=0)
        kernel = np.array([0.25, 0.5, 0.25])
        made[name] = np.stack([np.convolve(np.pad(c, 1, "edge"), kernel, "valid") for c in x.T], 1)
    made["time"] = made["time"] + 0.002 * rng.random(len(made["time"]))
    made.pop("temperature")
    return logs


def one_pose(seed: int) -> Logs:
    """Ten minutes on a desk."""
    rng = np.random.default_rng([seed, 5])
    device, truth = draw(rng)
    n = 30_000
    force = np.tile(G * np.array([0.03, 0.02, 0.999]), (n, 1))
    return Logs([read(rng, device, force, np.zeros((n, 3)))], truth, names=["still.csv"])


def faces(seed: int) -> Logs:
    """Six files, one a face."""
    rng = np.random.default_rng([seed, 6])
    device, truth = draw(rng)
    tables = []
    for face in FACES:
        tilt = face + 0.03 * rng.standard_normal(3)
        force = np.tile(G * tilt / np.linalg.norm(tilt), (800, 1))
        tables.append(read(rng, device, force, np.zeros((800, 3))))
    names = [f"{s}{a}.csv" for s in ("pos", "neg") for a in "XYZ"]
    return Logs(tables, truth, names=names)


GOOD: dict[str, Callable[[int], Logs]] = {
    "hand": hand,
    "table": table,
    "thermal": thermal,
    "phone": phone,
    "one pose": one_pose,
    "faces": faces,
}


# --- corruptions ---------------------------------------------------------------------------------

Corruption = Callable[[Logs, np.random.Generator], None]


@dataclasses.dataclass(frozen=True)
class Case:
    """A corruption of one kind of log, and the kinds of finding that tell of it."""

    name: str
    base: str
    kinds: tuple[str, ...]
    corrupt: Corruption
    hidden: bool = False  # physics hides it: nothing in the log differs from another device's


CASES: list[Case] = []


def case(base: str, *kinds: str, hidden: bool = False) -> Callable[[Corruption], Corruption]:
    """Enter a function among the corruptions, under its name."""

    def enter(function: Corruption) -> Corruption:
        name = f"{base}: {function.__name__.strip('_').replace('_', ' ')}"
        CASES.append(Case(name, base, kinds, function, hidden))
        return function

    return enter


def on(base: str, name: str, corrupt: Corruption, *kinds: str, hidden: bool = False) -> None:
    """Enter a short one."""
    CASES.append(Case(f"{base}: {name}", base, kinds, corrupt, hidden))


def scaled(column: str, factor: float, offset: float = 0.0) -> Corruption:
    """Another unit."""

    def corrupt(logs: Logs, rng: np.random.Generator) -> None:
        del rng
        for t in logs.tables:
            t[column] = t[column] * factor + offset

    return corrupt


def axes(column: str, matrix: list[list[int]]) -> Corruption:
    """Exchanged or mirrored axes."""

    def corrupt(logs: Logs, rng: np.random.Generator) -> None:
        del rng
        for t in logs.tables:
            t[column] = t[column] @ np.array(matrix, float).T

    return corrupt


SWAP_XY = [[0, 1, 0], [1, 0, 0], [0, 0, 1]]
CYCLE = [[0, 1, 0], [0, 0, 1], [1, 0, 0]]
FLIP_X = [[-1, 0, 0], [0, 1, 0], [0, 0, 1]]
FLIP_Z = [[1, 0, 0], [0, 1, 0], [0, 0, -1]]
TURN_Z = [[-1, 0, 0], [0, -1, 0], [0, 0, 1]]
FLIP_ALL = [[-1, 0, 0], [0, -1, 0], [0, 0, -1]]

for base in ("hand", "table"):
    on(base, "gyro in deg/s", scaled("gyro", 180 / np.pi), "gyro_unit")
    on(base, "gyro of another range (half)", scaled("gyro", 0.5), "gyro_unit")
    on(base, "accel in g", scaled("accel", 1 / 9.80665), "accel_unit")
    on(base, "accel in mg", scaled("accel", 1e3 / 9.80665), "accel_unit")
    on(base, "accel of another range (twice)", scaled("accel", 2.0), "accel_unit")
    on(base, "gyro x and y exchanged", axes("gyro", SWAP_XY), "axes")
    on(base, "gyro axes cycled", axes("gyro", CYCLE), "axes")
    on(base, "gyro x mirrored", axes("gyro", FLIP_X), "axes")
    on(base, "gyro x and y mirrored", axes("gyro", TURN_Z), "axes")
    on(base, "accel z mirrored", axes("accel", FLIP_Z), "axes")
    on(base, "accel x and y exchanged", axes("accel", SWAP_XY), "axes")
    on(base, "temperature in K", scaled("temperature", 1.0, 273.15), "temperature")
    on(base, "temperature as counts", scaled("temperature", 340.0, -36.53 * 340), "temperature")
on("hand", "temperature in °F", scaled("temperature", 1.8, 32.0), "temperature")
on("table", "temperature in °F", scaled("temperature", 1.8, 32.0), "temperature", hidden=True)
on("hand", "gyro as counts", scaled("gyro", 180 / np.pi * 131), "gyro_unit")
on("hand", "all accelerometers mirrored", axes("accel", FLIP_ALL), "axes", hidden=True)
on("hand", "clock in ms", scaled("time", 1e3), "time_unit")
on("hand", "clock in us", scaled("time", 1e6), "time_unit")
on("hand", "clock in ks", scaled("time", 1e-3), "time_unit")
on("hand", "clock 1 % fast", scaled("time", 1.01), "clock", "gyro_unit", hidden=True)
on("table", "turn rate 1 % off", scaled("reference_gyro", 1.01), "reference", hidden=True)
on("table", "reference gravity 0.3 % off", scaled("reference_accel", 1.003), "gravity")


@case("table", "axes", "reference")
def _reference_axes_exchanged(logs: Logs, rng: np.random.Generator) -> None:
    axes("reference_accel", SWAP_XY)(logs, rng)


@case("table", "reference", "positions")
def _one_reference_of_the_wrong_sign(logs: Logs, rng: np.random.Generator) -> None:
    t = logs.tables[0]
    t["reference_accel"][(t["position"] == 2) & (t["experiment"] == 0)] *= -1.0


@case("table", "positions", "reference")
def _two_positions_exchanged(logs: Logs, rng: np.random.Generator) -> None:
    t = logs.tables[0]
    a, b = (np.flatnonzero((t["position"] == k) & (t["experiment"] == 1)) for k in (3, 8))
    for column in ("reference_accel", "position"):
        kept = t[column][a].copy()
        t[column][a] = t[column][b]
        t[column][b] = kept


@case("hand", "gravity", hidden=True)
def _gravity_too_small(logs: Logs, rng: np.random.Generator) -> None:
    logs.gravity = G * 0.997


@case("hand", "gravity")
def _gravity_of_another_latitude(logs: Logs, rng: np.random.Generator) -> None:
    logs.gravity, logs.latitude = 9.78, 52.0


@case("hand", "temperature")
def _temperature_hangs(logs: Logs, rng: np.random.Generator) -> None:
    t = logs.tables[0]["temperature"]
    t[len(t) // 3 :] = t[len(t) // 3]


@case("hand", "temperature")
def _temperature_glitches(logs: Logs, rng: np.random.Generator) -> None:
    t = logs.tables[0]["temperature"]
    for k in rng.integers(0, len(t) - 150, 3):
        t[k : k + 150] = -46.0


@case("table", "temperature", hidden=True)
def _temperature_30_s_late(logs: Logs, rng: np.random.Generator) -> None:
    t = logs.tables[0]["temperature"]
    t[3000:] = t[:-3000].copy()


def bit(axis: int, place: int) -> Corruption:
    """A stuck bit of the accelerometers' converter."""

    def corrupt(logs: Logs, rng: np.random.Generator) -> None:
        for t in logs.tables:
            codes = np.round(t["accel"][:, axis] / LSB_ACCEL).astype(int) + 40000
            t["accel"][:, axis] = ((codes | (1 << place)) - 40000) * LSB_ACCEL

    return corrupt


for base in ("hand", "table"):
    on(base, "stuck bit of 9.6 mm/s²", bit(1, 4), "stuck_bit")
    on(base, "stuck bit of 77 mm/s²", bit(0, 7), "stuck_bit")


@case("hand", "saturation")
def _accel_clipped_at_9_m_s2(logs: Logs, rng: np.random.Generator) -> None:
    t = logs.tables[0]
    t["accel"] = np.clip(t["accel"], -9.0, 9.0)


@case("hand", "saturation", "axes")
def _gyro_clipped_in_motions(logs: Logs, rng: np.random.Generator) -> None:
    t = logs.tables[0]
    t["gyro"] = np.clip(t["gyro"], -0.6, 0.6)


@case("hand", "saturation")
def _accel_wraps_round(logs: Logs, rng: np.random.Generator) -> None:
    t = logs.tables[0]
    t["accel"] = (t["accel"] + 9.0) % 18.0 - 9.0


def zeros(share: float, column: str) -> Corruption:
    """Dropped samples read as zero."""

    def corrupt(logs: Logs, rng: np.random.Generator) -> None:
        for t in logs.tables:
            t[column][rng.random(len(t["time"])) < share] = 0.0

    return corrupt


on("hand", "accel drops to zero, 0.2 %", zeros(0.002, "accel"), "dropout")
on("hand", "accel drops to zero, 10 %", zeros(0.1, "accel"), "dropout")
on("table", "gyro drops to zero, 1 %", zeros(0.01, "gyro"), "dropout")


@case("hand", "repeated_samples")
def _every_sample_twice(logs: Logs, rng: np.random.Generator) -> None:
    t = logs.tables[0]
    for column in ("accel", "gyro"):
        t[column] = t[column][np.arange(len(t["time"])) // 2 * 2]


@case("hand", "repeated_samples", "axes")
def _sensor_freezes_for_a_rest(logs: Logs, rng: np.random.Generator) -> None:
    t = logs.tables[0]
    for column in ("accel", "gyro"):
        t[column][5500:6600] = t[column][5500]


def copied(a: int, b: int, n: int) -> Corruption:
    """A block written twice."""

    def corrupt(logs: Logs, rng: np.random.Generator) -> None:
        t = logs.tables[0]
        for column in ("accel", "gyro"):
            t[column][b : b + n] = t[column][a : a + n]

    return corrupt


on("hand", "a rest copied over another", copied(1150, 2800, 300), "repeated_samples", "axes")
on(
    "table",
    "a position copied over another",
    copied(0, 1200, 300),
    "repeated_samples",
    "reference",
    "positions",
)
on("table", "a block of ten positions copied", copied(0, 10_400, 4000), "repeated_samples")


def labels_early(seconds: float) -> Corruption:
    """Labels of rests that begin while the table still turns."""

    def corrupt(logs: Logs, rng: np.random.Generator) -> None:
        t, n = logs.tables[0], int(seconds * RATE)
        for column in ("position", "reference_accel"):
            t[column][:-n] = t[column][n:].copy()

    return corrupt


for seconds in (0.1, 0.4, 1.0):
    on("table", f"labels {seconds} s early", labels_early(seconds), "positions")


@case("table", "positions")
def _labels_0_4_s_late(logs: Logs, rng: np.random.Generator) -> None:
    t = logs.tables[0]
    for column in ("position", "reference_accel"):
        t[column][40:] = t[column][:-40].copy()


@case("hand", "motions", "axes", "gap", "clock")
def _a_tenth_of_the_rows_lost_and_counted(logs: Logs, rng: np.random.Generator) -> None:
    t = logs.tables[0]
    kept = np.ones(len(t["time"]), bool)
    for k in rng.integers(0, len(kept) - 50, len(kept) // 500):
        kept[k : k + 50] = False
    for column in t:
        t[column] = t[column][kept]
    t["time"] = np.arange(kept.sum()) / RATE


@case("hand", "gap")
def _a_tenth_of_the_rows_lost(logs: Logs, rng: np.random.Generator) -> None:
    t = logs.tables[0]
    kept = rng.random(len(t["time"])) > 0.1
    for column in t:
        t[column] = t[column][kept]


@case("hand", "clock")
def _stamps_in_bursts(logs: Logs, rng: np.random.Generator) -> None:
    t = logs.tables[0]
    n = np.arange(len(t["time"]))
    t["time"] = (n // 10 * 10 + 9) / RATE + 0.0015 * (n % 10)


def spiked(count: int, size: float) -> Corruption:
    """Single samples far off, all one way."""

    def corrupt(logs: Logs, rng: np.random.Generator) -> None:
        for t in logs.tables:
            t["accel"][rng.integers(0, len(t["time"]), count), rng.integers(0, 3, count)] += size

    return corrupt


on("hand", "60 one-sided spikes", spiked(60, 20.0), "disturbed_rest", "spikes")
on("table", "60 one-sided spikes", spiked(60, 20.0), "disturbed_rest", "spikes")


@case("hand", "disturbed_rest")
def _knocks_in_rests(logs: Logs, rng: np.random.Generator) -> None:
    t = logs.tables[0]
    for k in range(24):
        a = 550 * k + 150
        ring = np.exp(-np.arange(20) / 6) * np.sign(np.sin(np.arange(20) * 1.3) + 0.4)
        t["accel"][a : a + 20, k % 3] += 3.0 * ring
        t["gyro"][a : a + 20, (k + 1) % 3] += 0.3 * ring


@case("hand", "disturbed_rest")
def _all_rests_tilt_half_a_degree(logs: Logs, rng: np.random.Generator) -> None:
    t = logs.tables[0]
    for k in range(24):
        rows = slice(550 * k, 550 * k + 400)
        drift = np.linspace(0, np.radians(0.5), 400)[:, None]
        axis = rng.standard_normal(3)
        t["accel"][rows] += drift * np.cross(t["accel"][rows], axis / np.linalg.norm(axis))


@case("hand", "disturbed_rest")
def _slips_in_six_rests(logs: Logs, rng: np.random.Generator) -> None:
    t = logs.tables[0]
    for k in range(0, 24, 4):
        rows = slice(550 * k + 200, 550 * k + 400)
        axis = rng.standard_normal(3)
        t["accel"][rows] += 0.01 * np.cross(t["accel"][rows], axis / np.linalg.norm(axis))


@case("hand", "constant_channel")
def _gyros_constant_at_zero(logs: Logs, rng: np.random.Generator) -> None:
    logs.tables[0]["gyro"] = np.zeros_like(logs.tables[0]["gyro"])


@case("table", "constant_channel")
def _gyro_y_dead(logs: Logs, rng: np.random.Generator) -> None:
    logs.tables[0]["gyro"][:, 1] = 0.0


@case("hand", "constant_channel", "accel_unit", "axes")
def _accel_x_dead(logs: Logs, rng: np.random.Generator) -> None:
    logs.tables[0]["accel"][:, 0] = 0.0


@case("table", "remounted", "axes")
def _remounted_by_2_degrees_between_runs(logs: Logs, rng: np.random.Generator) -> None:
    t = logs.tables[0]
    later = t["experiment"] == 1
    turn = rotation(np.radians([1.2, -1.2, 1.0]))
    for column in ("accel", "gyro"):
        t[column][later] = t[column][later] @ turn.T


@case("table", "axes", "remounted", "reference")
def _the_second_run_has_other_axes(logs: Logs, rng: np.random.Generator) -> None:
    t = logs.tables[0]
    later = t["experiment"] == 1
    for column in ("accel", "gyro"):
        t[column][later] = t[column][later] @ np.array(CYCLE, float).T


def stepped(column: str, size: float) -> Corruption:
    """A jump of a zero in the middle."""

    def corrupt(logs: Logs, rng: np.random.Generator) -> None:
        t = logs.tables[0]
        t[column][len(t["time"]) // 2 :] += size * np.array([1.0, -0.5, 0.7])

    return corrupt


on("hand", "gyro zero jumps by 10 mrad/s", stepped("gyro", 0.01), "restart")
on("hand", "accel zero jumps by 0.1 m/s²", stepped("accel", 0.1), "restart")


@case("hand", "restart")
def _half_of_the_log_of_another_device(logs: Logs, rng: np.random.Generator) -> None:
    other = hand(777).tables[0]
    mine = logs.tables[0]
    half = len(mine["time"]) // 2
    first, second = (hand_like(logs, other, column, half) for column in ("accel", "gyro"))
    mine["accel"], mine["gyro"] = first, second


def hand_like(logs: Logs, other: dict[str, np.ndarray], column: str, half: int) -> np.ndarray:
    """The first half of one log, the second of another."""
    return np.concatenate([logs.tables[0][column][:half], other[column][half:]])


@case("faces", "positions")
def _one_face_twice(logs: Logs, rng: np.random.Generator) -> None:
    logs.tables[5]["accel"] = logs.tables[2]["accel"][::-1].copy()


# --- runs ----------------------------------------------------------------------------------------


def campaign(logs: Logs):
    """The package's campaign of these columns."""
    from inertiax.data.recording import Campaign, Recording, Site

    recordings = []
    for number, t in enumerate(logs.tables):
        columns = dict(t)
        if "temperature" in columns:
            columns["temperature"] = columns["temperature"][:, None]
        name = logs.names[number] if number < len(logs.names) else f"log{number}.csv"
        recordings.append(Recording(**columns, name=name))
    latitude = None if logs.latitude is None else float(np.radians(logs.latitude))
    return Campaign(tuple(recordings), Site(gravity=logs.gravity, latitude=latitude))


def largest_z(result, logs: Logs) -> tuple[float, str]:
    """The worst parameter's distance from the truth, in stated standard deviations."""
    worst = (0.0, "")
    for triad in (result.calibration.accel, result.calibration.gyro):
        if triad is None:
            continue
        (values,), (sigmas,) = triad.over(np.array([logs.at]))
        for name, value, sigma in zip(triad.names, values, sigmas, strict=True):
            if name in logs.truth:
                worst = max(worst, (abs(float(value) - logs.truth[name]) / float(sigma), name))
    return worst


def score(which: Case, seed: int = 11) -> tuple[str, str]:
    """Outcome and a remark."""
    from inertiax.calibrate.fit_quality import judge
    from inertiax.calibrate.pipeline import calibrate, DeviceFailure
    from inertiax.plausibility import check_campaign

    logs = GOOD[which.base](seed)
    which.corrupt(logs, np.random.default_rng(seed))
    made = campaign(logs)
    seen = check_campaign(made)
    kinds = {f.kind for f in seen.findings if f.severity != "note"}
    right = bool(kinds & set(which.kinds))
    (result,) = calibrate(made)
    if isinstance(result, DeviceFailure):
        return ("refused" if right else "refused*"), result.reason
    z, name = largest_z(result, logs)
    said = f"{name} {z:.1f} sigma off; {', '.join(sorted(kinds)) or 'no finding'}"
    if right:
        return "warned", said
    if z <= Z_LIMIT:
        return "harmless", said
    quality = judge(result)
    if quality.verdict != "good":
        return "misfit", f"{said}; {quality.answer}"
    return ("hidden" if which.hidden else "SILENT"), said


def run(cases: list[Case], seconds: float) -> None:
    """The table, a line as soon as it is known, and the sums."""
    import jax

    jax.config.update("jax_enable_x64", True)
    begin, sums = time.monotonic(), collections.Counter()
    for number, which in enumerate(cases):
        if time.monotonic() - begin > seconds:
            print(f"stopped after {number} of {len(cases)}")
            break
        outcome, said = score(which)
        sums[outcome] += 1
        print(f"{outcome:9s} {which.name:50s} {said[:150]}", flush=True)
    print(", ".join(f"{k} {n}" for k, n in sums.items()))


def false_alarms(count: int) -> None:
    """Errors and warnings of `check` on good campaigns."""
    from inertiax.plausibility import check_campaign

    errors = warnings = total = 0
    for kind, make in GOOD.items():
        told = collections.Counter()
        begin = time.perf_counter()
        for seed in range(count):
            found = check_campaign(campaign(make(seed))).findings
            bad = {f.severity for f in found}
            errors += "error" in bad
            warnings += "warning" in bad
            total += 1
            told.update(f"{f.severity} {f.kind} {f.what}" for f in found if f.severity != "note")
        print(
            f"{kind:9s} {count} campaigns, {time.perf_counter() - begin:.1f} s: {dict(told)}",
            flush=True,
        )
    print(f"{total} good campaigns: {errors} with an error, {warnings} with a warning")


def main() -> None:
    """Parse and run."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--only", default="", help="corruptions with this in their name")
    parser.add_argument("--part", default="1/1", help="k/n: every n-th case, from the k-th")
    parser.add_argument("--seconds", type=float, default=1e9, help="stop after so long")
    parser.add_argument("--good", type=int, default=0, help="false alarms on so many of each kind")
    parser.add_argument("--list", action="store_true")
    said = parser.parse_args()
    part, parts = map(int, said.part.split("/"))
    cases = [c for c in CASES if said.only in c.name][part - 1 :: parts]
    if said.list:
        print("\n".join(c.name for c in cases), f"\n{len(cases)} cases")
    elif said.good:
        false_alarms(said.good)
    else:
        run(cases, said.seconds)


if __name__ == "__main__":
    assert Path(__file__).name == "corruptions.py"
    main()
