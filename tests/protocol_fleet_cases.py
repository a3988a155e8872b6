"""A small line on a rate table: two devices with two recordings each, whose clocks both begin at zero."""

from pathlib import Path

import numpy as np
import polars as pl


GRAVITY, RATE, ANGLE = 9.81, 1e-4, 1e-4  # m/s²; of the table, relative, and rad
NOISE, SAMPLES = 1e-4, 24  # rad/s and m/s² of one sample; rows of a dwell
DEVICES = ("U1", "U2")
CURVATURE = (
    4e-4  # rad/s at 1 g along y: what the second device's gyros add, and the model leaves out
)

_TOML = f"""[site]
gravity = {GRAVITY}
[recordings]
files = ["log_*.csv"]
[rig]
position_uncertainty = {np.degrees(ANGLE) * 3600}
rate_uncertainty = {RATE * 1e6}
[model]
temperature_degree = 0
"""


def write_line(folder: Path) -> Path:
    """A folder of two campaigns; the second device's gyros have an effect that no model here holds."""
    for number, device in enumerate(DEVICES):
        rng = np.random.default_rng(number)
        home = folder / device
        home.mkdir(parents=True)
        (home / "campaign.toml").write_text(_TOML)
        for part, degrees in enumerate((10.0, 30.0)):
            _log(rng, degrees, number).write_csv(home / f"log_{part}.csv")
    return folder


def _log(rng: np.random.Generator, degrees: float, device: int) -> pl.DataFrame:
    """Fourteen rests and twelve constant rates."""
    faces = np.concatenate([np.eye(3), -np.eye(3)])
    corners = np.array([[a, b, c] for a in (1, -1) for b in (1, -1) for c in (1, -1)]) / np.sqrt(3)
    up = np.concatenate([faces, corners, np.repeat(np.eye(3), 4, axis=0)])
    speed = np.tile([0.5, 1.0, -0.5, -1.0], 3)[:, None]
    rate = np.concatenate([np.zeros((14, 3)), speed * np.repeat(np.eye(3), 4, axis=0)])
    position = np.concatenate([np.arange(14), np.full(12, -1)])
    every = lambda x: np.repeat(x, SAMPLES, axis=0)
    accel = every(GRAVITY * up * (1 + 1e-3) + 0.02)
    bias = 1e-3 + 5e-3 * device  # rad/s: below and above 1000 °/h
    gyro = every(rate * (1 + 3e-3) + bias + device * CURVATURE * up[:, 1:2] ** 2)
    columns: dict[str, np.ndarray] = {"time": 0.1 * np.arange(len(accel))}
    for name, values, noise in (
        ("accel", accel, NOISE), ("gyro", gyro, NOISE),
        ("reference_accel", every(GRAVITY * up), 0.0), ("reference_gyro", every(rate), 0.0),
    ):  # fmt: skip
        drawn = values + rng.normal(0.0, noise, values.shape)
        columns |= {f"{name}_{a}": drawn[:, k] for k, a in enumerate("xyz")}
    columns |= {"temperature": np.full(len(accel), degrees), "position": every(position)}
    return pl.DataFrame(columns)
