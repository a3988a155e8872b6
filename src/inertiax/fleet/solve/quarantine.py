"""Which devices of a fleet are set aside, and why, in one line each: those that `calibrate` calls unusable."""

import numpy as np
from jaxtyping import Float

from ..._typing import AnyArray
from ...calibrate.goodness_of_fit import (
    grade_matrix,
    grade_misfit,
    grade_parameters,
    LIMITS,
    matrix_mistakes,
    misfit_words,
    UNUSABLE,
    usual_size,
)
from ...estimators import AbstractEstimator
from ...model_selection.temperature_degree import separate_temperatures
from ...physics.temperature import AbstractBasis
from ..reduce.blocks import means_of_runs
from .batch import FleetFit


_UNITS = {"accel": "m/s^2", "gyro": "rad/s"}


def judge(
    estimator: AbstractEstimator,
    basis: AbstractBasis,
    fit: FleetFit,
    temperature: Float[AnyArray, "devices dwells"],
    *,
    alone: bool = True,
) -> tuple[str | None, ...]:
    """For each device `None`, or the reason why its estimate cannot be used.

    **Arguments:** `temperature` of the dwells, °C; `alone`: the device's own rows must determine all unknowns, for want
    of a prior.
    """
    sigma = np.sqrt(np.diagonal(fit.covariance, axis1=1, axis2=2))
    worst = sigma.reshape(len(sigma), basis.size, -1).max(axis=1)
    rows = fit.valid.sum(axis=1) * fit.misfit.shape[2]
    rms = rms_misfit(fit)
    grades = grade_parameters(estimator.names, np.zeros_like(worst), worst)
    good = fit.converged & np.all(grades < UNUSABLE, axis=1)
    values = _in_the_middle(basis, fit, temperature)
    good &= grade_matrix(estimator.names, values) < UNUSABLE
    good &= grade_misfit(_UNITS[estimator.triad], rms, np.sqrt(fit.chi2_per_dof)) < UNUSABLE
    if alone:
        good &= rows >= basis.size * estimator.num_parameters
    reasons: list[str | None] = [None] * len(good)
    for k in np.flatnonzero(~good):
        mine = np.asarray(temperature)[k][fit.valid[k]]
        few = _too_few_temperatures(estimator.triad, basis, mine) if alone else None
        cure = _cure(basis, mine)
        said = _reason(
            estimator, basis, fit, worst[k], values[k], float(rms[k]), int(k), alone, cure
        )
        reasons[k] = said if few is None or rows[k] < basis.size * estimator.num_parameters else few
    return tuple(reasons)


def _in_the_middle(
    basis: AbstractBasis, fit: FleetFit, temperature: Float[AnyArray, "devices dwells"]
) -> Float[np.ndarray, "devices parameters"]:
    """Each device's parameters in the middle of its own temperatures, as `calibrate` judges them."""
    probe = np.asarray(temperature, float)
    probe = np.where(fit.valid.any(axis=1, keepdims=True), probe, 0.0)
    kept = fit.valid | ~fit.valid.any(axis=1, keepdims=True)
    low = np.where(kept, probe, np.inf).min(axis=1)
    high = np.where(kept, probe, -np.inf).max(axis=1)
    phi = basis.rows(0.5 * (low + high))
    coefficients = fit.parameters.reshape(len(fit.parameters), basis.size, -1)
    return np.einsum("da,dap->dp", phi, coefficients)


def _too_few_temperatures(
    triad: str, basis: AbstractBasis, temperature: Float[np.ndarray, " dwells"]
) -> str | None:
    """In words that a device's temperatures do not determine polynomials of the basis' degree; `None` where they do."""
    if basis.size == 1 or not len(temperature):
        return None
    levels = separate_temperatures(temperature)
    if len(levels) >= basis.size:
        return None
    shown = ", ".join(f"{t:.4g}" for t in levels)
    noun = "temperature" + ("s" if len(levels) > 1 else "")
    return (
        f"{triad}: {len(levels)} {noun} ({shown} °C) cannot determine polynomials of degree {basis.size - 1}, which "
        f"need {basis.size} that lie apart; record the missing ones, or take a lower degree"
    )


def _cure(basis: AbstractBasis, temperature: Float[np.ndarray, " dwells"]) -> str:
    """What to record of a device with an uncertain parameter: what its temperatures leave out comes first."""
    ordered = np.sort(temperature)
    gaps = np.diff(ordered)
    if basis.size == 1 or not len(gaps) or gaps.max() <= LIMITS.temperature_gap * gaps.sum():
        return "record more positions"
    at = int(np.argmax(gaps))
    between = f"{ordered[at]:.0f} and {ordered[at + 1]:.0f} °C"
    return f"record temperatures between {between}, of which there are none, or more positions"


def rms_misfit(fit: FleetFit) -> Float[np.ndarray, " devices"]:
    """Root mean square of each device's misfit, without padding, SI; NaN for a device without dwells."""
    kept = np.broadcast_to(fit.valid[:, :, None], fit.misfit.shape)
    counts = kept.sum(axis=(1, 2))
    return np.sqrt(means_of_runs(np.square(fit.misfit[kept]), counts))


def _reason(
    estimator: AbstractEstimator,
    basis: AbstractBasis,
    fit: FleetFit,
    sigma: Float[np.ndarray, " parameters"],
    values: Float[np.ndarray, " parameters"],
    rms: float,
    k: int,
    alone: bool,
    cure: str,
) -> str | None:
    triad, dwells = estimator.triad, int(fit.valid[k].sum())
    unknowns = basis.size * estimator.num_parameters
    rows = dwells * fit.misfit.shape[2]
    if alone and rows < unknowns:
        return f"{triad}: too few positions: {dwells} dwells give {rows} equations for {unknowns} unknowns"
    if not np.all(np.isfinite(sigma)):
        # A solve that went astray ends anywhere, so its covariance alone does not tell why.
        astray = (
            ""
            if fit.converged[k]
            else ", or their values are in wrong units and no solve converges"
        )
        return (
            f"{triad}: the positions of {dwells} dwells do not determine all {unknowns} parameters{astray}; "
            "record more positions in different orientations"
        )
    if not fit.converged[k]:
        return (
            f"{triad}: no convergence after {int(fit.num_steps[k])} steps; look for wrong units, a "
            "saturated axis or rests that are not at rest"
        )
    mistakes = matrix_mistakes(estimator.names, values, sigma)
    if mistakes:
        return f"{triad}: {mistakes[0][1].removesuffix('.')}"
    unit, ratio = _UNITS[triad], float(np.sqrt(fit.chi2_per_dof[k]))
    if grade_misfit(unit, rms, ratio) == UNUSABLE:
        return f"{triad}: {misfit_words(unit, rms, ratio, float(fit.scatter[k]))}"
    for name, worst in zip(estimator.names, sigma.tolist(), strict=True):
        if worst > usual_size(name):
            return f"{triad}: {name} is uncertain by {worst:.2g} (1 sigma; limit {usual_size(name):g}): {cure}"
    return None
