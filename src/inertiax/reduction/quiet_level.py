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
    total = np.concatenate([np.zeros_like(x[:1]), np.cumsum(x, axis=0)])
    row = np.arange(num)
    first, last = np.maximum(row - half, 0), np.minimum(row + half + 1, num)
    return (total[last] - total[first]) / (last - first).reshape(-1, *[1] * (x.ndim - 1))


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


@no_type_check  # see above
def burst_deviates(
    energy: Float[np.ndarray, " row"], freedom: float, width: int
) -> Float[np.ndarray, " row"]:
    """How far the energy of `width` rows around each row is from the rest's usual, as a standard normal deviate.

    **Arguments:** `energy` of each row, the sum of squares of `freedom` normal numbers. The sum of squares of n normal
    numbers over n, its cube root made normal (Wilson and Hilferty, PNAS 17, 1931). Noise with memory scatters more: the
    deviates are divided by their own robust spread where that is above one.
    """
    power = moving_mean(energy, width) / freedom
    spread = 2.0 / (9.0 * freedom * width)
    deviate = (np.cbrt(power) - (1.0 - spread)) / np.sqrt(spread)
    apart = deviate[:: max(width // 2, 1)]  # neighbours hold nearly the same rows
    middle = float(ordered(apart, 0.5))
    return (deviate - middle) / max(float(median_distance(apart - middle)), 1.0)


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
