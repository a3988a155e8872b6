"""Devices of a fleet whose means cannot be right: unit, dead channels, temperature.

The cheap part of `plausibility`, on means over dwells, for thousands of devices at once.
"""

import numpy as np
from jaxtyping import Bool, Float, Int

from ...plausibility.thresholds import DEFAULT
from ...reduction.dwells import Dwells


_GRAVITY = 9.80665  # m/s²; units are told apart by factors, not by the place


def implausible_devices(
    first: Int[np.ndarray, " device"], counts: Int[np.ndarray, " device"], dwells: Dwells
) -> list[str]:
    """For each device in words why its data cannot be right; empty where nothing tells so.

    **Arguments:** `first` and `counts` say which dwells are whose.
    """
    reasons = [""] * len(first)
    for k in np.flatnonzero(~_plain(first, dwells)):
        mine = slice(int(first[k]), int(first[k] + counts[k]))
        reasons[k] = _temperature(np.asarray(dwells.temperature)[mine]) or _triads(dwells, mine)
    return reasons


def _plain(first: Int[np.ndarray, " device"], dwells: Dwells) -> Bool[np.ndarray, " device"]:
    """Devices that are right at first sight: each mean is, and no channel stands still.

    All at once, since one by one they take as long as reading them.
    """
    degrees = np.asarray(dwells.temperature)
    good = (degrees >= DEFAULT.coldest) & (degrees <= DEFAULT.kelvin)
    dead = np.zeros(len(first), bool)
    for values, lowest, highest in (
        (dwells.accel, _GRAVITY / DEFAULT.accel_ratio_error, _GRAVITY * DEFAULT.accel_ratio_error),
        (dwells.gyro, -np.inf, DEFAULT.resting_rate),
    ):
        if values is None:
            continue
        own = np.asarray(values)
        size = np.linalg.norm(own, axis=1)
        good &= (size > lowest) & (size < highest)
        dead |= np.any(np.maximum.reduceat(own, first) == np.minimum.reduceat(own, first), axis=1)
    return np.logical_and.reduceat(good, first) & ~dead


def _temperature(degrees: Float[np.ndarray, " dwell"]) -> str:
    low, high = float(degrees.min()), float(degrees.max())
    span = f"the temperature goes from {low:.4g} to {high:.4g} °C"
    if low < DEFAULT.coldest or high > DEFAULT.kelvin + 210.0:
        return f"{span}, where no inertial sensor works: raw counts, or another unit"
    if low > DEFAULT.kelvin:
        return f"{span}, hotter than any inertial sensor works: likely kelvin"
    return ""


def _triads(dwells: Dwells, mine: slice) -> str:
    if dwells.accel is not None:
        accel = np.linalg.norm(np.asarray(dwells.accel)[mine], axis=1)
        ratio = float(np.median(accel)) / _GRAVITY
        if not 1 / DEFAULT.accel_ratio_error < ratio < DEFAULT.accel_ratio_error:
            return f"accel has a norm of {ratio:.3g} times gravity at rest: look at its unit"
    if dwells.gyro is not None:
        gyro = np.asarray(dwells.gyro)[mine]
        still = float(np.median(np.linalg.norm(gyro, axis=1)))
        if still > DEFAULT.resting_rate:
            return f"gyro has a norm of {still:.3g} rad/s at rest: raw counts, or another unit"
    return _dead(dwells, mine, "accel") or _dead(dwells, mine, "gyro")


def _dead(dwells: Dwells, mine: slice, triad: str) -> str:
    """In words which channel has one value in all samples of all rests, beside channels that live."""
    values, covariance = getattr(dwells, triad), getattr(dwells, f"{triad}_covariance")
    if values is None or covariance is None:
        return ""
    own, noise = np.asarray(values)[mine], np.asarray(covariance)[mine]
    still = (np.ptp(own, axis=0) == 0) & ~np.diagonal(noise, axis1=1, axis2=2).any(axis=0)
    others = [x for x in (dwells.accel, dwells.gyro) if x is not None]
    lives = any(np.all(np.ptp(np.asarray(x)[mine], axis=0) > 0) for x in others)
    if len(own) < 2 or not still.any() or not (lives or not still.all()):
        return ""
    if still.all():
        return f"{triad}_x, _y and _z never change ({own[0, 0]:.4g}): nothing was measured"
    (axis, *_) = np.flatnonzero(still)
    noisy = np.diagonal(noise, axis1=1, axis2=2)[:, ~still].all()
    told = f"{triad}_{'xyz'[axis]} never changes ({own[0, axis]:.4g}): the channel is dead"
    return told if noisy else ""
