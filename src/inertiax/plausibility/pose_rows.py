"""Whether each row of a recording is the mean of one pose, although the campaign does not say so."""

import math

from ..data.pose_rows import turn_between_rows
from .evidence import DeviceLogs
from .finding import Finding, finding
from .thresholds import Thresholds


def check_pose_rows(device: DeviceLogs, limits: Thresholds) -> list[Finding]:
    """Rows that `turn_between_rows` takes for poses, where neither positions nor references say what they are."""
    del limits
    found = []
    for log in device.logs:
        accel = log.recording.accel
        said = log.recording.position is not None or log.recording.reference_accel is not None
        if accel is None or said:
            continue
        turned = turn_between_rows(accel)
        if turned is None:
            continue
        angle = math.degrees(turned)
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
