"""Levels of inputs that come again: what is scatter is drawn anew at each of them, and what the model lacks is not."""

import numpy as np
from jaxtyping import Float, Int
from scipy.cluster.hierarchy import fcluster, linkage

from ...effects import Signal, Variant
from ..observations.blocks import Blocks
from ..observations.model_rows import Baseline
from .empirical import PREFIX
from .signatures import channel_terms, Term


NAME = PREFIX + "level of input"
SAME = 1e-3  # of the largest input, within which two are one: tables come back to 0.06° and 0.1 % (convention)
FEWEST = 4  # inputs that come again, as of positions


def repeated_levels(signal: Signal, blocks: Blocks, base: Baseline) -> list[Term]:
    r"""One free level for each input vector that two or more dwells share, channel by channel; none where few do.

    Over n dwells at k inputs, the levels' squares over those within inputs,

    $$F = \frac{\sum_j n_j \bar r_j^2 / (k - p)}{\sum_{ij} (r_{ij} - \bar r_j)^2 / (n - k)},$$

    are the test of lack of fit by replicates: independent scatter of any size gives Fisher's distribution.

    **Arguments:** `signal` is averaged over `blocks`; its `input` is what the triad was given.

    **Reference:** Draper and Smith, Applied Regression Analysis, 3rd ed. (1998), section 2.1.
    """
    place = np.cumsum(np.r_[0, np.diff(blocks.dwell) != 0])
    number = _numbered(np.asarray(signal.input), place)
    again = _that_come_again(number)
    if len(again) < FEWEST:
        return []
    dummy = (number[place][:, None] == again).astype(float)
    levels = np.broadcast_to(dummy[:, None, :], (len(dummy), 3, len(again)))
    formula = f"a level of each of {len(again)} inputs that come again"
    return channel_terms(NAME, Variant(formula, {}), base, levels)


def _numbered(
    given: Float[np.ndarray, "block 3"], place: Int[np.ndarray, " block"]
) -> Int[np.ndarray, " dwell"]:
    """A number for each dwell's input, the same for those that agree; `place` is the dwell of each block."""
    means = np.stack([np.bincount(place, x) / np.bincount(place) for x in given.T], axis=1)
    top = float(np.abs(means).max())
    if len(means) < 2 or top == 0.0:
        return np.zeros(len(means), int)
    return fcluster(linkage(means, "complete"), SAME * top, "distance")


def _that_come_again(number: Int[np.ndarray, " dwell"]) -> Int[np.ndarray, " input"]:
    """Inputs of several dwells, none of which follows another directly: a dwell cut in two is not positioned anew."""
    kept, counts = np.unique(number, return_counts=True)
    followed = number[1:][np.diff(number) == 0]
    return np.setdiff1d(kept[counts > 1], followed)
