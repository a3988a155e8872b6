"""How often a rest is called disturbed that is not, and how often a disturbance is found.

Rests are made by NumPy alone: a random pose, white noise or the noise of a MEMS part (white, flicker, random walk, a
low-pass filter, a converter), at 100 Hz. Into every other rest a disturbance is put: a tap (a ringing of 15 Hz that
dies out in 40 ms, of the rate and of the force), a slip (a smooth turn within 0.2 s about a random axis across
gravity) or a slow tilt through the whole rest. It counts as found where no row from its beginning to its end has a
part in a mean.

With INERTIAX_RECORDINGS set, the disturbances of other people's recordings follow. Three MPU-9150s on one board
(mikoff/imu-calib) were logged at once, by one clock: a tap that one of them shows the others should show, too.

`python benchmarks/handling.py [--rests 400]`
"""

import argparse
import os
from collections import Counter
from pathlib import Path

import numpy as np

from inertiax.data.recording import Recording
from inertiax.reduction.handling import left_out_sentence
from inertiax.reduction.segments import segment


RATE = 100.0  # Hz
GRAVITY = 9.81
REST, MOVE = 8.0, 2.0  # s
PER_LOG = 20  # rests
# 1 sigma of one sample at 100 Hz: m/s² and rad/s; flicker and walk of a consumer part.
WHITE = {"accel": 0.02, "gyro": 1e-3}
FLICKER = {"accel": 3e-4, "gyro": 2e-5}
WALK = {"accel": 1e-5, "gyro": 5e-7}  # a sample
STEP = {"accel": 9.81 / 16384, "gyro": np.deg2rad(1 / 131)}
SIZES = {"tap": (5.0, 8.0, 15.0), "slip": (0.2, 0.5, 1.0), "slow tilt": (0.2, 0.5, 1.0)}
UNITS = {"tap": "sigma of one sample, of both triads", "slip": "deg", "slow tilt": "deg"}


def noise(rng: np.random.Generator, rows: int, triad: str, kind: str) -> np.ndarray:
    """White noise, or that of a MEMS part."""
    made = WHITE[triad] * rng.standard_normal((rows, 3))
    if kind == "white":
        return made
    smooth = np.array([0.6, 0.3, 0.1])
    made = np.stack([np.convolve(x, smooth, "same") for x in made.T], axis=1) / np.linalg.norm(
        smooth
    )
    spectrum = np.fft.rfft(rng.standard_normal((rows, 3)), axis=0)
    pink = np.fft.irfft(
        spectrum / np.sqrt(np.maximum(np.arange(len(spectrum)), 1))[:, None], rows, axis=0
    )
    made += FLICKER[triad] * pink / pink.std() * 3.0
    return made + WALK[triad] * np.cumsum(rng.standard_normal((rows, 3)), axis=0)


def rotated(vector: np.ndarray, turn: np.ndarray) -> np.ndarray:
    """A direction of the room in the case after turns by small angles, row by row (to second order)."""
    once = np.cross(vector, turn)
    return vector + once + 0.5 * np.cross(once, turn)


def log(rng: np.random.Generator, kind: str, labelled: bool, disturb: str | None, size: float):
    """A log of rests and moves, and the disturbed stretch of each rest (s) where there is one."""
    rest, move = int(REST * RATE), int(MOVE * RATE)
    rows = PER_LOG * (rest + move)
    force, rate = np.zeros((rows, 3)), np.zeros((rows, 3))
    position, stretch = np.full(rows, -1), {}
    up = GRAVITY * unit(rng)
    for k in range(PER_LOG):
        a = k * (rest + move)
        turn, spin = np.zeros((rest, 3)), np.zeros((rest, 3))
        position[a : a + rest] = k
        if disturb is not None and k % 2:
            across = np.cross(up, unit(rng))
            across /= np.linalg.norm(across)
            begin = int(rng.uniform(0.3, 0.7) * rest)
            if disturb == "slow tilt":
                begin, length = 0, rest
                course = np.linspace(0.0, 1.0, rest)
            else:
                length = int(0.2 * RATE)
                u = np.clip((np.arange(rest) - begin) / length, 0.0, 1.0)
                course = 3 * u**2 - 2 * u**3
            if disturb != "tap":
                turn = np.deg2rad(size) * course[:, None] * across
                spin = np.gradient(turn, 1.0 / RATE, axis=0)
            stretch[k] = (a + begin) / RATE, (a + begin + length) / RATE
        force[a : a + rest] = rotated(up, turn)
        if disturb == "tap" and k in stretch:
            t = np.maximum(np.arange(rest) - begin, 0) / RATE
            ring = np.where(
                np.arange(rest) >= begin, np.exp(-t / 0.04) * np.cos(2 * np.pi * 15 * t), 0.0
            )
            force[a : a + rest] += size * WHITE["accel"] * ring[:, None] * unit(rng)
            spin = size * WHITE["gyro"] * ring[:, None] * unit(rng)
        rate[a : a + rest] = spin
        end, up = force[a + rest - 1], GRAVITY * unit(rng)
        share = 0.5 - 0.5 * np.cos(np.pi * (np.arange(move) + 1) / move)
        between = end + share[:, None] * (up - end)
        force[a + rest : a + rest + move] = (
            GRAVITY * between / np.linalg.norm(between, axis=1, keepdims=True)
        )
        rate[a + rest : a + rest + move] = (
            np.sin(np.pi * (np.arange(move) + 1) / move)[:, None]
            * rng.uniform(0.5, 2.0)
            * unit(rng)
        )
    accel = force + noise(rng, rows, "accel", kind) + [0.1, -0.2, 0.15]
    gyro = rate + noise(rng, rows, "gyro", kind) + [0.01, -0.02, 0.005]
    if kind == "mems":
        accel, gyro = (
            STEP[t] * np.round(x / STEP[t]) for t, x in (("accel", accel), ("gyro", gyro))
        )
    time = np.arange(rows) / RATE
    return Recording(time, accel=accel, gyro=gyro, position=position if labelled else None), stretch


def unit(rng: np.random.Generator) -> np.ndarray:
    """A random direction."""
    x = rng.standard_normal(3)
    return x / np.linalg.norm(x)


def count(seed: int, rests: int, kind: str, labelled: bool, disturb: str | None, size: float):
    """Rests with a disturbance that was found, rests with one, quiet rests called disturbed, quiet rests."""
    rng = np.random.default_rng(seed)
    hits = asked = false = quiet = 0
    for _ in range(max(rests // PER_LOG, 1)):
        recording, stretch = log(rng, kind, labelled, disturb, size)
        segments = segment(recording)
        found = segments.disturbances
        for k in range(PER_LOG):
            begin, end = k * (REST + MOVE), k * (REST + MOVE) + REST
            mine = [d for d in found if d.end > begin and d.start < end]
            if k in stretch:
                asked += 1
                a, b = stretch[k]
                hits += not segments.used[round(a * RATE) : round(b * RATE)].any()
            else:
                quiet += 1
                false += bool(mine)
    return hits, asked, false, quiet


def simulated(rests: int) -> None:
    """The table of made-up rests."""
    print(
        f"{'noise':6s} {'rests':9s} {'disturbance':12s} {'size':>6s} {'found':>12s} {'false':>12s}"
    )
    for kind in ("white", "mems"):
        for labelled in (True, False):
            for disturb, size in [(None, 0.0), *((d, s) for d, ss in SIZES.items() for s in ss)]:
                hits, asked, false, quiet = count(1, rests, kind, labelled, disturb, size)
                found = f"{hits}/{asked}" if asked else ""
                name = "labelled" if labelled else "searched"
                print(
                    f"{kind:6s} {name:9s} {disturb or 'none':12s} {size:6.3g} {found:>12s} {f'{false}/{quiet}':>12s}",
                    flush=True,
                )
    print("size: " + "; ".join(f"{k}: {v}" for k, v in UNITS.items()))


def boards(folder: Path) -> None:
    """The three sensors of one board: stretches in common."""
    logs = []
    for number in range(3):
        rows = np.loadtxt(folder / "mikoff-mpu9150" / f"imu{number}.log")
        recording = Recording(np.arange(len(rows)) / 100.0, accel=rows[:, :3], gyro=rows[:, 3:])
        found = segment(recording)
        logs.append(found)
        print(
            f"MPU-9150 {number}: {found.num_segments} rests left. {left_out_sentence(found.disturbances)}"
        )
    for number, mine in enumerate(logs):
        others = [d for k, s in enumerate(logs) if k != number for d in s.disturbances]
        shared = [
            any(d.start < o.end + 0.5 and d.end > o.start - 0.5 for o in others)
            for d in mine.disturbances
        ]
        print(
            f"MPU-9150 {number}: {sum(shared)} of {len(shared)} stretches are seen by another one, too"
        )


def others(folder: Path) -> None:
    """The Xsens of imu_tk, and four phones."""
    accel, gyro = (np.loadtxt(folder / "imu_tk-xsens" / f"xsens_{k}.mat") for k in ("acc", "gyro"))
    num = min(len(accel), len(gyro))
    force = (accel[:num, 1:] - 32768.0) / [415.0, 413.0, 415.0]
    rate = (gyro[:num, 1:] - 32768.0) / [4778.0, 4758.0, 4766.0]
    logs = {"Xsens": (accel[:num, 0], force, rate)}
    for name in ("Nexus5_d1", "Nexus5_d2", "iPhone4S_d2", "iPhone4S_d3"):
        a, g = (
            np.loadtxt(folder / "tyrex-phones" / name / f"{k}.txt")
            for k in ("accelerometer", "gyroscope")
        )
        time = np.arange(
            max(a[0, 0], g[0, 0]), min(a[-1, 0], g[-1, 0]), np.median(np.diff(g[:, 0]))
        )
        there = lambda x, t=time: np.stack(
            [np.interp(t, x[:, 0], x[:, c]) for c in (1, 2, 3)], axis=1
        )
        logs[name] = (
            time - time[0],
            there(a) * (-GRAVITY if name.startswith("iPhone") else 1.0),
            there(g),
        )
    for name, (time, force, rate) in logs.items():
        found = segment(Recording(time, accel=force, gyro=rate))
        kinds = dict(Counter(d.kind for d in found.disturbances))
        print(f"{name}: {found.num_segments} rests left; {kinds}")


def main() -> None:
    """Print all tables."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--rests", type=int, default=400, help="rests of each line")
    simulated(parser.parse_args().rests)
    named = os.environ.get("INERTIAX_RECORDINGS")
    if named:
        boards(Path(named))
        others(Path(named))


if __name__ == "__main__":
    main()
