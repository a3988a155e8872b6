"""The fit's covariance, part by part: noise within dwells, scatter between them, the rig's positions and rates.

The weighted least squares has the whitened Jacobian J and the covariance P = (JᵀJ)⁻¹ of its coefficients, to which each
source gives its share (`covariance_shares`):

    P_s = P (Σ_dwells Jᵀ share_s J) P,     Σ_s P_s = P.

Where dwells share errors of their positioning or of the table (`procedure.shared_errors`), the whitened rows have the
covariance V = E + U Uᵀ + W Wᵀ; P is (JᵀV⁻¹J)⁻¹, V⁻¹J stands in the place of J, P JᵀV⁻¹U UᵀV⁻¹J P joins the rig's
positions, and the columns of W give as much by the table's level and its axes' right angle. Slow noise (`slow_noise`)
scales what the device gives and adds its own part; misalignments that are held and, of gyros by gravity's turn, the
accelerometers' calibration are what the covariance has beyond its rows.
"""

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..data.recording import Rig
from ..estimators import AbstractEstimator, Invariant
from ..numerics.linear_algebra import scaled_inverse
from ..physics.temperature import Curve
from ..procedure.single_device import Problem
from ..reduction.dwells import Dwells
from .between_dwell_variance import num_judged
from .covariance_shares import (
    given,
    LEVEL as LEVEL,
    NOISE as NOISE,
    OF_THE_DEVICE,
    POSITION as POSITION,
    RATE as RATE,
    SCATTER as SCATTER,
    shares,
)
from .results import TriadResult
from .slow_noise import slow_part, SlowNoise, within


ORTHOGONALITY = "rig orthogonality"
SLOW, HELD, ACCEL = "slow noise", "held misalignments", "accelerometers' calibration"
SAME = 1e-6  # relative; the covariance is recomputed from the same numbers


class Part(NamedTuple):
    """What one source gives to the coefficients."""

    source: str
    degrees: float  # of freedom; inf where it is stated
    covariance: Float[np.ndarray, "unknowns unknowns"]  # row-major (size, parameters)


class Fit(NamedTuple):
    """A triad's least squares, as far as the parts of its covariance depend on it."""

    estimator: AbstractEstimator  # with the scatter between dwells in its weights
    curve: Curve
    covariance: Float[np.ndarray, "unknowns unknowns"]
    dwells: Dwells  # that were fitted, the rig's errors in their covariances
    num_rows: int  # of the misfit
    slow: SlowNoise = SlowNoise()  # within the covariance
    together: bool = False  # with the other triad, whose rows tell of this one, too


def fit_of(result: TriadResult) -> Fit:
    """What `split` needs of a triad's result."""
    solution = result.solution
    return Fit(
        result.estimator,
        solution.curve,
        np.asarray(solution.covariance),
        result.dwells if result.fitted is None else result.fitted,
        int(np.size(result.misfit)),
        result.slow_noise,
        solution.method == "together",
    )


def residual_degrees(fit: Fit) -> int:
    """Rows of the misfit less the unknowns that they determine."""
    unknowns = fit.curve.basis.size * num_judged(fit.estimator, fit.dwells)
    return max(fit.num_rows - unknowns, 0)


def split(fit: Fit, rig: Rig, *, same: float = SAME) -> tuple[Part, ...]:
    """The parts of the fit's covariance; none where both triads were fitted together.

    The scatter between dwells is what the residuals show beyond the dwells' own noise; being a difference, it is known
    with ν (s² / (s² + σ²))² degrees of freedom, ν those of the residuals.

    **Arguments:** `same` is by how much, relative, the parts' sum may differ from the fit's variances.
    """
    if fit.together:
        return ()
    problem = Problem(fit.estimator, fit.curve.basis, fit.dwells)
    coefficients = np.asarray(fit.curve.coefficients)
    jacobian = problem.at(coefficients).jacobian
    beyond = _beyond(fit)
    alone = fit.slow.alike == 0.0 and beyond is None
    covariance = fit.covariance if alone else scaled_inverse(problem.normal(jacobian))
    # V⁻¹J, where dwells share errors; else V is the identity.
    design = problem.weighted(problem.decorrelated(problem.design(jacobian)))
    # What each of the table's errors does to the coefficients; from 3 on, of axes that stand.
    errors = None
    if problem.shared is not None and problem.shared.table is not None:
        signatures = np.asarray(problem.shared.table.whitened).reshape(len(design), -1)
        errors = signatures.T @ design @ covariance
    parts = []
    by_source = shares(fit.estimator, fit.dwells, rig, jacobian.shape[1])
    for source, share in by_source.items():
        own = given(problem, share, design, covariance)
        if source in OF_THE_DEVICE and fit.slow.alike > 0.0:
            part = given(problem, within(problem, share), design, covariance)
            own = own + (fit.slow.own - 1.0) * part
        if source == POSITION and problem.shared is not None:
            if problem.shared.positionings is not None:
                moved = problem.shared.positionings.signatures.T @ design @ covariance
                own = own + moved.T @ moved
            if errors is not None:
                own = own + errors[3:].T @ errors[3:]
        parts.append(Part(source, _degrees(source, fit, share), own))
    if errors is not None:
        for source, which in ((LEVEL, slice(0, 2)), (ORTHOGONALITY, slice(2, 3))):
            parts.append(Part(source, math.inf, errors[which].T @ errors[which]))
    device = within(problem, np.sum([by_source[s] for s in OF_THE_DEVICE], axis=0))
    slow = slow_part(problem, coefficients, covariance, fit.slow, device)
    parts.append(Part(SLOW, float(max(residual_degrees(fit), 1)), slow))
    left = fit.covariance - sum(p.covariance for p in parts)
    off = np.diagonal(left) / np.diagonal(fit.covariance)
    if np.any(off < -same) or (beyond is None and np.any(off > same)):
        return ()
    if beyond is not None:
        parts.append(Part(beyond, math.inf, left))
    return tuple(p for p in parts if np.any(np.diagonal(p.covariance) > 0.0))


def _beyond(fit: Fit) -> str | None:
    """What the covariance has that is not of the fit's own rows."""
    if fit.dwells.motion is not None:
        return ACCEL
    held = isinstance(fit.estimator, Invariant) and not fit.estimator.misalignments
    return HELD if held else None


def _degrees(source: str, fit: Fit, share: Float[np.ndarray, "dwells rows rows"]) -> float:
    if source == NOISE:
        return max(float(np.sum(np.asarray(fit.dwells.count) - 1.0)), 1.0)
    if source == SCATTER:
        part = float(np.mean(np.trace(share, axis1=1, axis2=2))) / share.shape[1]
        return max(residual_degrees(fit), 1) * part**2
    return math.inf
