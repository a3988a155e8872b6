"""Whether each row of a recording is the mean of one pose, although the campaign does not say so."""

import math

import numpy as np

from .evidence import DeviceLogs
from .finding import Finding, finding
from .thresholds import Thresholds


_FEWEST = 4  # rows: three directions and a repetition tell nothing yet
_MOST = 500  # rows: nobody writes down more poses by hand
_TURNED = math.radians(10.0)  # from row to row; samples of one log are far closer to each other
# Of the median norm: a device that moves fast enough to turn so far reads other forces.
_NORM_SPREAD = 0.05


def check_pose_rows(device: DeviceLogs, limits: Thresholds) -> list[Finding]:
    """Rows whose norm stays within 5 % while their direction turns by more than 10° between most neighbours.

    A log sampled in time does one or the other.
    """
    del limits
    found = []
    for log in device.logs:
        accel = log.recording.accel
        said = log.recording.position is not None or log.recording.reference_accel is not None
        if accel is None or said or not _FEWEST <= len(accel) <= _MOST:
            continue
        norm = np.linalg.norm(accel, axis=1)
        if np.any(norm == 0.0) or np.ptp(norm) > _NORM_SPREAD * np.median(norm):
            continue
        up = accel / norm[:, None]
        turned = np.arccos(np.clip((up[1:] * up[:-1]).sum(axis=1), -1.0, 1.0))
        if np.mean(turned > _TURNED) < 0.5:
            continue
        angle = float(np.degrees(np.median(turned)))
        found.append(
            finding(
                "positions",
                "error",
                "position",
                f"{log.name}: {len(accel)} rows turn by {angle:.0f}° from one to the next, so each looks like the mean "
                "of one pose.",
                remedy="[columns]\nposition = { row_index = true }",
                rows=len(accel),
                degrees=angle,
            )
        )
    return found
