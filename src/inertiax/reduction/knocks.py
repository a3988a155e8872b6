"""Knocks and taps: short bursts of both triads within a rest, and single samples that stand out in one."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from .quiet_level import burst_deviates, in_quiet_levels, runs_of, widened


@dataclass(frozen=True)
class KnockThresholds:
    """When a burst is one. Deviates are standard normal under noise, see `quiet_level.burst_deviates`.

    A rest of 1000 rows holds about 1000 windows of each length. By two independent triads a sum of 8 is passed at a
    rate of 8e-9 a window; `benchmarks/handling.py` counts false ones with white and with MEMS noise.
    """

    together: float = 8.0  # sum of both triads' deviates (derived: 2^-0.5 of it is 5.7 sigma)
    each: float = 2.5  # of either triad at least, so that none speaks alone
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


def knocked(
    accel: Float[np.ndarray, "row 3"],
    gyro: Float[np.ndarray, "row 3"],
    step: float,
    converter: tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]],
    searched: bool,
    limits: KnockThresholds = THRESHOLDS,
) -> Bool[np.ndarray, " row"]:
    """Rows of one rest in which the device was knocked, with `reach` to either side.

    **Arguments:** both triads (any unit), `step` from sample to sample in s, and the steps of the converters. A burst
    counts that both triads show together. With `searched`, where the rest was found in the data and nobody vouches for
    it, what the gyros alone show counts too: a turn about the vertical moves nothing else.
    """
    num = len(accel)
    marked = np.zeros(num, bool)
    if num < limits.shortest or not 0.0 < step <= limits.slowest:
        return marked
    around = round(limits.around / step)
    felt = in_quiet_levels(accel, around, converter[0])
    turned = in_quiet_levels(gyro, around, converter[1])
    for seconds in limits.windows:
        width = max(round(seconds / step), limits.fewest)
        if 4 * width > num:
            continue
        a, g = burst_deviates(felt, width), burst_deviates(turned, width)
        hit = (a + g > limits.together) & (np.minimum(a, g) > limits.each)
        if searched:
            hit |= g > limits.gyro_alone
        marked |= widened(hit, width // 2)
    return widened(marked, max(round(limits.reach / step), 1))


def spiked(
    values: Float[np.ndarray, "row 3"],
    step: float,
    converter: Float[np.ndarray, "3"],
    limits: KnockThresholds = THRESHOLDS,
) -> Bool[np.ndarray, " row"]:
    """Rows of one rest in which one or two samples of a channel stand out alone."""
    num = len(values)
    marked = np.zeros(num, bool)
    if num < limits.shortest:
        return marked
    around = round(limits.around / step) if step > 0.0 else 0
    levels = np.abs(in_quiet_levels(values, min(around, num // 4), converter))
    for axis in range(3):
        start, stop = runs_of(levels[:, axis] > limits.spike)
        for a, b in zip(start, stop):
            beside = np.r_[levels[max(a - 2, 0) : a, axis], levels[b : b + 2, axis]]
            if b - a <= 2 and a >= 2 and b <= num - 2 and beside.max() < limits.beside:
                marked[a:b] = True
    return marked
