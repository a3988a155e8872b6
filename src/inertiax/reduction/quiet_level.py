"""A rest's samples about their slow course, in standard deviations of what the rest reads undisturbed."""

from typing import no_type_check

import numpy as np
from jaxtyping import Float, Int


# These are called dozens of times for each of hundreds of rests: in the tests, checking the shapes of their arguments
# would take longer than they do.
MAD = 1.4826  # standard deviations of a normal distribution in one median distance
FEWEST_AROUND = 9  # samples that a slow course is the mean of
ENOUGH = 400  # rows tell a median distance to 6 %


@no_type_check  # see above
def moving_mean(x: Float[np.ndarray, "row *axis"], width: int) -> Float[np.ndarray, "row *axis"]:
    """Mean over the `width` rows around each row, over fewer at both ends."""
    num, half = len(x), max(width // 2, 1)
    total = np.zeros((num + 1, *x.shape[1:]), order="F")  # as the samples of a `Recording` lie
    np.cumsum(x, axis=0, out=total[1:])
    made = np.empty_like(x)
    whole = slice(half, max(num - half, half))  # rows with all neighbours
    count = 2 * half + 1
    np.subtract(total[count:], total[: max(num + 1 - count, 0)], out=made[whole])
    made[whole] /= count
    for row in (np.arange(min(half, num)), np.arange(max(num - half, half), num)):
        first, last = np.maximum(row - half, 0), np.minimum(row + half + 1, num)
        size = (last - first).reshape(-1, *[1] * (x.ndim - 1))
        made[row] = (total[last] - total[first]) / size
    return made


@no_type_check  # see above
def ordered(x: Float[np.ndarray, "row *axis"], share: float) -> Float[np.ndarray, " *axis"]:
    """The value that a `share` of the rows is below; on hundreds of short rests far faster than `np.quantile`."""
    k = min(int(share * len(x)), len(x) - 1)
    return np.asarray(np.partition(x, k, axis=0)[k])


@no_type_check  # see above
def median_distance(x: Float[np.ndarray, "row *axis"]) -> Float[np.ndarray, " *axis"]:
    """Standard deviation about zero by the median distance, of `ENOUGH` rows where there are more."""
    return np.asarray(MAD * ordered(np.abs(x[:: max(len(x) // ENOUGH, 1)]), 0.5))


@no_type_check  # see above
def in_quiet_levels(
    x: Float[np.ndarray, "row 3"], around: int, step: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "row 3"]:
    """Samples of one rest less their mean over `around` rows, in standard deviations of the rest's noise.

    The noise is at least one `step` of the converter, unit of x: where most samples are alike, one that is not is no
    event. A channel that never changes reads zero.
    """
    offset = x - x[0]
    left = offset - moving_mean(offset, max(around, FEWEST_AROUND))
    sigma = np.maximum(median_distance(left), step)
    return left * np.where(sigma > 0.0, 1.0 / np.where(sigma > 0.0, sigma, 1.0), 0.0)


class Bursts:
    """How far the energy of `width` rows around each row is from the rest's usual, as a standard normal deviate.

    **Arguments:** `energy` of each row, the sum of squares of `freedom` normal numbers; with a freedom of 0 all
    deviates are 0. The sum of squares of n normal numbers over n, its cube root made normal (Wilson and Hilferty, PNAS
    17, 1931). Noise with memory scatters more: the deviates are divided by their own robust spread where that is above
    one.

    Few rows of a long rest are asked: cube roots are taken of them alone.
    """

    @no_type_check  # see above
    def __init__(self, energy: Float[np.ndarray, " row"], freedom: float, width: int):
        self._told = freedom > 0.0
        if not self._told:
            return
        self._power = moving_mean(energy, width) / freedom
        self._usual = 2.0 / (9.0 * freedom * width)
        self._middle, self._spread = 0.0, 1.0
        apart = self._deviates(self._power[:: max(width // 2, 1)])  # neighbours hold nearly alike
        self._middle = float(ordered(apart, 0.5))
        self._spread = max(float(median_distance(apart - self._middle)), 1.0)

    @no_type_check  # see above
    def _deviates(self, power: np.ndarray) -> np.ndarray:
        normal = (np.cbrt(power) - (1.0 - self._usual)) / np.sqrt(self._usual)
        return (normal - self._middle) / self._spread

    @no_type_check  # see above
    def at(self, rows: np.ndarray | slice) -> Float[np.ndarray, " chosen"]:
        """The deviates of some rows."""
        return self._deviates(self._power[rows]) if self._told else np.zeros(np.size(rows))

    @no_type_check  # see above
    def above(self, limit: float) -> np.ndarray:
        """Rows, by number, whose deviates are above a limit that is not negative."""
        if not self._told:
            return np.zeros(0, np.int64)
        root = (limit * self._spread + self._middle) * np.sqrt(self._usual) + 1.0 - self._usual
        return np.flatnonzero(self._power > root**3)


@no_type_check  # see above
def runs_of(marked: np.ndarray) -> tuple[Int[np.ndarray, " run"], Int[np.ndarray, " run"]]:
    """Ranges `[start, stop)` of true values."""
    edge = np.diff(np.concatenate([[0], marked.astype(np.int8), [0]]))
    return np.flatnonzero(edge == 1), np.flatnonzero(edge == -1)


@no_type_check  # see above
def widened(marked: np.ndarray, reach: int) -> np.ndarray:
    """True values and what lies within `reach` of them."""
    if reach == 0 or not marked.any():
        return marked
    start, stop = runs_of(marked)
    change = np.zeros(len(marked) + 1, np.int64)
    np.add.at(change, np.maximum(start - reach, 0), 1)
    np.add.at(change, np.minimum(stop + reach, len(marked)), -1)
    return np.cumsum(change[:-1]) > 0
