"""A reference of rates that says rest while the gyros turn: the rates of a table that were not written, or not read."""

import numpy as np

from ..physics.wgs84 import EARTH_RATE
from .evidence import DeviceLogs, Log
from .finding import Finding, finding
from .thresholds import Thresholds


_AT_REST = 1.5  # Earth rates, as `reduction.segments` takes a reference for rest
_NORMAL = 0.6745 * np.sqrt(2.0)  # median of the absolute difference of two Gaussian numbers, sigmas


def check_idle_reference(device: DeviceLogs, limits: Thresholds) -> list[Finding]:
    """An error for each recording in which that holds for a tenth of the time or more.

    Where positions are labelled, the labels say when the device rests, and a reference may be zero while it moves.
    """
    if "gyro" in device.left_alone:
        return []
    return [found for log in device.logs if (found := _of_one(log, limits)) is not None]


def _of_one(log: Log, limits: Thresholds) -> Finding | None:
    recording = log.recording
    gyro, known = recording.gyro, recording.reference_gyro
    if gyro is None or known is None or recording.position is not None or len(gyro) < 2:
        return None
    speed = np.linalg.norm(gyro - np.median(gyro, axis=0), axis=1)
    noise = float(np.median(np.abs(np.diff(gyro, axis=0)))) / _NORMAL
    turns = speed > max(limits.idle_rate, limits.idle_noise * noise)
    idle = turns & (np.linalg.norm(known, axis=1) <= _AT_REST * EARTH_RATE)
    share = float(np.mean(idle))
    if share < limits.idle_share:
        return None
    seconds = share * float(recording.time[-1] - recording.time[0])
    fastest = float(np.rad2deg(np.quantile(speed[idle], 0.9)))
    text = (
        f"{log.name}: reference_gyro says rest in {seconds:.0f} s in which the gyros turn, at up to {fastest:.0f} "
        "deg/s. Name the table's rates under [columns], or label positions, with −1 while it moves."
    )
    return finding("idle_reference", "error", "reference_gyro", text, seconds=seconds, rate=fastest)
