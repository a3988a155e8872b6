"""Whether rows of accelerometers look like the means of single poses."""

import math

import numpy as np
from jaxtyping import Float


_FEWEST = 4  # rows: three directions and a repetition tell nothing yet
MOST_POSE_ROWS = 500  # rows: nobody writes down more poses by hand
_TURNED = math.radians(10.0)  # from row to row; samples of one log are far closer to each other
# Of the median norm: biases and scale errors of consumer sensors, 4 % to either side and more; a device that moves fast
# enough to turn so far reads other forces.
_NORM_SPREAD = 0.12


def turn_between_rows(accel: Float[np.ndarray, "row 3"]) -> float | None:
    """By how much (rad, median) neighbouring rows turn, where each row is the mean of one pose; `None` where not.

    They are where the norm, in any unit, stays within 12 % while the direction turns by more than 10° between most
    neighbouring rows: a log sampled in time does one or the other.
    """
    if not _FEWEST <= len(accel) <= MOST_POSE_ROWS:
        return None
    norm = np.linalg.norm(accel, axis=1)
    if np.any(norm == 0.0) or np.ptp(norm) > _NORM_SPREAD * np.median(norm):
        return None
    up = accel / norm[:, None]
    turned = np.arccos(np.clip((up[1:] * up[:-1]).sum(axis=1), -1.0, 1.0))
    return float(np.median(turned)) if np.mean(turned > _TURNED) >= 0.5 else None
