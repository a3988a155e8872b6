"""A gyro's zero that jumps between two rests and stays: a restart, another device, or a blow."""

import numpy as np
from jaxtyping import Float

from ..data.formats.columns import AXES
from .evidence import DeviceLogs, Log
from .finding import Finding, finding
from .thresholds import Thresholds


_LEAST = 4e-3  # rad/s, 0.23 deg/s: g-sensitivity and warm-up between two rests are below
_LEAST_APART = 5e-4  # rad/s, 0.03 deg/s, apart from what goes with the force
_ENOUGH = 12  # rests tell what goes with the force, and how much the zero changes otherwise
_TIMES = 8.0  # robust deviations of the differences from rest to rest
_SIDE = 3  # rests on each side that have to agree
_WARMER = 1.0  # °C between them at the most, or the zero follows the temperature


def check_zero_jump(device: DeviceLogs, limits: Thresholds) -> list[Finding]:
    """Medians of three rests before and after each moment, against the scatter from rest to rest.

    What changes with the specific force is taken away first where there are rests enough to tell it.
    """
    del limits
    return [f for log in device.logs for f in _one(log)]


def _one(log: Log) -> list[Finding]:
    rate = log.over_rests("gyro")
    if rate is None or log.num_rests < 2 * _SIDE + 2:
        return []
    force = log.over_rests("accel")
    zero, least = rate.mean, _LEAST
    if force is not None and log.num_rests >= _ENOUGH:
        zero, least = _apart(zero, force.mean), _LEAST_APART
    jump, at, axis = _largest(zero)
    if jump < least or not _same_warmth(log, at):
        return []
    usual = 1.4826 * np.median(np.abs(np.diff(zero[:, axis])))
    if jump < _TIMES * usual:
        return []
    before, after = (log.recording.time[log.stop[at] - 1], log.recording.time[log.start[at + 1]])
    return [
        finding(
            "restart",
            "warning",
            f"gyro_{AXES[axis]}",
            f"{log.name}: the zero of gyro_{AXES[axis]} jumps by {jump:.3g} rad/s between {log.moment(before)} and "
            f"{log.moment(after)} and stays there ({usual:.2g} is usual from rest to rest): the device was "
            "restarted or struck, or is another one since.",
            jump=jump,
            usual=float(usual),
            time=float(before),
        )
    ]


def _apart(
    zero: Float[np.ndarray, "rest 3"], force: Float[np.ndarray, "rest 3"]
) -> Float[np.ndarray, "rest 3"]:
    """The zero without what goes with the force from rest to rest; the change that fits worst has no part in it."""
    made = np.empty_like(zero)
    turned = np.diff(force, axis=0)
    for axis in range(3):
        change = np.diff(zero[:, axis])
        by_force = np.linalg.lstsq(turned, change, rcond=1e-2)[0]
        kept = np.arange(len(change)) != np.argmax(np.abs(change - turned @ by_force))
        by_force = np.linalg.lstsq(turned[kept], change[kept], rcond=1e-2)[0]
        made[:, axis] = zero[:, axis] - force @ by_force
    return made


def _largest(means: Float[np.ndarray, "rest 3"]) -> tuple[float, int, int]:
    """The largest jump that stays, rad/s, the rest before it, and its axis."""
    best = (0.0, 0, 0)
    for k in range(_SIDE - 1, len(means) - _SIDE):
        before, after = means[k - _SIDE + 1 : k + 1], means[k + 1 : k + 1 + _SIDE]
        # What no rest of one side shares with one of the other.
        apart = np.maximum(
            after.min(axis=0) - before.max(axis=0), before.min(axis=0) - after.max(axis=0)
        )
        axis = int(np.argmax(apart))
        size = abs(float(np.median(after[:, axis]) - np.median(before[:, axis])))
        if apart[axis] > 0.5 * size:
            best = max(best, (size, k, axis))
    return best


def _same_warmth(log: Log, at: int) -> bool:
    probe = log.recording.temperature
    if probe is None:
        return True
    first, last = (
        log.start[max(at - _SIDE + 1, 0)],
        log.stop[min(at + _SIDE, log.num_rests - 1)] - 1,
    )
    return bool(np.ptp(np.quantile(probe[first : last + 1, 0], (0.05, 0.95))) < _WARMER)
