"""Where up is in a campaign of gyros alone: along the axis of the rate table, if that axis stands upright.

The axis is one direction in the room. It is the vertical if the Earth rate of the rests makes the angle with it
that the latitude asks for; then it tells the specific force in every position, which no accelerometer was there
to feel. An axis that leans to the east or west changes that angle little (14 deg pass at a latitude of 50 deg);
nobody builds a table so.
"""

import numpy as np

from .attitude import attitude
from .blocks import EARTH_RATE, Log


TURNING = 100.0  # Earth rates; what turns faster shows the table's axis to half a degree
ONE_AXIS = 0.9994  # least cosine between the directions of plateaus, 2 deg
MOST = 0.8  # of the time at constant rates; the rest is the way from one position to another
UPRIGHT = np.deg2rad(2.0)  # greatest difference between latitude and the Earth rate's elevation


def upright_axis(log: Log) -> np.ndarray | None:
    """Specific force in g, `(time, 3)`; `None` where latitude, Earth rate or one upright axis is missing."""
    if log.latitude is None or log.reference_gyro is None:
        return None
    speed = np.linalg.norm(log.reference_gyro, axis=1)
    turning = (log.position < 0) & (speed > TURNING * EARTH_RATE)
    rest = log.position >= 0
    device = attitude(log) if turning.any() and rest.any() else None
    if device is None:
        return None
    seen = log.reference_gyro[turning] / speed[turning, None]
    plateau = _steady(log, turning)
    axes = np.einsum("tij,ti->tj", device[turning], seen)[plateau]
    if not len(axes):
        return None
    axis = np.linalg.eigh(axes.T @ axes)[1][:, -1]
    # Without the ways between positions, which pull a little
    near = axes[np.abs(axes @ axis) > 0.9]
    axis = np.linalg.eigh(near.T @ near)[1][:, -1] if len(near) else axis
    earth = np.einsum("tij,ti->tj", device[rest], log.reference_gyro[rest]).mean(axis=0)
    size = np.linalg.norm(earth)
    if np.mean(np.abs(axes @ axis) > ONE_AXIS) < MOST or not 0.9 < size / EARTH_RATE < 1.1:
        return None
    latitude = log.latitude
    elevation = np.arcsin(np.clip(earth @ axis / size, -1.0, 1.0))
    if abs(abs(elevation) - abs(latitude)) > UPRIGHT or abs(latitude) < 2 * UPRIGHT:
        return None
    return device @ (axis if elevation * latitude > 0 else -axis)


def _steady(log: Log, turning: np.ndarray) -> np.ndarray:
    """Which of the turning rows belong to constant rates."""
    assert log.reference_gyro is not None
    change = np.linalg.norm(np.diff(log.reference_gyro, axis=0), axis=1)
    calm = change < 0.01 * np.linalg.norm(log.reference_gyro[1:], axis=1)
    return (np.r_[False, calm] & np.r_[calm, False])[turning]
