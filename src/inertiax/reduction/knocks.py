"""Knocks and taps: short bursts of both triads within a rest, and single samples that stand out in one."""

from dataclasses import dataclass
from typing import no_type_check

import numpy as np
from jaxtyping import Bool, Float

from .quiet_level import Bursts, in_quiet_levels, runs_of, widened


@dataclass(frozen=True)
class KnockThresholds:
    """When a burst is one. Deviates are standard normal under noise, see `quiet_level.Bursts`.

    A rest of 1000 rows holds about 1000 windows of each length. By two independent triads a sum of 8 is passed at a
    rate of 8e-9 a window; `benchmarks/handling.py` counts false ones with white and with MEMS noise.
    """

    together: float = 8.0  # sum of both triads' deviates (derived: 2^-0.5 of it is 5.7 sigma)
    each: float = 3.0  # of either triad at least, so that none speaks alone (1.3e-3 a window)
    gyro_alone: float = 10.0  # where the rests were found in the data: see `knocked`
    windows: tuple[float, ...] = (
        0.03,
        0.1,
        0.3,
    )  # s, over which energy is summed: a tap and its ringing
    fewest: int = 3  # rows in a window; one sample may be a fault of the read-out
    slowest: float = 0.05  # s from sample to sample; slower logs do not show a tap
    shortest: int = 32  # rows of a rest that tell its quiet level
    around: float = 1.0  # s, over which the slow course is taken
    reach: float = (
        0.2  # s, to either side of a burst that go with it: ringing of a housing on a table
    )
    spike: float = 10.0  # sigma, of one or two samples of one channel (convention)
    beside: float = 4.0  # sigma, that the samples beside a spike stay below


THRESHOLDS = KnockThresholds()


@no_type_check  # as in `quiet_level`
def levels_of(
    values: Float[np.ndarray, "row 3"],
    step: float,
    converter: Float[np.ndarray, "3"],
    limits: KnockThresholds = THRESHOLDS,
) -> Float[np.ndarray, "row 3"]:
    """One rest's samples in quiet levels; `step` from sample to sample in s, `converter` its LSB in their unit."""
    around = round(limits.around / step) if step > 0.0 else 0
    return in_quiet_levels(values, min(around, len(values) // 4), converter)


@no_type_check  # as in `quiet_level`
def knocked(
    felt: Float[np.ndarray, "row 3"],
    turned: Float[np.ndarray, "row 3"],
    step: float,
    searched: bool,
    limits: KnockThresholds = THRESHOLDS,
) -> Bool[np.ndarray, " row"]:
    """Rows of one rest in which the device was knocked, with `reach` to either side.

    **Arguments:** the accelerometers' and the gyros' `levels_of` the rest, `step` from sample to sample in s. A burst
    counts that both triads show together. With `searched`, where the rest was found in the data and nobody vouches for
    it, what the gyros alone show counts too: a turn about the vertical moves nothing else.
    """
    num = len(felt)
    marked = np.zeros(num, bool)
    if num < limits.shortest or not 0.0 < step <= limits.slowest:
        return marked
    energies = [_energy(x) for x in (felt, turned)]
    for seconds in limits.windows:
        width = max(round(seconds / step), limits.fewest)
        if 4 * width > num:
            continue
        force, rate = (Bursts(e, f, width) for e, f in energies)
        hit = np.zeros(num, bool)
        both = np.intersect1d(force.above(limits.each), rate.above(limits.each), assume_unique=True)
        hit[both] = force.at(both) + rate.at(both) > limits.together
        if searched:
            hit[rate.above(limits.gyro_alone)] = True
        for a, b in zip(*runs_of(hit)):
            marked[slice(*_inside(int(a), int(b), width))] = True
    return widened(marked, max(round(limits.reach / step), 1)) if marked.any() else marked


@no_type_check  # as in `quiet_level`
def _inside(first: int, last: int, width: int) -> tuple[int, int]:
    """Where a burst lies that windows of so many rows show whose middles are `[first, last)`.

    A burst is in every window that it reaches: half a window within both ends of the run, or, of a run shorter than a
    window, about its middle.
    """
    if last - first >= width:
        return first + width // 2, last - width // 2
    middle = (first + last) // 2
    return max(middle - width // 2, 0), middle + width // 2 + 1


@no_type_check  # as in `quiet_level`
def _energy(levels: np.ndarray) -> tuple[np.ndarray, float]:
    """Sum of squares of each row, and of how many channels that are not constant."""
    return np.einsum("ij,ij->i", levels, levels), float(np.any(levels != 0.0, axis=0).sum())


@no_type_check  # as in `quiet_level`
def spiked(
    levels: Float[np.ndarray, "row 3"], limits: KnockThresholds = THRESHOLDS
) -> Bool[np.ndarray, " row"]:
    """Rows of one rest in which one or two samples of a channel stand out alone, by a triad's `levels_of` the rest."""
    num = len(levels)
    marked = np.zeros(num, bool)
    if num < limits.shortest:
        return marked
    size = np.abs(levels)
    for axis in np.flatnonzero(size.max(axis=0) > limits.spike):
        start, stop = runs_of(size[:, axis] > limits.spike)
        for a, b in zip(start, stop):
            beside = np.r_[size[max(a - 2, 0) : a, axis], size[b : b + 2, axis]]
            if b - a <= 2 and a >= 2 and b <= num - 2 and beside.max() < limits.beside:
                marked[a:b] = True
    return marked
