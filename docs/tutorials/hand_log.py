"""Two logs of a consumer IMU turned by hand: `python hand_log.py FOLDER` writes `calibrate.csv` and `later.csv`.

Plain NumPy, as a logger would write them: raw counts, settings above the header, no word on units.
"""

import sys
from pathlib import Path

import numpy as np


GRAVITY = 9.80856  # m/s², at the place of the log
RATE = 50.0  # Hz
# What the device does to force (m/s²) and rate (rad/s); nobody knows these numbers but this file.
ACCEL = np.eye(3) + [[0.012, 0.0, 0.0], [0.004, -0.008, 0.0], [-0.006, 0.003, 0.015]]
ACCEL_BIAS = np.array([0.35, -0.22, 0.61])  # m/s²
GYRO = np.eye(3) + [[-0.009, 0.005, -0.002], [0.001, 0.011, 0.006], [0.004, -0.003, 0.006]]
GYRO_BIAS = np.array([0.031, -0.018, 0.009])  # rad/s
ACCEL_COUNTS, GYRO_COUNTS = 16384.0 / 9.80665, 131.0 / np.radians(1.0)  # ±2 g, ±250 °/s


def turned(angle: np.ndarray) -> np.ndarray:
    """Rotation matrix of a rotation vector."""
    size = np.linalg.norm(angle)
    if size == 0.0:
        return np.eye(3)
    x, y, z = angle / size
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(size) * cross + (1.0 - np.cos(size)) * cross @ cross


def by_hand(rng: np.random.Generator, poses: int) -> tuple[np.ndarray, np.ndarray]:
    """Force and rate of a device that rests 4 s in each pose and is turned for 1.5 s between two."""
    attitude, force, rate = np.eye(3), [], []
    for _ in range(poses):
        axis = rng.standard_normal(3)
        turn = axis / np.linalg.norm(axis) * rng.uniform(0.9, 1.9)
        steps = int(1.5 * RATE)
        speed = 1.0 - np.cos(2.0 * np.pi * (np.arange(steps) + 0.5) / steps)
        for w in turn * speed[:, None] / steps * RATE:
            half = attitude @ turned(0.5 * w / RATE)
            force.append(half.T @ [0.0, 0.0, GRAVITY])
            rate.append(w)
            attitude = attitude @ turned(w / RATE)
        for _ in range(int(4.0 * RATE)):
            force.append(attitude.T @ [0.0, 0.0, GRAVITY])
            rate.append(np.zeros(3))
    return np.array(force), np.array(rate)


def write(path: Path, seed: int, poses: int) -> None:
    """One log."""
    rng = np.random.default_rng(seed)
    force, rate = by_hand(rng, poses)
    accel = force @ ACCEL.T + ACCEL_BIAS + 0.02 * rng.standard_normal(force.shape)
    gyro = rate @ GYRO.T + GYRO_BIAS + 0.002 * rng.standard_normal(rate.shape)
    counts = np.rint(np.hstack([accel * ACCEL_COUNTS, gyro * GYRO_COUNTS])).astype(int)
    rows = [",".join(map(str, row)) for row in counts]
    text = ["device,bench-3", f"rate,{RATE:g}", "ax,ay,az,gx,gy,gz", *rows]
    path.write_text("\n".join(text) + "\n", encoding="utf-8")


if __name__ == "__main__":
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    write(folder / "calibrate.csv", seed=1, poses=24)
    write(folder / "later.csv", seed=2, poses=6)
