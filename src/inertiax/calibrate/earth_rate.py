"""Earth's rate in the gyros' biases where no reference holds it: the uncertainty that the heading leaves, and words."""

import dataclasses
import math

import numpy as np
from jaxtyping import Float

from ..calibration.calibration import TriadCalibration
from ..calibration.quantities import DEG_PER_HOUR
from ..data.recording import Campaign, Site
from ..physics.wgs84 import EARTH_RATE
from ..reduction.dwells import Dwells
from ..reduction.earth_at_rest import (
    horizontal_covariance,
    is_known,
    rounding_hides_earth,
    shown_by_dwells,
    without_earth_rate,
)


HEADING = "Earth's rate, heading unknown"  # as a source of uncertainty


def with_earth_rate(
    triad: TriadCalibration | None, dwells: Dwells, site: Site
) -> TriadCalibration | None:
    """The gyros with what the unknown heading gives to their biases' covariance, alike at all temperatures."""
    if triad is None or not is_known(dwells, site):
        return triad
    return dataclasses.replace(
        triad, covariance=np.asarray(triad.covariance) + heading_covariance(triad, dwells, site)
    )


def heading_covariance(
    triad: TriadCalibration, dwells: Dwells, site: Site
) -> Float[np.ndarray, "unknowns unknowns"]:
    """What the unknown heading gives to the covariance of the coefficients: to the biases' constants alone.

    The first function of every basis is 1, and coefficients are counted row by row.
    """
    made = np.zeros(np.shape(triad.covariance))
    biases = [triad.names.index(f"gyro.bias[{i}]") for i in range(3)]
    made[np.ix_(biases, biases)] = horizontal_covariance(dwells, site)
    return made


def earth_taken_away(dwells: Dwells, campaign: Campaign) -> tuple[Dwells, tuple[str, ...]]:
    """The dwells without what is known of Earth's rate, and what became of it."""
    return without_earth_rate(dwells, campaign), _words(dwells, campaign)


def _words(dwells: Dwells, campaign: Campaign) -> tuple[str, ...]:
    """What becomes of Earth's rate in dwells as recorded; nothing where a reference holds it."""
    site = campaign.site
    if dwells.gyro is None or dwells.reference_gyro is not None:
        return ()
    whole = DEG_PER_HOUR * EARTH_RATE
    if site.latitude is None or not is_known(dwells, site):
        cure = "; [site] latitude takes its vertical part away" if dwells.accel is not None else ""
        return (f"gyros: Earth's rate, up to {whole:.1f} °/h, is part of the biases{cure}",)
    up, level = math.sin(site.latitude), math.cos(site.latitude)
    shown = shown_by_dwells(dwells, site)
    if (
        shown is not None
        and shown.absent
        and rounding_hides_earth(dwells, campaign.recordings, site)
    ):
        return (
            f"gyros: the converter's step hides Earth's rate, {whole * up:.1f} °/h along the vertical by the latitude; "
            "none is taken away",
        )
    if shown is not None and shown.absent:
        return (
            f"gyros: Earth's rate, {whole * up:.1f} °/h along the vertical by the latitude, is not in them: rests show "
            f"{shown.part:.2f} ± {shown.std:.2f} of it, and none is taken away",
        )
    sigma = DEG_PER_HOUR * np.sqrt(np.diagonal(horizontal_covariance(dwells, site)).max())
    return (
        f"gyros: Earth's rate along the vertical, {whole * up:.1f} °/h by the latitude, is taken away from the rests; "
        f"along the horizontal, {whole * level:.1f} °/h in an unknown heading, it is in the biases' uncertainty "
        f"(up to {sigma:.1f} °/h, 1 sigma)",
    )
