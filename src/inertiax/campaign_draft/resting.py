"""The rests of a log in its own units: where they are, and what the triads read there."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from ..data.recording import Recording
from ..physics.directions import num_directions
from ..reduction.rests import find_rests
from ..reduction.segments import segment, Segments


_LONG = 60  # s of a log that warms up
_STEP = np.deg2rad(1.0)  # from one second to the next
_DRIFT = 0.5  # of gravity: three times the largest drift of consumer parts from cold to warm
_DIFFERENT = np.deg2rad(10.0)  # directions that are two poses


class Resting(NamedTuple):
    """Rests of a log, in its own units."""

    start: Int[np.ndarray, " rest"]
    stop: Int[np.ndarray, " rest"]
    accel: Float[np.ndarray, "rest 3"] | None
    single_rows: bool  # each row is the mean of one pose
    turned: bool = False  # no rest was found: all rows stand for one
    rows: int = 0  # of the log
    slowly: bool = False  # turned all along, slowly enough that stretches stand for rests

    @property
    def num_rests(self) -> int:
        """How many rests there are."""
        return len(self.start)

    @property
    def moves(self) -> bool:
        """Whether the device moves for most of the log, so that it may have stood in other poses, too."""
        return 2 * int((self.stop - self.start).sum()) < self.rows


def resting(
    time: Float[np.ndarray, " time"],
    accel: Float[np.ndarray, "time 3"] | None,
    *,
    single_rows: bool,
    centre: Float[np.ndarray, "3"] | None = None,
) -> Resting:
    """Rests by the accelerometers, whose unit does not matter for that; the whole log where there are none.

    **Arguments:** with the `centre` of the accelerometers' outputs, stretches stand for rests where the device turned
    slowly all along.
    """
    rows = np.arange(len(time))
    if accel is None:
        return Resting(np.array([0]), np.array([len(time)]), None, False)
    if single_rows:
        return Resting(rows, rows + 1, accel, True)
    if centre is None:
        found = find_rests(Recording(time=time, accel=accel), window=1.0)
    else:
        found = segment(Recording(time=time, accel=accel - centre), handling=False)
    start, stop = np.asarray(found.start), np.asarray(found.stop)
    turned = not len(start)
    if turned:
        start, stop = np.array([0]), np.array([len(time)])
    means = np.array([accel[a:b].mean(axis=0) for a, b in zip(start, stop, strict=True)])
    slowly = isinstance(found, Segments) and found.turning is not None
    return Resting(start, stop, means, False, turned, len(time), slowly)


def rests_of_both(
    time: Float[np.ndarray, " time"],
    accel: Float[np.ndarray, "time 3"],
    gyro: Float[np.ndarray, "time 3"],
) -> Resting:
    """Rests by both triads in SI, as a calibration finds them; none of them where the gyros turn all along."""
    found = segment(Recording(time=time, accel=accel, gyro=gyro), handling=False)
    start, stop = np.asarray(found.start), np.asarray(found.stop)
    means = [accel[a:b].mean(axis=0) for a, b in zip(start, stop, strict=True)]
    return Resting(start, stop, np.reshape(means, (-1, 3)), False, not means, len(time))


def drifts_in_one_pose(
    time: Float[np.ndarray, " time"], accel: Float[np.ndarray, "time 3"]
) -> bool:
    """Whether a log is of one pose although its outputs drift: no two seconds that follow one another differ by what a
    hand turns, and the first and the last ones by no more than drifting biases do."""
    second = np.floor(time - time[0]).astype(int)
    count = np.bincount(second)
    kept = count > 0
    means = np.stack([np.bincount(second, a)[kept] / count[kept] for a in accel.T], axis=1)
    unit = means / np.maximum(np.linalg.norm(means, axis=1, keepdims=True), 1e-300)
    if len(unit) < _LONG:
        return False
    step = np.linalg.norm(np.diff(unit, axis=0), axis=1)
    return bool(step.max() < _STEP and np.linalg.norm(unit - unit[0], axis=1).max() < _DRIFT)


def poses(up: Float[np.ndarray, "rest 3"]) -> int:
    """How many directions among unit vectors are more than 10° from each other."""
    return num_directions(up, _DIFFERENT)
