"""A user's script that pyright must pass in strict mode: `tests/test_packaging.py` runs it over this file."""

from pathlib import Path

import jax
import numpy as np

import inertiax
from inertiax.calibrate.pipeline import calibrate, DeviceFailure, DeviceResult
from inertiax.data.formats import read_recordings
from inertiax.estimators import Invariant


def bias_of(folder: Path) -> float:
    """The first accelerometer's bias of a campaign's first device, m/s²."""
    campaign: inertiax.Campaign = inertiax.load_campaign(folder)
    first: DeviceResult | DeviceFailure = calibrate(campaign)[0]
    if isinstance(first, DeviceFailure):
        raise SystemExit(first.reason)
    calibration: inertiax.Calibration = first.calibration
    inertiax.write_calibration(calibration, folder / "calibration.json")
    again = inertiax.read_calibration(folder / "calibration.json")
    return float(again.accel_errors(20.0).bias[0])


def compensated(calibration: inertiax.Calibration, recording: inertiax.Recording) -> float:
    """The mean specific force of a recording, m/s²."""
    if recording.accel is None or recording.gyro is None or recording.temperature is None:
        return float("nan")
    force, _ = jax.vmap(calibration)(recording.accel, recording.gyro, recording.temperature[:, 0])
    return float(np.linalg.norm(np.asarray(force), axis=1).mean())


def curve(dwells: inertiax.Dwells) -> inertiax.Curve:
    """The procedure of the founding paper, by hand."""
    method = inertiax.GaussNewtonIteration(
        Invariant(gravity=9.81), inertiax.Polynomial(3, -40.0, 60.0)
    )
    solution = inertiax.iterate(method, dwells)
    return solution.curve


def stationary(path: Path) -> list[str]:
    """Names of the recordings in a file, and whether each has temperatures."""
    return [f"{r.name} {r.temperature is not None}" for r in read_recordings(path)]
