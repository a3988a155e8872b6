"""Rests in which a converter has reached its end, and samples that hold it."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from .mean_noise import quantisation_step


@dataclass(frozen=True)
class ClipThresholds:
    """When a rest is clipped: one value, the channel's extreme in the whole recording, holds many of its samples."""

    share: float = (
        0.2  # of a rest's samples (convention); noise of 1.5 steps gives its extreme 1 in 100
    )
    fewest: int = 20  # samples
    noise: float = (
        1.5  # steps of the converter, that the other rests scatter by: else levels repeat anyway
    )


THRESHOLDS = ClipThresholds()
FEWEST_AT_END = (
    5  # samples in a row at an extreme, below which it is noise or a turn's peak (convention)
)
FEWEST_ELSEWHERE = 20  # pairs of samples that tell how often a channel repeats its value
BY_CHANCE = 1e-3  # channels in which chance makes so long a run


def clipped(
    values: Float[np.ndarray, "time 3"],
    start: Int[np.ndarray, " rest"],
    stop: Int[np.ndarray, " rest"],
    limits: ClipThresholds = THRESHOLDS,
) -> Bool[np.ndarray, " rest"]:
    """Which rests hold samples of a channel at the end of its range."""
    marked = np.zeros(len(start), bool)
    for x in values.T:
        extremes = x.min(), x.max()
        rests = [x[a:b] for a, b in zip(start, stop)]
        at_end = np.array([max(np.sum(r == e) for e in extremes) for r in rests])
        size = stop - start
        suspect = (at_end >= limits.fewest) & (at_end >= limits.share * size)
        if not suspect.any() or suspect.all():
            continue
        if not in_coarse_steps(x, start[~suspect], stop[~suspect], limits):
            marked |= suspect
    return marked


def in_coarse_steps(
    x: Float[np.ndarray, " time"],
    start: Int[np.ndarray, " rest"],
    stop: Int[np.ndarray, " rest"],
    limits: ClipThresholds = THRESHOLDS,
) -> bool:
    """Whether a channel's noise at rest hides in the steps of its converter, so that any value repeats there."""
    if not len(start):
        return False
    noise = float(np.median([np.std(x[a:b]) for a, b in zip(start, stop, strict=True)]))
    return noise <= limits.noise * quantisation_step(x)


def clipped_rows(values: Float[np.ndarray, "time 3"]) -> Bool[np.ndarray, " time"]:
    """Samples of a triad at the end of a channel's range, where the channel stays there as noise does not.

    What a channel reads most of the time, as gyros do in rests without noise, is no end of its range.
    """
    marked = np.zeros(len(values), bool)
    for x in values.T:
        for extreme in {float(x.min()), float(x.max())} - {float(np.median(x))}:
            if holds_extreme(x, extreme):
                marked |= x == extreme
    return marked


def holds_extreme(x: Float[np.ndarray, " time"], extreme: float) -> bool:
    """Whether runs at the extreme are `beyond_habit`."""
    there = x == extreme
    if there.sum() < FEWEST_AT_END or there.all():
        return False
    elsewhere = ~there[1:] & ~there[:-1]
    repeats = int(np.sum((x[1:] == x[:-1]) & elsewhere))
    edges = np.flatnonzero(np.diff(np.concatenate([[False], there, [False]]).astype(np.int8)))
    longest = int((edges[1::2] - edges[::2]).max())
    return beyond_habit(longest, len(x), repeats, int(elsewhere.sum()))


def beyond_habit(longest: int, rows: int, repeats: int, pairs: int) -> bool:
    """Whether a run of `longest` rows at one value is too long for a channel's own habit of repeating values.

    A channel of N rows that repeats its last value with probability p stays L samples at one value by chance
    with probability about N p^L; below one in a thousand it must be the end of the range.

    **Arguments:** p is told by `repeats` among the `pairs` of neighbours elsewhere.
    """
    if pairs < FEWEST_ELSEWHERE or longest < FEWEST_AT_END:
        return False
    habit = (repeats + 1) / (pairs + 2)
    return rows * habit**longest < BY_CHANCE
