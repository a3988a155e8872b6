"""Logs of increments: velocity and angle gained from sample to sample, as navigation units write them."""

import numpy as np

from .accel_unit import sphere, TriadUnit, unit_of
from .converters import middle, rounded, whole
from .raw_triads import RawTriads
from .resting import Resting


_AGREES = 0.05  # relative, of gravity: an unknown unit is as near by chance once in ten


def as_rates(found: RawTriads, rests: Resting) -> tuple[RawTriads, float | None]:
    """The triads as forces and rates with the step in s; as they are with `None` where they are no increments.

    Gravity g adds g Δt to the velocity in a step Δt: at 200 Hz a device at rest reads 0.049 m/s. Angles go with
    velocities, in the same step.
    """
    if found.accel is None or rests.accel is None or whole(found.accel) or not found.clock.known:
        return found, None
    radius = sphere(rests.accel, middle(found.accel)).radius
    step = float(np.median(np.diff(found.seconds)))
    if not step > 0.0 or unit_of(radius) is not None or unit_of(radius / step, _AGREES) is None:
        return found, None
    gyro = None if found.gyro is None else found.gyro / step
    return found._replace(accel=found.accel / step, gyro=gyro), step


def of_increments(unit: TriadUnit, step: float) -> TriadUnit:
    """The unit of increments over a step (s) whose rates are in `unit`."""
    if unit.scale is not None:
        return unit._replace(certain=False)
    text = f"increments over a step of {rounded(step):g} s: divided by it, {unit.why}"
    return TriadUnit(
        "count",
        rounded(step),
        f"count per {unit.unit}",
        None,
        unit.factor / step,
        text,
        unit.certain,
    )
