"""Stretches that turn about the vertical: accelerometers read as at rest there, and gyros move as in the log's motions.

Rests are told against the quietest stretches of their own log. Where an arm or a hand turns all along, these are the
moments at which the axis of the turn stands upright: gravity does not turn in the case, but the gyros go on. What they
do there is compared with what they do where gravity turns, so that a unit or a scale that is wrong by any factor
changes nothing, and no noise of a gyro passes for a turn.
"""

import numpy as np
from jaxtyping import Bool, Float, Int

from ..physics.vectors import angle_between


TURNS = "it turns on, as its gyros tell, where its accelerometers read nearly as at rest"
_BLOCK = 0.1  # s, of a mean: shorter than a turn to and fro, longer than a motor's vibration
_TURNED = np.radians(10.0)  # of gravity, more than a push of 0.1 g makes of it
_WINDOWS = 3  # in which gravity has turned, to say how gyros move (convention)
# Of the rms rate in these: at rest gyros scatter by a hundredth of it, in a hand that holds still by a tenth, and in a
# turn that goes on by half or more.
_SHARE = 1.0 / 3.0


def turning(
    accel: Float[np.ndarray, "time 3"],
    gyro: Float[np.ndarray, "time 3"],
    edges: Int[np.ndarray, "rest 2"],
    step: float,
    width: int,
) -> Bool[np.ndarray, " rest"]:
    """Which of the ranges `[start, stop)` turn; none where gravity turns nowhere. Both triads may be in any unit.

    **Arguments:** `step` is the time from sample to sample, s, and `width` the rows of a window; a rest counts by the
    median of its windows, since a bias that drifts within minutes is no motion.
    """
    size = max(int(round(_BLOCK / step)) if step > 0.0 else 1, 1)
    found = np.zeros(len(edges), bool)
    count = len(gyro) // width
    if width < 2 * size or not len(edges):
        return found
    inside = np.zeros(len(gyro), bool)
    for start, stop in edges:
        inside[start:stop] = True
    at_rest = np.median(gyro[inside], axis=0)
    lies = np.array([accel[start:stop].mean(axis=0) for start, stop in edges])
    # Windows outside, and the rest that is nearest in time.
    outside = np.flatnonzero(~inside[: count * width].reshape(count, width).any(axis=1))
    middle = (outside + 0.5) * width
    nearest = np.abs(middle[:, None] - edges.mean(axis=1)).argmin(axis=1)
    force = accel[: count * width].reshape(count, width, 3)[outside].mean(axis=1)
    moved = outside[angle_between(force, lies[nearest]) > _TURNED]
    if len(moved) < _WINDOWS:
        return found
    means = _means(gyro - at_rest, np.arange(count) * width, size, width)
    usual = float(np.mean(np.square(means[moved]).sum(axis=2)))
    for k, (start, stop) in enumerate(edges):
        first = np.arange(start, stop - width + 1, width)
        if len(first):
            scatter = _means(gyro, first, size, width).var(axis=1).sum(axis=1)
            found[k] = np.median(scatter) > _SHARE**2 * usual
    return found


def _means(
    gyro: Float[np.ndarray, "time 3"], first: Int[np.ndarray, " window"], size: int, width: int
) -> Float[np.ndarray, "window block 3"]:
    """Means over `size` rows in each window of `width` from a `first` row on."""
    parts = width // size
    rows = first[:, None] + np.arange(parts * size)
    return gyro[rows].reshape(len(first), parts, size, 3).mean(axis=2)
