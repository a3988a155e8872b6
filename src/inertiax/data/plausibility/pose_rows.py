"""Whether each row of a recording is the mean of one pose, although the campaign does not say so."""

import math

import numpy as np

from ..recording import Recording


_FEWEST = 4  # rows: three directions and a repetition tell nothing yet
_MOST = 500  # rows: nobody writes down more poses by hand
_TURNED = math.radians(10.0)  # from row to row; samples of one log are far closer to each other
_NORM_SPREAD = (
    0.05  # of the median norm: a device that moves fast enough to turn so far reads other forces
)


def refuse_pose_rows(recording: Recording) -> None:
    """Raises `ValueError`, with the line that says it, where rows are single poses and nothing tells so.

    They are where the accelerometers' norm stays within 5 % while their direction turns by more than 10° between
    most neighbouring rows: a log sampled in time does one or the other.
    """
    accel = recording.accel
    said = recording.position is not None or recording.reference_accel is not None
    if accel is None or said or not _FEWEST <= recording.num_samples <= _MOST:
        return
    norm = np.linalg.norm(accel, axis=1)
    if np.any(norm == 0.0) or np.ptp(norm) > _NORM_SPREAD * np.median(norm):
        return
    up = accel / norm[:, None]
    turned = np.arccos(np.clip((up[1:] * up[:-1]).sum(axis=1), -1.0, 1.0))
    if np.mean(turned > _TURNED) < 0.5:
        return
    raise ValueError(
        f"{recording.name}: {recording.num_samples} rows turn by {np.degrees(np.median(turned)):.0f}° from one to the "
        "next, so each looks like the mean of one pose; if so, write [columns] position = { row_index = true }."
    )
