"""The parts of a log's rests that spectra are taken of, all of one length."""

import numpy as np
from jaxtyping import Float

from .evidence import Log


_MOST = 4000  # parts: their spectra know a noise to a few percent, and more take time


def parts_of_rests(
    log: Log, values: Float[np.ndarray, "time 3"], width: int, fewest: int
) -> Float[np.ndarray, "part width 3"] | None:
    """Parts of `width` samples from all rests, evenly taken where there are many; `None` for less than `fewest`."""
    starts = [np.arange(a, b - width + 1, width) for a, b in zip(log.start, log.stop)]
    rows = np.concatenate(starts) if starts else np.zeros(0, np.int64)
    if len(rows) < fewest:
        return None
    rows = rows[:: -(-len(rows) // _MOST)]
    return values[rows[:, None] + np.arange(width)]
