"""The accelerometers' lever arms in the results' table, as `calibrate` finds them for each device.

accel_lever_arms               nine, by rows, m: accelerometer x along x, y and z, then y, then z
accel_lever_arms_sigma         of each, m
accel_lever_arms_covariance    lower triangles by rows of one accelerometer's three after another's, m²
greatest_force                 specific force in the data, g
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
import polars as pl

from ..calibration.calibration import Calibration
from ..calibration.device_place import EFFECT
from ..calibration.fitted_effects import FittedEffect
from .store import Manifest


_MANY = pl.List(pl.Float64)
_LOWER = np.tril_indices(3)
COLUMNS: Mapping[str, pl.DataType] = {
    "accel_lever_arms": _MANY,
    "accel_lever_arms_sigma": _MANY,
    "accel_lever_arms_covariance": _MANY,
    "greatest_force": pl.Float64(),
}


def lever_arm_columns(calibration: Calibration) -> dict[str, Any]:
    """One device's lever arms, by column of the results' table; none where none were estimated."""
    found = [e for e in calibration.effects if e.name == EFFECT]
    if not found:
        return {}
    arms = np.stack([np.asarray(e.coefficients, float) for e in found])
    covariances = np.stack([np.asarray(e.covariance, float) for e in found])
    return {
        "accel_lever_arms": arms.reshape(1, -1),
        "accel_lever_arms_sigma": np.sqrt(np.diagonal(covariances, axis1=1, axis2=2)).reshape(
            1, -1
        ),
        "accel_lever_arms_covariance": covariances[:, *_LOWER].reshape(1, -1),
        "greatest_force": np.array([float(found[0].greatest_input)]),
    }


def lever_arms_of(row: Mapping[str, Any], manifest: Manifest) -> tuple[FittedEffect, ...]:
    """A row's lever arms as effects of its calibration; none where the line's model has none."""
    values = row.get("accel_lever_arms")
    if values is None:
        return ()
    covariances = np.zeros((3, 3, 3))
    lower = np.reshape(row["accel_lever_arms_covariance"], (3, -1))
    covariances[:, *_LOWER] = lower
    covariances[:, _LOWER[1], _LOWER[0]] = lower
    beside = max(
        (m for m in (manifest.accel, manifest.gyro) if m is not None), key=lambda m: m.degree
    )
    scale = (beside.low, beside.high) if beside.degree else (0.0, 1.0)
    return tuple(
        FittedEffect(
            EFFECT, "accel", (k,), (), arm, covariances[k], "m",
            None, None, row["greatest_force"], beside.degree, scale,
        )
        for k, arm in enumerate(np.reshape(values, (3, 3)))
    )  # fmt: skip
