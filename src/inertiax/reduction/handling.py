"""Where a device moved in a rest that was found in its own data: a knock, or a hand that held it.

Who states the positions of a recording vouches for its rests. Where they are searched in the data, a rest may hold
a second of motion, or be held by hand altogether; the gyros see it long before it matters to the accelerometers, and
in a model of rests it would pass for a jump or a bump of the sensor. What one gyro shows for a second or two cannot
be told from a turn about its axis there, so it is left out and said; what lasts longer stays.
"""

import numpy as np
from jaxtyping import Bool, Float, Int


MOVED = 5.0  # standard deviations from what the rest says around it
AROUND = 2.0  # s, to either side: what lasts longer is no knock
REACH = 0.5  # s, to either side of a motion, and at both ends of a rest
SHORT = 4.0  # times REACH: shorter rests keep their ends
HELD = 0.2  # of a rest's blocks, from which all of it is motion
LEAST_KEPT = 0.3  # of all blocks: below, nothing is known of what is usual


def knocked(
    gyro: Float[np.ndarray, "block 3"],
    time: Float[np.ndarray, " block"],
    dwell: Int[np.ndarray, " block"],
) -> Bool[np.ndarray, " block"]:
    """Blocks of rests in which the device moved, by the gyros' means; none where that cannot be told.

    A block counts that is off the median of its rest within `AROUND` by more than `MOVED` standard deviations
    ($1.4826$ times the median distance of all blocks) on any axis. Blocks of the rest within `REACH` go with it, and
    the whole rest where a part `HELD` does. The ends of a rest may still hold some of the motion between rests.
    """
    off = np.zeros_like(gyro)
    rests = [np.flatnonzero(dwell == number) for number in np.unique(dwell)]
    for rest in rests:
        first = np.searchsorted(time[rest], time[rest] - AROUND)
        last = np.searchsorted(time[rest], time[rest] + AROUND, side="right")
        for k, a, b in zip(rest, first, last):
            off[k] = np.abs(gyro[k] - np.median(gyro[rest[a:b]], axis=0))
    usual = 1.4826 * np.median(off, axis=0)
    # An axis whose converter shows most blocks as alike tells nothing, nor do blocks longer than `AROUND`.
    ratio = np.where(usual > 0.0, off / np.where(usual > 0.0, usual, 1.0), 0.0)
    sudden = ratio.max(axis=1) > MOVED
    if not sudden.any():
        return sudden
    moved = np.zeros(len(gyro), bool)
    for rest in rests:
        t = time[rest]
        near = np.zeros(len(rest), bool)
        for moment in t[sudden[rest]]:
            near |= np.abs(t - moment) <= REACH
        if near.mean() > HELD:
            near[:] = True
        if t[-1] - t[0] > SHORT * REACH:
            near |= (t - t[0] < REACH) | (t[-1] - t < REACH)
        moved[rest] = near
    return moved if moved.mean() <= 1.0 - LEAST_KEPT else np.zeros(len(gyro), bool)
