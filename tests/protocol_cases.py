"""A small campaign over temperature, whose protocol several tests look at."""

import math
from pathlib import Path

import numpy as np
import polars as pl


GRAVITY = 9.81


def write_campaign(folder: Path, devices: tuple[str, ...] = ("",)) -> Path:
    """Fourteen rests at each of three temperatures of an ideal triad with a bias of 0.1, −0.2 and 0.05 m/s²."""
    faces = np.concatenate([np.eye(3), -np.eye(3)])
    corners = np.array([[a, b, c] for a in (1, -1) for b in (1, -1) for c in (1, -1)]) / math.sqrt(
        3
    )
    up = np.tile(np.concatenate([faces, corners]), (3, 1))
    number = np.repeat(np.arange(42), 20)
    folder.mkdir(parents=True)
    (folder / "campaign.toml").write_text(
        f'[site]\ngravity = {GRAVITY}\n[recordings]\nfiles = ["*.csv"]\n[rig]\ntemperature_uncertainty = 0.2\n'
        "[model]\ntemperature_degree = 1\n"
    )
    for k, device in enumerate(devices):
        rng = np.random.default_rng(k)
        heat = np.repeat([0.0, 20.0, 40.0], 14)
        level = GRAVITY * up + np.array([0.1, -0.2, 0.05]) + 1e-4 * (heat[:, None] - 20.0)
        accel = np.repeat(level, 20, axis=0) + rng.normal(0.0, 1e-4, (840, 3))
        columns = {f"accel_{a}": accel[:, i] for i, a in enumerate("xyz")}
        time = 0.1 * np.arange(840) + number
        table = {"time": time, **columns, "position": number, "temperature": np.repeat(heat, 20)}
        frame = pl.DataFrame(table)
        if device:
            frame = frame.with_columns(pl.lit(device).alias("device"))
        frame.write_csv(folder / f"{k}.csv")
    return folder
