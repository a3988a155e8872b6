"""What a current that changes within rests moves the magnetometers by there, taken off before the rests are judged.

An output is m' = (E + S) m + b + c I: within a rest its change with the current is c, whatever the orientation. Of each
rest c is the slope over the current beside a straight line in time, and of all the median, each with the weight of its
current's variance: a rest in which the device moves does not spoil it. Taken off is c (I − Ī), so that the rest's mean
keeps c Ī.
"""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float, Int

from ..data.recording import Recording


FEWEST = 8  # samples of a rest that tell a slope beside a line in time


def without_current_changes(
    mine: Recording,
    current: Float[np.ndarray, " time"],
    start: Int[np.ndarray, " rest"],
    stop: Int[np.ndarray, " rest"],
    used: Bool[np.ndarray, " time"],
    noise: Float[np.ndarray, "3"],
) -> Recording:
    """The recording with `mag` (T) as it would be if the current (A) kept its mean within each rest.

    **Arguments:** rests are the rows `[start, stop)` that are `used`; `noise` is 1 sigma of a sample, T: where the
    current moves no rest's samples by more, the recording is as it was, which keeps the steps of its converter.
    """
    assert mine.mag is not None
    rows = [np.arange(a, b)[used[a:b]] for a, b in zip(start, stop, strict=True)]
    found = [_slope(mine.time[r], current[r], mine.mag[r]) for r in rows]
    weights = np.array([w for _, w in found])
    if not weights.any():
        return mine
    each = np.array([c for c, _ in found])
    slope = np.array([_weighted_median(each[:, k], weights) for k in range(3)])
    spread = np.array([np.std(current[r]) for r in rows])
    if not np.any(np.abs(slope) * spread.max() > noise):
        return mine
    mag = mine.mag.copy()
    for r in rows:
        mag[r] -= np.outer(current[r] - current[r].mean(), slope)
    return dataclasses.replace(mine, mag=mag)


def _slope(
    time: Float[np.ndarray, " row"],
    current: Float[np.ndarray, " row"],
    mag: Float[np.ndarray, "row 3"],
) -> tuple[Float[np.ndarray, "3"], float]:
    """Slopes over the current beside a line in time, T/A, and the current's squares about that line, A²."""
    if len(time) < FEWEST:
        return np.zeros(3), 0.0
    t = time - time.mean()
    square = t @ t
    level = lambda x: x - x.mean(axis=0) - np.multiply.outer(t, t @ x / square)
    changes = level(current)
    weight = float(changes @ changes)
    return (changes @ level(mag) / weight, weight) if weight > 0.0 else (np.zeros(3), 0.0)


def _weighted_median(
    values: Float[np.ndarray, " rest"], weights: Float[np.ndarray, " rest"]
) -> float:
    order = np.argsort(values)
    total = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(total, 0.5 * total[-1])])
