"""What a table wrote beside the outputs: references, their units, and the label that it has while it moves."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from ..data.formats.columns import ACCEL_UNITS, GYRO_UNITS
from .raw_log import RawLog


_STANDARD = 9.80665  # m/s²
_NEAR = 0.05  # of gravity, and of the outputs: a table's reference is no farther from an IMU's raw reading
_SAME = 1e-5  # of gravity: what digits of a reference leave
_TURNING = 0.3  # of the fastest rate, from which rows tell the unit
_MOVING = 0.05  # part of a label's rows in which the table moves; of a position it is next to none
_MOST_LABELS = 3  # that a station writes while it moves


class ReferenceUnit(NamedTuple):
    """The unit of a reference, `None` where it does not show, and why."""

    unit: str | None
    why: str
    gravity: float | None = None  # m/s², where one norm is that of all rows


def force_unit(reference: Float[np.ndarray, "rows 3"]) -> ReferenceUnit:
    """By the norm that it has wherever it is not zero, which is gravity's."""
    size = _sizes(reference)
    if not len(size):
        return ReferenceUnit(None, "it is zero throughout")
    norm = float(np.median(size))
    for unit in ("m/s^2", "g", "mg"):
        if abs(norm * ACCEL_UNITS[unit] / _STANDARD - 1.0) < _NEAR:
            same = np.quantile(np.abs(size / norm - 1.0), 0.99) < _SAME
            gravity = round(norm * ACCEL_UNITS[unit], 6) if same else None
            return ReferenceUnit(unit, f"its norm is {norm:.4g}", gravity)
    return ReferenceUnit(None, f"its norm is {norm:.4g}, gravity in no unit")


def rate_unit(
    reference: Float[np.ndarray, "rows 3"],
    output: Float[np.ndarray, "rows 3"] | None,
    factor: float,
) -> ReferenceUnit:
    """By the outputs while it turns; `factor` makes rad/s of them."""
    if output is None:
        return ReferenceUnit(None, "there are no gyros beside it")
    size = np.linalg.norm(reference, axis=1)
    fast = np.isfinite(size) & np.isfinite(output).all(axis=1) & (size > 0.0)
    fast &= size > _TURNING * np.max(size[fast], initial=0.0)
    if not fast.any():
        return ReferenceUnit(None, "it is zero throughout")
    ratio = float(np.median(np.linalg.norm(output[fast], axis=1) / size[fast]))
    for unit in ("rad/s", "deg/s", "deg/h"):
        times = ratio * factor / GYRO_UNITS[unit]
        if abs(times - 1.0) < _NEAR:
            return ReferenceUnit(unit, f"the gyros read {times:.4g} times its rate while it turns")
    return ReferenceUnit(None, f"the gyros are {ratio:.4g} times its numbers while it turns")


def _sizes(reference: Float[np.ndarray, "rows 3"]) -> Float[np.ndarray, " told"]:
    size = np.linalg.norm(reference, axis=1)
    return size[np.isfinite(size) & (size > 0.0)]


def labels_of_positions(
    log: RawLog, force: Float[np.ndarray, "rows 3"], taken: set[str]
) -> str | None:
    """The column of whole numbers that has one label exactly where the reference tells no force; `None` without one."""
    told = np.any(np.nan_to_num(force) != 0.0, axis=1)
    if told.all() or not told.any():
        return None
    for name, values in log.numbers.items():
        if name in taken or not np.all(values == np.round(values)):
            continue
        moving = np.unique(values[~told])
        if len(moving) == 1 and moving[0] not in values[told] and np.ptp(values[told]) > 0:
            return name
    return None


def labels_while_moving(
    labels: Float[np.ndarray, " rows"], moving: Bool[np.ndarray, " rows"]
) -> list[int]:
    """Labels that rows have while a table moves, and that no position is; empty where rates are numbered, too."""
    seen, place = np.unique(labels, return_inverse=True)
    share = np.bincount(place, moving) / np.bincount(place)
    found = seen[share > _MOVING]
    if not np.all(np.isfinite(found)) or len(found) > _MOST_LABELS:
        return []
    return [int(k) for k in found if k >= 0 and k == round(k)]


def moving_labels(log: RawLog, position: str, force: Float[np.ndarray, "rows 3"]) -> list[int]:
    """Labels with which the reference never tells a force: those of a table that moves."""
    labels = log.numbers[position]
    told = np.any(np.nan_to_num(force) != 0.0, axis=1)
    never = np.setdiff1d(labels[~told], labels[told])
    if not np.all(np.isfinite(never)) or len(never) > _MOST_LABELS:
        return []
    return [int(k) for k in never if k >= 0 and k == round(k)]
