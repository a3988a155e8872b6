"""How long a block must be for its scatter to be that of white noise: longer than a hand's tremor.

A tremor moves a device to and fro. It is large in means over a tenth of its period and all but gone in means over a
second. Short blocks that are taken for white noise would make the means of whole rests many times worse than they are,
and an effect of several times their true noise would pass for more of it.
"""

import numpy as np
from jaxtyping import Float, Int

from .mean_noise import second_differences


_FALLS = 3.0  # times the variance that white noise leaves of a short block: less may be chance
_FEWEST = 30.0  # independent differences of a level that tells: its variance is known to a quarter


def length_beyond_tremor(
    channels: Float[np.ndarray, "time channel"],
    first: Int[np.ndarray, " rest"],
    stop: Int[np.ndarray, " rest"],
    shortest: int,
    *,
    lasting: bool = False,
) -> int:
    """Samples of a block from which on longer means scatter as white noise has it, or more; `shortest` at least.

    V(m) is the Hadamard variance of means over m samples. White noise has the same m V(m) at each m, flicker and walks
    have more at a longer one. Where a longer m' has m' V(m') < m V(m) / 3 on a channel, m is too short.

    **Arguments:** `first` and `stop` are rows of rests, in order; with `lasting` no longer m may be too short either:
    single samples are nearly white beside a tremor that is slower.
    """
    counts = stop - first
    rows = np.concatenate([np.arange(a, b) for a, b in zip(first, stop, strict=True)])
    starts = np.append(0, np.cumsum(counts)[:-1])
    length = shortest
    for channel in channels.T:
        values = channel[rows] - np.repeat(np.add.reduceat(channel[rows], starts) / counts, counts)
        samples, variances, freedom = second_differences(values, starts)
        samples, variances = samples[freedom >= _FEWEST], variances[freedom >= _FEWEST]
        if not len(samples):
            continue
        density = samples * variances
        least = np.minimum.accumulate(density[::-1])[::-1]
        white = density <= _FALLS * least
        if lasting:
            white = np.logical_and.accumulate(white[::-1])[::-1]
        # Levels double: the one below `shortest` stands for it.
        enough = samples[white & (2 * samples > shortest)]
        length = max(length, int(enough[0] if len(enough) else samples[-1]))
    return length
