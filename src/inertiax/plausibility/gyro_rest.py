"""Gyros at rest: no zero offset is as large as raw counts or another unit make it."""

import numpy as np

from .evidence import DeviceLogs
from .finding import Finding, finding
from .thresholds import Thresholds


def check_gyro_rest(device: DeviceLogs, limits: Thresholds) -> list[Finding]:
    """The median of |ω| over samples at rest, or over all rows where nothing says that they rest."""
    found = []
    for log in device.logs:
        rate = log.recording.gyro
        if rate is None:
            continue
        if log.labelled and not log.num_rests:
            continue  # it says that it never rests
        still = rate[log.at_rest] if log.num_rests else rate
        size = float(np.median(np.linalg.norm(still, axis=1)))
        if size <= limits.resting_rate:
            continue
        found.append(
            finding(
                "gyro_unit",
                "error",
                "gyro",
                f"{log.name}: gyro has a median norm of {size:.4g} rad/s at rest, more than {limits.resting_rate:g}; "
                "likely raw counts or another unit: deg/s, deg/h, or count with scale and offset.",
                norm=size,
                rests=log.num_rests,
            )
        )
    return found
