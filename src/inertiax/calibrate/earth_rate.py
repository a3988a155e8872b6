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
    shown_by_dwells,
    without_earth_rate,
)
from ..reduction.mean_noise import converter_steps
from ..reduction.shown_earth_rate import hidden_by_steps


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


def _is_hidden(dwells: Dwells, campaign: Campaign) -> bool:
    """Whether some recording's gyros are too coarse to tell (`reduction.shown_earth_rate.hidden_by_steps`)."""
    if dwells.rows is None:
        return False
    rows = np.asarray(dwells.rows)[np.asarray(dwells.position) >= 0]
    for number, recording in enumerate(campaign.recordings):
        own = rows[rows[:, 0] == number]
        if recording.gyro is not None and len(own):
            variance = np.array([recording.gyro[a:b].var(axis=0) for _, a, b, _ in own.tolist()])
            if hidden_by_steps(converter_steps(recording.gyro), variance, campaign.site):
                return True
    return False


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
    if shown is not None and shown.absent and _is_hidden(dwells, campaign):
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
