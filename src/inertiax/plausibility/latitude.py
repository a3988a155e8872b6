"""The Earth's vertical rate in a table's references, against what the gyros read at rest."""

import math

import numpy as np
import scipy.special

from ..physics.wgs84 import EARTH_RATE
from .evidence import DeviceLogs
from .finding import Finding, finding
from .resting_rates import drivers, least_squares, of_device, weights
from .thresholds import Thresholds


DEG_PER_HOUR = math.degrees(1.0) * 3600.0


def check_latitude(device: DeviceLogs, limits: Thresholds) -> list[Finding]:
    r"""Whether the vertical part of the Earth's rate is the one that the gyros see.

    Where the latitude is another, gyros read $x\,u$ beside their references, with the direction u of the vertical. That
    is one number for the three axes; g-sensitivities are nine, and hold it: a D alike on all axes and without terms
    across is the same. It is fitted beside biases, their course, and both parts of the horizontal rate. Said is what an
    F test finds rarer than `latitude_by_chance`, where the other eight of D, which these attitudes must tell, take no
    more than noise does, and some latitude has such a rate. A sensor's own D has no reason to be alike on all axes, so
    the latitude is named first. Ordinary F tests; no source.
    """
    told = of_device(device, limits)
    if told is None or device.site.latitude is None:
        return []
    rests, each = told
    weight = weights(rests)
    plain = np.kron(drivers(rests, each, limits, force=False) * weight, np.eye(3))
    level = np.stack([np.cross(rests.up, rests.level), rests.level], axis=2) * weight[..., None]
    own = np.concatenate([plain, level.reshape(-1, 2)], axis=1)
    vertical = np.concatenate([own, (rests.up * weight).reshape(-1, 1)], axis=1)
    whole = np.concatenate([own, np.kron(rests.up * weight, np.eye(3))], axis=1)
    y = (rests.left * weight).ravel()
    spare = len(y) - whole.shape[1]
    size = np.linalg.norm(whole, axis=0)
    unit = whole / np.where(size > 0.0, size, 1.0)
    if spare < limits.azimuth_spare or np.linalg.matrix_rank(unit) < whole.shape[1]:
        return []
    solution, left = least_squares(vertical, y)
    least = least_squares(whole, y)[1]
    by_chance = scipy.special.fdtrc(
        1, spare + 8, (least_squares(own, y)[1] - left) / (left / (spare + 8))
    )
    across = scipy.special.fdtrc(8, spare, (left - least) / 8.0 / max(least / spare, 1e-300))
    noise = left / (spare + 8)
    sigma = math.sqrt(float(np.linalg.pinv(vertical.T @ vertical)[-1, -1]) * noise) / EARTH_RATE
    each_of_d = np.sqrt(np.diagonal(np.linalg.pinv(whole.T @ whole))[-9:] * noise) / EARTH_RATE
    more = float(solution[-1]) / EARTH_RATE
    stated = float(np.median(np.sum(rests.rate * rests.up, axis=1))) / EARTH_RATE
    seen = stated + more
    told_by_attitudes = each_of_d.max() < limits.latitude_across * abs(more)
    if by_chance > limits.latitude_by_chance or across < limits.latitude_by_others:
        return []
    if not told_by_attitudes or abs(more) < limits.latitude_off:
        return []
    if abs(seen) > 1.0 + limits.azimuth_sigmas * sigma:  # no latitude has that
        return []
    angle = math.degrees(math.asin(max(-1.0, min(1.0, seen))))
    slope = math.sqrt(max(1.0 - seen**2, sigma))  # near the poles the latitude hardly tells in it
    std = math.degrees(sigma / slope)
    given = math.degrees(device.site.latitude)
    mirrored = abs(seen + math.sin(device.site.latitude)) < limits.azimuth_sigmas * sigma
    nothing = abs(seen) < limits.azimuth_sigmas * sigma and float(solution[-2]) < -0.5
    what = (
        "nothing of the Earth's rate that the references hold"
        if nothing
        else f"the Earth's vertical rate as at latitude {angle:+.1f} ± {std:.1f}°"
    )
    text = (
        f"{device.logs[0].name}: the gyros at rest read {what}; [site] latitude says {given:+.4g}°. A g-sensitivity of "
        f"{more * EARTH_RATE * DEG_PER_HOUR:+.1f} °/h/g alike on all axes would look the same, so that "
        "g_sensitivity = true takes an error of the latitude in and is no cure for it."
    )
    return [
        finding(
            "latitude", "warning", "reference_gyro", text,
            remedy=f"[site]\nlatitude = {-given:.6g}" if mirrored and not nothing else None,
            latitude=angle, std=std, vertical=more * EARTH_RATE, rests=len(rests.up),
        )
    ]  # fmt: skip
