"""Slow motion by hand in rests that were found in the data, by the gyros' means over a tenth of a second.

Who states the positions of a recording vouches for its rests. Where they are searched in the data, a rest may hold
a second of motion, or be held by hand altogether; the gyros see it long before it matters to the accelerometers, and
in a model of rests it would pass for a jump or a bump of the sensor. What one gyro shows for a second or two cannot
be told from a turn about its axis there; what lasts longer stays.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from .quiet_level import MAD


@dataclass(frozen=True)
class MotionThresholds:
    """When the gyros of a searched rest show motion (set on three public logs turned by hand, convention)."""

    moved: float = 12.0  # standard deviations from what the rest says around it
    block: float = 0.1  # s, of a mean
    around: float = 2.0  # s, to either side: what lasts longer is no motion by hand
    reach: float = (
        0.5  # s, to either side of a motion, and at both ends of a rest in which there is one
    )
    long: float = 2.0  # s; shorter rests keep their ends
    most: float = (
        0.7  # of all blocks: where more would be motion, nothing is known of what is usual
    )


THRESHOLDS = MotionThresholds()
_TOGETHER = 4096  # windows whose medians are taken at once


def moved_by_hand(
    rests: Sequence[Float[np.ndarray, "_ 3"]], step: float, limits: MotionThresholds = THRESHOLDS
) -> list[Bool[np.ndarray, " _"]]:
    """Rows of each rest in which the device moved, by the gyros' outputs (rad/s); none where that cannot be told.

    A mean counts that is off the median of its rest within `around` by more than `moved` standard deviations (the
    median distance of all means) on any axis. `step` is the time from sample to sample, s.
    """
    size = max(round(limits.block / step), 1) if step > 0.0 else 1
    means = [_means(gyro, size) for gyro in rests]
    near = max(round(limits.around / (size * step)), 1) if step > 0.0 else 1
    off = [_off(m, near) for m in means]
    none = [np.zeros(len(gyro), bool) for gyro in rests]
    if not sum(len(o) for o in off):
        return none
    usual = MAD * np.median(np.concatenate(off), axis=0)
    reach = max(round(limits.reach / (size * step)), 1) if step > 0.0 else 1
    long = limits.long / (size * step) if step > 0.0 else np.inf
    marked = [_with_surroundings(_ratio(o, usual) > limits.moved, reach, long) for o in off]
    if np.concatenate(marked).mean() > limits.most:
        return none
    return [_rows(m, size, len(gyro)) for m, gyro in zip(marked, rests)]


def _means(gyro: np.ndarray, size: int) -> np.ndarray:
    blocks = len(gyro) // size
    return gyro[: blocks * size].reshape(blocks, size, 3).mean(axis=1)


def _off(means: np.ndarray, near: int) -> np.ndarray:
    """Distances from the median of the means around each."""
    width, count = 2 * near + 1, len(means)
    medians = np.empty((count, 3))
    inner = range(near, count - near) if count >= width else range(0)
    if inner:
        windows = np.lib.stride_tricks.sliding_window_view(means, width, axis=0)
        for a in range(0, len(windows), _TOGETHER):
            part = np.partition(windows[a : a + _TOGETHER], near, axis=2)
            medians[near + a : near + a + len(part)] = part[:, :, near]
    for k in sorted({*range(count)} - {*inner}):
        around = np.sort(means[max(k - near, 0) : k + near + 1], axis=0)
        medians[k] = 0.5 * (around[(len(around) - 1) // 2] + around[len(around) // 2])
    return np.abs(means - medians)


def _ratio(off: np.ndarray, usual: np.ndarray) -> np.ndarray:
    """Greatest axis; one whose converter shows most means as alike tells nothing."""
    return np.where(usual > 0.0, off / np.where(usual > 0.0, usual, 1.0), 0.0).max(
        axis=1, initial=0.0
    )


def _with_surroundings(sudden: np.ndarray, reach: int, long: float) -> np.ndarray:
    if not sudden.any():
        return sudden
    near = np.convolve(sudden, np.ones(2 * reach + 1), "full")[reach : reach + len(sudden)] > 0
    if len(sudden) > long:
        near[:reach] = near[len(near) - reach :] = True
    return near


def _rows(marked: np.ndarray, size: int, rows: int) -> np.ndarray:
    """Rows of the marked blocks; those after the last block go with it."""
    made = np.repeat(marked, size)
    return np.pad(made, (0, rows - len(made)), mode="edge") if len(made) else np.zeros(rows, bool)
