"""[site] gravity against the latitude: normal gravity of the ellipsoid, between the Dead Sea and the highest roads."""

import math

from .evidence import DeviceLogs
from .finding import Finding, finding
from .thresholds import Thresholds


_GRADIENT = 3.086e-6  # 1/s², free air
_LOWEST, _HIGHEST = -500.0, 6000.0  # m
_ANOMALY = 2e-3  # m/s², the largest free-air anomalies where people live


def normal_gravity(latitude: float) -> float:
    """Normal gravity on the ellipsoid, m/s², by Somigliana's formula with the constants of GRS 80.

    **Arguments:** `latitude` in rad, geodetic.

    **Reference:** Moritz, Geodetic Reference System 1980, Bull. Géod. 54 (1980).
    """
    s = math.sin(latitude) ** 2
    return 9.7803267715 * (1 + 0.001931851353 * s) / math.sqrt(1 - 0.0066943800229 * s)


def check_gravity(device: DeviceLogs, limits: Thresholds) -> list[Finding]:
    """Gravity that the stated latitude does not have at any height."""
    del limits
    site = device.site
    if site.latitude is None:
        return []
    normal = normal_gravity(site.latitude)
    low, high = normal - _GRADIENT * _HIGHEST - _ANOMALY, normal - _GRADIENT * _LOWEST + _ANOMALY
    if low <= site.gravity <= high:
        return []
    return [
        finding(
            "gravity",
            "warning",
            "site",
            f"[site] gravity = {site.gravity:.6g} m/s² does not belong to latitude {math.degrees(site.latitude):.4g}°: "
            f"there it is between {low:.5g} (at {_HIGHEST:.0f} m) and {high:.5g}; {normal:.6g} at sea level.",
            gravity=site.gravity,
            normal=normal,
        )
    ]
