"""Rows of two devices in turn, read as one: every second row has biases of its own."""

import numpy as np
from jaxtyping import Float

from ..data.formats.columns import AXES
from .dead_channels import triads
from .evidence import DeviceLogs, Log
from .finding import Finding, finding
from .thresholds import Thresholds


_BLOCK = 64  # rows: a line that is off half the sampling rate by 1 % turns its sign within, and is gone in the middle
_FEWEST = 20  # blocks
# Sigmas of a row from the middle of its neighbours, by which a block's rows go up and down in turn. The middle of 62
# rows of white noise is off by 0.2; biases of two MEMS devices differ by ten sigmas and more.
_APART = 3.0
_MOST_BLOCKS = 0.5  # that show it: rests, and motions that are smooth from row to row
# Of the middle distance, by which it varies from block to block, in the middle: biases stay. That of a line at half
# the sampling rate goes with the cosine of its phase, whose own variation is 0.4.
_STEADY = 0.1
_CHANNELS = 2  # a bit of one converter may go up and down; devices differ in all channels
_IN_MIDDLE = 1.4826  # a normal distribution's sigma over its median deviation


def check_interleaved_devices(device: DeviceLogs, limits: Thresholds) -> list[Finding]:
    """Every recording whose rows jump between two levels, from row to row throughout."""
    del limits
    found = []
    for log in device.logs:
        shown = {
            f"{name}_{AXES[k]}": distance
            for name, values in triads(log)
            for k in range(3)
            if (distance := _distance(values[:, k])) > 0.0
        }
        if len(shown) >= _CHANNELS:
            found.append(_finding(log, shown))
    return found


def _finding(log: Log, shown: dict[str, float]) -> Finding:
    most = max(shown, key=lambda n: shown[n])
    unit = "m/s²" if most.startswith("accel") else "rad/s"
    return finding(
        "interleaved",
        "warning",
        "time",
        f"{log.name}: every second row is of another level, in {len(shown)} channels ({most} by {shown[most]:.3g} "
        f"{unit}): rows of two devices in turn, read as one. Name the column that tells them as [columns] device, or "
        "give each a file of its own. (A line at half the sampling rate looks so, too.)",
        channels=tuple(shown),
        distance=shown[most],
    )


def _distance(x: Float[np.ndarray, " time"]) -> float:
    """By how much every second row is off the others, in the channel's unit; 0 where that is none of two devices."""
    between = x[1:-1] - 0.5 * (x[:-2] + x[2:])
    blocks = len(between) // _BLOCK
    if blocks < _FEWEST:
        return 0.0
    turns = between[: blocks * _BLOCK].reshape(blocks, _BLOCK) * np.tile([1.0, -1.0], _BLOCK // 2)
    middle = np.median(turns, axis=1)
    sigma = _IN_MIDDLE * np.median(np.abs(turns - middle[:, None]), axis=1)
    apart = np.abs(middle) > np.maximum(_APART * sigma, 1e-12 * np.abs(x).max())
    if apart.mean() < _MOST_BLOCKS:
        return 0.0
    sizes = np.abs(middle[apart])
    usual = float(np.median(sizes))
    return usual if np.median(np.abs(sizes - usual)) < _STEADY * usual else 0.0
