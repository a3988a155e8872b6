"""What each source of uncertainty gives to a triad's parameters at given temperatures.

The fit's parts come from the record. Four sources are known in closed form from the calibration itself, to first
order in their 1 sigma:

    probe offset σ_T      u = σ_T |dθ/dT|                 every parameter
    probe steps σ_s       u = σ_s |dθ/dT|                 every parameter
    rig rate ρ            u = ρ |(E + Θ)ᵢⱼ|                the gyros' matrix
    reference g, σ_g      u = (σ_g / g) |(E + Γ)ᵢⱼ|        the accelerometers' matrix

The rate's and g's errors are common to all positions, so that no number of them averages them. A fit that was not taken
apart has the rate's error inside, drawn anew for each rate; the common one comes on top, which is never too little.
"""

import math
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._typing import AnyArray
from ..calibrate.split_covariance import RATE
from ..calibration.calibration import TriadCalibration
from ..calibration.probe_error import probe_covariance
from ..physics.temperature import AbstractBasis
from .record import StationRecord, TriadRecord


FIT, PROBE, STEPS, GRAVITY = "fit", "probe offset", "probe steps", "reference g"
# Estimators that compare with g, so that its error is a common scale factor.
BY_GRAVITY = ("invariant", "reference")


class Contribution(NamedTuple):
    """One source at several temperatures."""

    source: str
    degrees: float  # of freedom; inf where it is stated
    std: Float[np.ndarray, "temperatures parameters"]  # SI


def contributions(
    triad: TriadCalibration,
    record: TriadRecord,
    station: StationRecord,
    gravity_uncertainty: float | None,
    temperatures: Float[np.ndarray, " temperatures"],
) -> tuple[Contribution, ...]:
    """Every source's standard uncertainty of the triad's parameters; the sources are independent.

    **Arguments:** `gravity_uncertainty` is 1 sigma of the stated g, m/s², `None` where nobody states it.
    """
    phi = np.asarray(_basis_values(triad.curve.basis, temperatures))
    size, count = phi.shape[1], len(triad.names)

    def at(covariance: Float[np.ndarray, "unknowns unknowns"]) -> np.ndarray:
        blocks = covariance.reshape(size, count, size, count)
        return np.sqrt(np.maximum(np.einsum("ta,aibi,tb->ti", phi, blocks, phi), 0.0))

    of_probe = {PROBE: station.temperature_uncertainty or 0.0, STEPS: record.hidden_by_steps}
    probe = {
        source: probe_covariance(triad.curve.coefficients, triad.curve.basis, sigma)
        for source, sigma in of_probe.items()
    }
    found = [
        Contribution(s.source, math.inf if s.degrees_of_freedom is None else s.degrees_of_freedom,
                     at(symmetric(s.covariance)))
        for s in record.sources
        if s.source != RATE
    ]  # fmt: skip
    if not record.sources:
        rest = np.asarray(triad.covariance, float) - sum(probe.values())
        found.append(Contribution(FIT, max(float(record.degrees_of_freedom), 1.0), at(rest)))
    found += [Contribution(s, math.inf, at(c)) for s, c in probe.items() if np.any(c)]
    for source, relative in _common_scale(triad, record, station, gravity_uncertainty):
        values = phi @ np.asarray(triad.curve.coefficients)
        slope = values + np.array([float(_on_diagonal(n)) for n in triad.names])
        scaled = np.array([".matrix" in n for n in triad.names])
        found.append(Contribution(source, math.inf, np.abs(relative * slope * scaled)))
    return tuple(found)


def _common_scale(
    triad: TriadCalibration,
    record: TriadRecord,
    station: StationRecord,
    gravity_uncertainty: float | None,
) -> list[tuple[str, float]]:
    """Sources that scale all inputs alike, with their relative 1 sigma."""
    if triad.names[0].startswith("accel"):
        if gravity_uncertainty is None or triad.estimator not in BY_GRAVITY:
            return []
        return [(GRAVITY, gravity_uncertainty / station.gravity)]
    rate = station.rate_uncertainty
    if rate is None or triad.estimator != "reference":
        return []
    return [(RATE, rate)]


def symmetric(lower: tuple[float, ...]) -> Float[np.ndarray, "n n"]:
    """The matrix of a lower triangle by rows."""
    size = int(round(0.5 * (math.sqrt(8 * len(lower) + 1) - 1)))
    full = np.zeros((size, size))
    i, j = np.tril_indices(size)
    full[i, j] = full[j, i] = lower
    return full


def _on_diagonal(name: str) -> bool:
    return ".matrix[" in name and name[-4] == name[-2]


@eqx.filter_jit
def _basis_values(
    basis: AbstractBasis, temperatures: Float[AnyArray, " n"]
) -> Float[Array, "n size"]:
    return jax.vmap(basis)(jnp.asarray(temperatures))
