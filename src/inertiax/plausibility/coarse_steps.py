"""Outputs that stand still at rest because the converter's step is coarser than their noise.

Such rows repeat the row before as held samples do. Three things tell them apart. Each axis repeats by itself, so that
all repeat together as often as their own chances multiplied say; of a held sample all repeat at once. A value that
changes at rest changes by a single step. And new values come at no regular number of rows.
"""

import numpy as np
from jaxtyping import Bool, Float

from ..reduction.mean_noise import converter_steps
from .evidence import Log
from .thresholds import Thresholds


# Of a converter's steps, that neighbouring values differ by in the median: noise that steps do not hide, above 1 step,
# makes differences of 1.4 steps rms, and rows of a slow turn pass few.
_FINE = 4.0
_TOGETHER = 2.0  # times the axes' chances multiplied, up to which they repeat each by itself (as `allan.repeats`)
_FEWEST = 20  # changes at rest that tell their size; with fewer those of the whole recording do
_REGULAR = 0.95  # share of the new values at one remainder of rows, from which samples are held
_SINGLE = 4.0  # times the next longest stand: one that is longer is no habit of the converter (convention)


def coarse_steps(
    log: Log, values: Float[np.ndarray, "time 3"], limits: Thresholds
) -> tuple[float, float] | None:
    """The coarsest step of a triad that hides its noise at rest, in the unit of `values`, and the share of the rows at
    rest that repeat the row before; `None` where rows repeat for another reason, or rarely."""
    steps = converter_steps(values)
    rest = log.at_rest[1:] & log.at_rest[:-1]
    if np.any(steps == 0.0) or not rest.any():
        return None
    same = values[1:] == values[:-1]
    held = same.all(axis=1)
    share = float(held[rest].mean())
    if share <= limits.repeated or share > _TOGETHER * float(np.prod(same[rest].mean(axis=0))):
        return None
    if _one_stand(held) or _regular(held[rest]):
        return None
    moved = np.abs(np.diff(values, axis=0)) / steps
    at_rest = moved[rest][~same[rest]]
    told = at_rest if len(at_rest) >= _FEWEST else moved[~same]
    if not len(told) or float(np.median(told)) >= _FINE:
        return None
    return float(steps.max()), share


def _one_stand(held: Bool[np.ndarray, " step"]) -> bool:
    """Whether one run of repeats is far longer than all others: a freeze, in coarse outputs too."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], held, [False]]).astype(np.int8)))
    runs = np.sort(edges[1::2] - edges[::2])
    return len(runs) == 1 or bool(runs[-1] > _SINGLE * runs[-2])


def _regular(held: Bool[np.ndarray, " step"]) -> bool:
    """Whether new values come at one remainder of a whole number of rows."""
    fresh = np.flatnonzero(~held)
    period = round(1.0 / max(1.0 - float(held.mean()), 1e-3))
    if period < 2 or len(fresh) < _FEWEST:
        return False
    return float(np.bincount(fresh % period).max()) > _REGULAR * len(fresh)
