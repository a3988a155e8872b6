"""How many directions of gravity a device rested in: a bias that drifts in one pose turns none.

A rest is one direction, however far the outputs drift in it: while it lasts nothing moves. Rests that follow one
another are one where the gyros turn by nothing between them and the accelerometers go on from where they were.
"""

from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float, Int

from ..data.recording import Recording
from ..data.stored_recording import StoredRecording
from ..physics.directions import num_directions, SAME_DIRECTION
from ..reduction.dwells import Dwells
from ..reduction.rests import find_rests
from ..reduction.segments import rests_are_searched


# rad, by the gyros' rates between two rests, less their means at both (convention: half of two directions' least angle)
_NO_TURN = 0.5 * SAME_DIRECTION
_WINDOW = 1.0  # s, over which motion is judged, as `segment` does
_SHORT = 60.0  # s; over more a bias of 1 mrad/s less than assumed would turn by 3°


def directions(dwells: Dwells, recordings: Sequence[Recording] = ()) -> int:
    """How many directions of gravity the rests show, each further than 5 degrees from all others.

    **Arguments:** `dwells` with a device's accelerometer means, several blocks of each rest maybe; `recordings`
    are those that their `rows` count, whose gyros tell rests between which nothing turned.
    """
    resting = np.flatnonzero(np.asarray(dwells.position) >= 0)
    outputs = np.asarray(dwells.accel)[resting]
    if dwells.rows is None:
        return num_directions(outputs)
    where = np.asarray(dwells.rows)[resting].astype(int)
    fresh = np.any(np.diff(where[:, [0, 3]], axis=0) != 0, axis=1)
    for k in np.flatnonzero(fresh):
        if _alike(outputs[k], outputs[k + 1]) and _not_turned(
            dwells, resting[k : k + 2], recordings
        ):
            fresh[k] = False
    group = np.concatenate([[0], np.cumsum(fresh)])
    unit = outputs / np.maximum(np.linalg.norm(outputs, axis=1, keepdims=True), 1e-300)
    sums = np.stack([np.bincount(group, u) for u in unit.T], axis=1)
    return num_directions(sums)


def directions_without_gyros(recordings: Sequence[Recording]) -> int:
    """How many directions the rests show that accelerometers alone find; 0 where labels say what a rest is."""
    alone = lambda log: Recording(time=log.time, accel=log.accel)
    return _searched(recordings, alone, _WINDOW)


def directions_in_brief(recordings: Sequence[Recording]) -> int:
    """How many directions show that both triads find by half the window; 0 where labels say what a rest is."""
    return _searched(recordings, lambda log: log, 0.5 * _WINDOW)


def _searched(
    recordings: Sequence[Recording], seen: Callable[[Recording], Recording], window: float
) -> int:
    """Directions of the rests that a search of what is `seen` of each recording finds."""
    means = []
    for log in recordings:
        if log.accel is None or log.gyro is None or isinstance(log, StoredRecording):
            continue
        if rests_are_searched(log):
            quiet = find_rests(seen(log), window=window)
            ranges = zip(quiet.start, quiet.stop, strict=True)
            means += [log.accel[a:b].mean(axis=0) for a, b in ranges]
    return num_directions(np.array(means)) if means else 0


def _alike(one: Float[np.ndarray, "3"], other: Float[np.ndarray, "3"]) -> bool:
    return num_directions(np.stack([one, other])) == 1


def _not_turned(
    dwells: Dwells, pair: Int[np.ndarray, "2"], recordings: Sequence[Recording]
) -> bool:
    """Whether the gyros say that the device stands after a motion as it did before it."""
    (number, _, first, _), (other, last, _, _) = np.asarray(dwells.rows)[pair].astype(int)
    if number != other or number >= len(recordings) or dwells.gyro is None:
        return False
    log = recordings[number]
    if log.gyro is None or last <= first or log.time[last] - log.time[first - 1] > _SHORT:
        return False
    gyro, time = log.gyro[first - 1 : last + 1], log.time[first - 1 : last + 1]
    rate = gyro - np.asarray(dwells.gyro)[pair].mean(axis=0)
    # Large turns whose rates cancel change the pose all the same; the accelerometers would show it.
    turned = np.sum(0.5 * (rate[1:] + rate[:-1]) * np.diff(time)[:, None], axis=0)
    return bool(np.linalg.norm(turned) < _NO_TURN)
