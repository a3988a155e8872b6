"""The heading of the Earth's rate in a table's references, against what the gyros read at rest."""

import math

import numpy as np
import scipy.special

from .evidence import DeviceLogs
from .finding import Finding, finding
from .resting_rates import drivers, least_squares, of_device, weights
from .thresholds import Thresholds


def check_azimuth(device: DeviceLogs, limits: Thresholds) -> list[Finding]:
    r"""Whether the horizontal part of the Earth's rate points where the gyros see it.

    At rest a reference is $u\,u^T \omega + h$, with the direction u of the vertical and the horizontal part h. Where
    the station's azimuth is $\delta$ too small, gyros read $\cos\delta\,h + \sin\delta\,u \times h$ in the place of
    h. Both columns are fitted to what the rests' means differ by from their references, beside biases, their course
    from rest to rest and with temperature, and g-sensitivities, which are larger than the Earth's rate in cheap gyros:
    a station that rests in few attitudes is told nothing. Said is what an F test finds rarer than `azimuth_by_chance`,
    where the gyros read about as much of the Earth's rate as there is. An ordinary F test; no source.
    """
    told = of_device(device, limits)
    if told is None:
        return []
    rests, each = told
    size = float(np.median(np.linalg.norm(rests.level, axis=1)))
    weight = weights(rests)
    own = np.kron(drivers(rests, each, limits) * weight, np.eye(3))
    turned = np.stack([np.cross(rests.up, rests.level), rests.level], axis=2)
    design = np.concatenate([own, (turned * weight[..., None]).reshape(-1, 2)], axis=1)
    y = (rests.left * weight).ravel()
    spare = len(y) - design.shape[1]
    if spare < limits.azimuth_spare:
        return _not_told(device, len(rests.up))
    solution, after = least_squares(design, y)
    chance = scipy.special.fdtrc(
        2, spare, (least_squares(own, y)[1] - after) / 2.0 / (after / spare)
    )
    across, along = float(solution[-2]), 1.0 + float(solution[-1])
    angle, share = math.atan2(across, along), math.hypot(across, along)
    covariance = np.linalg.pinv(design.T @ design)[-2:, -2:] * after / spare
    if math.sqrt(float(np.diagonal(covariance).max())) > limits.azimuth_share:
        return _not_told(device, len(rests.up))
    slope = np.array([along, -across]) / share**2
    sigma = math.sqrt(max(float(slope @ covariance @ slope), 0.0))
    sure = chance < limits.azimuth_by_chance and abs(angle) > limits.azimuth_sigmas * sigma
    if not sure or not limits.azimuth_share < share < 1.0 / limits.azimuth_share:
        return []
    off = 2.0 * abs(math.sin(0.5 * angle)) * size
    hours = math.degrees(off) * 3600.0
    stated, right, remedy = "the heading of reference_gyro's Earth rate", "", None
    numbers = {"angle": angle, "std": sigma, "share": share, "rests": len(rests.up)}
    if device.columns.table_angles is not None:
        better = (device.azimuth + math.degrees(angle) + 180.0) % 360.0 - 180.0
        stated, right = "[table] azimuth", f" ({better:.1f} is right)"
        remedy = f"[table]\nazimuth = {better:.1f}"
        numbers["azimuth"] = better
    text = (
        f"{device.logs[0].name}: {stated} is off by {math.degrees(angle):.0f} ± {math.degrees(sigma):.1f}°{right}, as "
        f"the gyros read it in {len(rests.up)} rests; {hours:.1f} °/h of the Earth's rate go into biases."
    )
    return [
        finding(
            "azimuth", "warning", "reference_gyro", text, remedy=remedy, **numbers
        )
    ]  # fmt: skip


def _not_told(device: DeviceLogs, rests: int) -> list[Finding]:
    """A note where the azimuth was to be stated, and the gyros say nothing of it."""
    if device.columns.table_angles is None:
        return []
    text = (
        f"{device.logs[0].name}: the gyros do not tell [table] azimuth ({device.azimuth:g}° is taken): {rests} rests "
        "are too few, in too few attitudes or too short beside their noise."
    )
    return [finding("azimuth", "note", "reference_gyro", text, rests=rests)]
