"""Single motions that cannot be what the gyros recorded: rows were lost or doubled in them, or a gyro's range ended.

A calibration that fits one such motion with the others spreads its error over all parameters.
"""

import numpy as np
from jaxtyping import Bool, Float


MISSED = 0.3  # rad; a rest's direction is known to milliradians, bias wander in a motion is less
_FAR = 6.0  # times the median misfit
_OF_ITS_PATH = 0.2  # MEMS scale factors are within 3 %, raw ones of a wrong range are off by 2
_MOST = 4  # one in so many: where more miss, something is wrong with all
_FEWEST = 5  # motions that agree


def missed(
    misfit: Float[np.ndarray, " motion"], path: Float[np.ndarray, " motion"]
) -> Bool[np.ndarray, " motion"]:
    """Motions that miss gravity's turn far beyond the others and beyond what a scale factor's error explains.

    **Arguments:** `misfit` is the angle between gravity as the gyros turned it and as it was seen, rad; `path` the
    angle through which the device turned, step by step, rad.
    """
    misfit, path = np.asarray(misfit), np.asarray(path)
    off = np.zeros(len(misfit), bool)
    if len(misfit) == 0:
        return off
    limit = max(MISSED, _FAR * float(np.median(misfit)))
    off = (misfit > limit) & (misfit > _OF_ITS_PATH * path)
    few = off.sum() * _MOST <= len(off) and len(off) - off.sum() >= _FEWEST
    return off if few else np.zeros(len(off), bool)
