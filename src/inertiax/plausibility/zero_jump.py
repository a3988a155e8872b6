"""A gyro's zero that jumps between two rests and stays: a restart, another device, or a blow."""

import numpy as np
from jaxtyping import Bool, Float

from ..data.formats.columns import AXES
from .evidence import DeviceLogs, Log
from .finding import Finding, finding
from .thresholds import Thresholds


_LEAST = 4e-3  # rad/s, 0.23 deg/s: g-sensitivity and warm-up between two rests are below
_LEAST_APART = 5e-4  # rad/s, 0.03 deg/s, apart from what goes with the force
_ENOUGH = 12  # rests tell what goes with the force, and how much the zero changes otherwise
# rad/s per m/s², 0.5°/s per g, some times the greatest in data sheets (0.1 to 0.2): a fit that says more is of motion.
_MOST_BY_FORCE = np.radians(0.5) / 9.8
_TIMES = 8.0  # robust deviations of the differences from rest to rest
_SIDE = 3  # rests on each side that have to agree
_WARMER = 1.0  # °C between them at the most, or the zero follows the temperature


def check_zero_jump(device: DeviceLogs, limits: Thresholds) -> list[Finding]:
    """Medians of three rests before and after each moment, against the scatter from rest to rest.

    What changes with the specific force is taken away first where there are rests enough to tell it. Rests in which the
    device turns on by the least jump do not count.
    """
    del limits
    return [f for log in device.logs for f in _one(log)]


def _one(log: Log) -> list[Finding]:
    rate = log.over_rests("gyro")
    if rate is None or log.num_rests < 2 * _SIDE + 2:
        return []
    quiet = np.flatnonzero(_turns_by(log) < _LEAST)
    if len(quiet) < 2 * _SIDE + 2:
        return []
    force = log.over_rests("accel")
    zero, least = rate.mean[quiet], np.full(3, _LEAST)
    if force is not None and len(quiet) >= _ENOUGH:
        zero, told = _apart(zero, force.mean[quiet])
        least[told] = _LEAST_APART
    jump, at, axis = _largest(zero)
    if jump < least[axis]:
        return []
    usual = 1.4826 * np.median(np.abs(np.diff(zero[:, axis])))
    if jump < _TIMES * usual:
        return []
    first, last = int(quiet[at - _SIDE + 1]), int(quiet[at + _SIDE])
    if not _same_warmth(log, first, last):
        return []
    before = log.recording.time[log.stop[quiet[at]] - 1]
    after = log.recording.time[log.start[quiet[at + 1]]]
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


def _turns_by(log: Log) -> Float[np.ndarray, " rest"]:
    """1 sigma of each rest's mean rate by its quarters, rad/s, of the worst axis: a hand turns on, a zero does not."""
    assert log.recording.gyro is not None
    made = np.zeros(log.num_rests)
    for k, (a, b) in enumerate(zip(log.start.tolist(), log.stop.tolist(), strict=True)):
        quarters = [x.mean(axis=0) for x in np.array_split(log.recording.gyro[a:b], 4) if len(x)]
        made[k] = np.std(quarters, axis=0, ddof=1).max() / 2.0 if len(quarters) == 4 else 0.0
    return made


def _apart(
    zero: Float[np.ndarray, "rest 3"], force: Float[np.ndarray, "rest 3"]
) -> tuple[Float[np.ndarray, "rest 3"], Bool[np.ndarray, "3"]]:
    """The zero without what goes with the force from rest to rest, and on which axes that is told.

    The change that fits worst has no part in it.
    """
    made, told = zero.copy(), np.zeros(3, bool)
    turned = np.diff(force, axis=0)
    for axis in range(3):
        change = np.diff(zero[:, axis])
        by_force = np.linalg.lstsq(turned, change, rcond=1e-2)[0]
        kept = np.arange(len(change)) != np.argmax(np.abs(change - turned @ by_force))
        by_force = np.linalg.lstsq(turned[kept], change[kept], rcond=1e-2)[0]
        told[axis] = np.linalg.norm(by_force) <= _MOST_BY_FORCE
        if told[axis]:
            made[:, axis] -= force @ by_force
    return made, told


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


def _same_warmth(log: Log, first: int, last: int) -> bool:
    """Whether the probe stays where it was from one rest to another."""
    probe = log.recording.temperature
    if probe is None:
        return True
    rows = slice(log.start[first], log.stop[last])
    return bool(np.ptp(np.quantile(probe[rows, 0], (0.05, 0.95))) < _WARMER)
