"""Samples that a log holds twice, as a reader quicker than the sensor makes them.

A sensor of 100 Hz read at 200 Hz gives each value twice. Such a log has a spectrum of its own making, and half as
many samples as rows. The sensor's own samples are what noise is found from.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Int

from .._records import field, Module
from ..reduction.mean_noise import quantisation_step
from .stored_channel import BLOCK, Log, StoredChannel


# Share of rows that repeat the row before. Fewer may be chance, or a sample lost now and then.
_MANY = 0.1
# Of a converter's steps that pass between neighbours: below this chance repeats them too often to tell.
_FINE = 4.0
# Share of the new values that come at the same remainder of rows where a sample is held for a whole number of rows.
_STEADY = 0.95


_EVEN = 0.5  # of the variance by chance (convention)


class OwnSamples(Module):
    """Rows of a log in which the sensor gave a new value."""

    rows: Int[np.ndarray, " sample"] | None  # None: all
    share: float = field(static=True)  # of the rows that repeat the one before

    def of(self, log: Log) -> Float[np.ndarray, " sample"] | StoredChannel:
        """The sensor's own samples of one channel; in memory where some are left out."""
        return log if self.rows is None else log[:][self.rows]

    def rate(self, rate: float, num_rows: int) -> float:
        """The sensor's own rate, Hz, in a log of `rate`."""
        return rate if self.rows is None else rate * len(self.rows) / num_rows


def own_samples(channels: Sequence[Log]) -> OwnSamples:
    """The new samples among rows that a reader of another rate has repeated, axes of one triad together.

    **Arguments:** `channels` are the axes, each of shape (time,).

    A row repeats the one before where no axis changes. Rows are left out where many repeat and rounding
    alone does not do that: by whole numbers of rows (each value twice), or at another pattern that is regular.
    """
    same = _repeated(channels)
    share = float(same.mean())
    if share < _MANY or not _by_holding(channels, same):
        return OwnSamples(None, share)
    period, phase, steady = _steps(same)
    if (
        period > 1 and steady > _STEADY
    ):  # rounding may give two samples the same value, which count all the same
        return OwnSamples(np.arange((phase + 1) % period, len(same) + 1, period), share)
    return OwnSamples(np.concatenate([[0], 1 + np.flatnonzero(~same)]), share)


def _repeated(channels: Sequence[Log]) -> Bool[np.ndarray, " step"]:
    """Whether the samples of all channels are those of the row before."""
    rows = len(channels[0])
    same = np.empty(rows - 1, bool)
    for first in range(0, rows - 1, BLOCK):
        parts = (channel[first : first + BLOCK + 1] for channel in channels)
        same[first : first + BLOCK] = np.logical_and.reduce([p[1:] == p[:-1] for p in parts])
    return same


def _by_holding(channels: Sequence[Log], same: Bool[np.ndarray, " step"]) -> bool:
    """Whether rows repeat because a sample is held: chance would repeat axes one by one as well.

    Axes that are rounded coarsely repeat their values by themselves, each its own; rows then repeat as
    often as the axes' chances multiplied say. Of a held sample all repeat together.
    """
    period, _, steady = _steps(same)
    in_step = period > 1 and steady > _STEADY
    alone = [float(np.mean(_repeated([axis]))) for axis in channels]
    if len(alone) == 1:
        moved = np.abs(np.diff(channels[0][:]))[~same]
        step = quantisation_step(channels[0][:])
        fine = step == 0.0 or float(np.median(moved)) >= _FINE * step
        return in_step or (fine and _regular(same))
    # If held with probability h and repeated by chance with p: alone = h + (1 - h) p, together h + (1 - h) Π p.
    return in_step or float(np.mean(same)) > 2.0 * float(np.prod(alone))


def _regular(same: Bool[np.ndarray, " step"]) -> bool:
    """Whether repeats, or new values where these are fewer, come at more even distances than by chance, whose variance
    is m (m − 1) for a mean m.

    A coarse output less a correction in steps, as by a rounded temperature, repeats by chance and shows no one step.
    """
    distance = np.diff(np.flatnonzero(same if same.mean() < 0.5 else ~same))
    mean = float(distance.mean())
    return float(distance.var()) < _EVEN * mean * (mean - 1.0)


def _steps(same: Bool[np.ndarray, " step"]) -> tuple[int, int, float]:
    """Rows from one new value to the next, the remainder at which they come, and the share that come there."""
    period = round(1.0 / max(1.0 - float(same.mean()), 1e-3))
    if period < 2:
        return 1, 0, 1.0
    fresh = np.bincount(np.flatnonzero(~same) % period, minlength=period)
    return period, int(np.argmax(fresh)), float(fresh.max() / max(fresh.sum(), 1))
