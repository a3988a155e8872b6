"""Scatter between dwells: what differs from one to the next beyond each one's own noise."""

from typing import TypeAlias

import numpy as np
from jaxtyping import Bool, Float

from .._jax import eqx
from ..estimators import AbstractEstimator, NOMINAL_SIGMA
from ..numerics.paule_mandel import excess_deviation, widened
from ..reduction.dwells import Dwells


_Rows: TypeAlias = Float[np.ndarray, "dwells rows"]

# m/s², rad/s or rad: rounding leaves less, every sensor more. A solve weighted by rounding could never
# converge to a part of it.
_EXACT = 1e-10


def judged(dwells: Dwells) -> Bool[np.ndarray, " dwell"]:
    """Dwells that have a misfit: all, or those that a motion led to."""
    return np.asarray(dwells.valid if dwells.motion is None else dwells.motion.valid)


def num_judged(estimator: AbstractEstimator, dwells: Dwells) -> int:
    """Parameters that take degrees of freedom from the misfit.

    With motions these are the matrix's alone: rests tell bias and g-sensitivity far better.
    """
    if dwells.motion is None:
        return estimator.num_parameters
    return sum(".matrix" in name for name in estimator.names)


def with_provisional_scatter(estimator: AbstractEstimator, dwells: Dwells) -> AbstractEstimator:
    """Equal weights for a start where some dwell has no noise figure of its own."""
    covariance = np.asarray(getattr(dwells, f"{estimator.triad}_covariance"))
    if np.all(np.trace(covariance, axis1=-2, axis2=-1) > _EXACT**2):
        return estimator
    return eqx.tree_at(lambda e: e.scatter, estimator, np.asarray(NOMINAL_SIGMA))


def with_scatter(
    estimator: AbstractEstimator, misfit: _Rows, sigma: _Rows, unknowns: int
) -> AbstractEstimator:
    """Scatter between dwells by Paule and Mandel with the `widened` degrees of freedom; none where χ² is below them.

    No test decides whether there is any: what passes a test at 1 % is a χ² of up to twice its expectation with 15
    degrees of freedom, and intervals of 95 % then held 88 to 91 %.
    """
    dof = misfit.size - unknowns
    given_up = misfit.size - widened(float(dof)) if dof > 0 else misfit.size
    scatter = excess_deviation(misfit.ravel(), sigma.ravel(), given_up)
    if float(scatter) < _EXACT and not np.all(sigma > _EXACT):
        return estimator  # exact data without a noise figure: keep the provisional weights
    return eqx.tree_at(lambda e: e.scatter, estimator, np.asarray(float(scatter)))


def noise_is_untold(dwells: Dwells, dof: int) -> bool:
    """Whether neither samples tell the noise of a recording's means, each of one row, nor a misfit what they err by."""
    return dof <= 0 and dwells.rows is not None and bool(np.all(np.asarray(dwells.count) <= 1.0))


def chi2_per_dof(misfit: _Rows, sigma: _Rows, unknowns: int) -> float:
    """χ² of a misfit over its degrees of freedom; NaN where the noise is unknown or none are left."""
    dof = misfit.size - unknowns
    if dof <= 0 or not np.all(sigma > _EXACT):
        return float("nan")
    return float(np.sum(np.square(misfit / sigma)) / dof)
