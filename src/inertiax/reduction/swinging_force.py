"""What goes with the specific force while it swings through the case: no noise of a dwell's mean.

On a plateau about an axis that is not upright gravity turns through the case. What an output less its reference follows
then, such as a g-sensitivity of the gyros or the accelerometers' own matrix, returns turn by turn and belongs to a
force whose mean over the dwell the model knows; left in, it would pass for noise with a memory of a turn. At
1e-3 rad/s per g it made the scale factors' uncertainties six times what they are.
"""

import numpy as np
from jaxtyping import Bool, Float, Int

from .._records import Module
from ..data.recording import Recording
from .dwells import is_told


# m/s², root mean square about the dwell's line, from which a reference swings: what a rest's own changes by is less.
_SWINGS = 0.5
# Samples of a dwell, of which three coefficients on three axes take few enough to leave the variance to 5 %.
_ENOUGH = 64


_TURNING = 1e-3  # rad/s of the reference, more than the Earth turns


class Swing(Module):
    """How a triad's outputs go with the force in those dwells where it swings."""

    mean: Float[np.ndarray, "dwell 3"]  # of the force, m/s²
    slope: Float[np.ndarray, "dwell 3"]  # a second
    by_force: Float[np.ndarray, "dwell 3 3"]  # output by force; 0 where it does not swing

    def part(
        self,
        force: Float[np.ndarray, "row 3"],
        time: Float[np.ndarray, " row"],
        dwell: Int[np.ndarray, " row"],
    ) -> Float[np.ndarray, "row 3"]:
        """What goes with the force at some rows, of times from the middle of their dwells (s)."""
        about = force - self.mean[dwell] - time[:, None] * self.slope[dwell]
        return np.einsum("nij,nj->ni", self.by_force[dwell], about)


def swung_by(
    recording: Recording, triad: str, rows: Int[np.ndarray, " row"]
) -> Float[np.ndarray, "row 3"] | None:
    """The force, m/s², that may swing at some rows: the plan's, and for gyros that of the accelerometers where it tells
    none; zero where gyros rest, `None` where nothing tells it.

    A device that is held in a hand swings, too, and its outputs by that are no error of the model's.
    """
    stated, felt = recording.reference_accel, recording.accel
    if triad == "accel":
        return None if stated is None else stated[rows]
    if triad != "gyro" or recording.reference_gyro is None or (stated is None and felt is None):
        return None
    made = np.zeros((len(rows), 3)) if stated is None else stated[rows]
    if felt is not None:
        made = np.where(is_told(made)[:, None], made, felt[rows])
    turning = np.linalg.norm(recording.reference_gyro[rows], axis=1) > _TURNING
    return np.where(turning[:, None], made, 0.0)


def swing(
    force: Float[np.ndarray, "row 3"],
    starts: Int[np.ndarray, " dwell"],
    time: Float[np.ndarray, " row"],
    deviations: Float[np.ndarray, "row 3"],
) -> Swing | None:
    """Least squares of deviations from each dwell's straight line by those of the force, m/s²; `None` where it
    swings in no dwell. `time` is from the middle of each dwell, s."""
    counts = np.diff(np.append(starts, len(force)))
    swings = _swings(force, starts, counts)
    if not swings.any():
        return None
    each = (len(starts), 3)
    made = Swing(np.zeros(each), np.zeros(each), np.zeros((*each, 3)))
    for k in np.flatnonzero(swings):
        mine = slice(starts[k], starts[k] + counts[k])
        here, t = force[mine], time[mine]
        made.mean[k] = here.mean(axis=0)
        made.slope[k] = t @ (here - made.mean[k]) / max(float(t @ t), 1e-300)
        about = here - made.mean[k] - t[:, None] * made.slope[k]
        # What does not swing, such as the force along the axis, tells nothing.
        made.by_force[k] = np.linalg.lstsq(about, deviations[mine], rcond=1e-6)[0].T
    return made


def _swings(
    force: Float[np.ndarray, "row 3"],
    starts: Int[np.ndarray, " dwell"],
    counts: Int[np.ndarray, " dwell"],
) -> Bool[np.ndarray, " dwell"]:
    """Dwells of enough rows, all told, in which the force swings."""
    over = lambda x: np.add.reduceat(x, starts, axis=0) / counts[:, None]
    told = over(np.asarray(is_told(force), float)[:, None])[:, 0] == 1.0
    about = np.square(force - np.repeat(over(force), counts, axis=0)).sum(axis=1)
    return told & (counts >= _ENOUGH) & (over(about[:, None])[:, 0] > _SWINGS**2)
