"""The fit's covariance, part by part: noise within dwells, scatter between them, the rig's positions and rates.

The weighted least squares has the whitened Jacobian J and the covariance P = (JᵀJ)⁻¹ of its coefficients. Where a
dwell's covariance is a sum Σ = Σ₁ + Σ₂ + …, whitened by L Lᵀ = Σ, each part passes into the coefficients by

    P_s = P (Σ_dwells Jᵀ L⁻¹ Σ_s L⁻ᵀ J) P,     Σ_s P_s = P.

Where dwells share errors of their positioning (`procedure.shared_errors`), the whitened rows have the covariance
V = E + U Uᵀ; P is (JᵀV⁻¹J)⁻¹, V⁻¹J stands in the place of J, and P JᵀV⁻¹U UᵀV⁻¹J P joins the rig's positions.
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
from ..reduction.rig_errors import rig_covariance
from .between_dwell_variance import num_judged
from .results import TriadResult
from .slow_noise import slow_part, SlowNoise


NOISE, SCATTER, POSITION, RATE = "dwell noise", "re-positioning", "rig position", "rig rate"
SLOW, HELD = "slow noise", "held misalignments"
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
    dwells: Dwells  # that have a misfit, the rig's errors in their covariances
    num_rows: int  # of the misfit
    slow: SlowNoise = SlowNoise()  # within the covariance


def fit_of(result: TriadResult) -> Fit:
    """What `split` needs of a triad's result."""
    solution = result.solution
    covariance = np.asarray(solution.covariance)
    rows = int(np.size(result.misfit))
    return Fit(result.estimator, solution.curve, covariance, result.dwells, rows, result.slow_noise)


def residual_degrees(fit: Fit) -> int:
    """Rows of the misfit less the unknowns that they determine."""
    unknowns = fit.curve.basis.size * num_judged(fit.estimator, fit.dwells)
    return max(fit.num_rows - unknowns, 0)


def split(fit: Fit, rig: Rig, *, same: float = SAME) -> tuple[Part, ...]:
    """The parts of the fit's covariance; none where it is not that of the triad's own rows alone.

    That is so where both triads were fitted together, and where motions between rests count. The scatter between
    dwells is what the residuals show beyond the dwells' own noise; being a difference, it is known with
    ν (s² / (s² + σ²))² degrees of freedom, ν those of the residuals.

    **Arguments:** `same` is by how much, relative, the parts' sum may differ from the fit's variances.
    """
    if fit.dwells.motion is not None:
        return ()
    problem = Problem(fit.estimator, fit.curve.basis, fit.dwells)
    jacobian = problem.at(fit.curve.coefficients).jacobian
    covariance = fit.covariance
    slow = np.zeros_like(covariance)
    held = isinstance(fit.estimator, Invariant) and not fit.estimator.misalignments
    if fit.slow.alike > 0.0 or held:
        covariance = scaled_inverse(problem.normal(jacobian))
        slow = slow_part(problem, np.asarray(fit.curve.coefficients), covariance, fit.slow)
    again = fit.slow.own * (covariance @ problem.normal(jacobian) @ covariance) + slow
    beyond = fit.covariance - again  # what `held_misalignments` adds
    if not held and not np.allclose(
        np.diagonal(again), np.diagonal(fit.covariance), rtol=same, atol=0.0
    ):
        return ()
    shares = _shares(fit, rig, jacobian.shape[1])
    # V⁻¹J, where dwells share errors; else V is the identity.
    design = problem.decorrelated(problem.decorrelated(problem.design(jacobian)))
    by_dwell, parts = design.reshape(*jacobian.shape[:2], -1), []
    for source, share in shares.items():
        moved = np.einsum("nsr,nru->nsu", _root(share), by_dwell).reshape(-1, len(covariance))
        inner = moved.T @ moved
        if source == POSITION and problem.shared is not None:
            together = problem.shared.signatures.T @ design
            inner = inner + together.T @ together
        own = fit.slow.own * (covariance @ inner @ covariance)
        parts.append(Part(source, _degrees(source, fit, share), 0.5 * (own + own.T)))
    parts.append(Part(SLOW, float(max(residual_degrees(fit), 1)), slow))
    parts.append(Part(HELD, np.inf, beyond if held else np.zeros_like(beyond)))
    return tuple(p for p in parts if np.any(np.diagonal(p.covariance) > 0.0))


def _shares(fit: Fit, rig: Rig, rows: int) -> dict[str, Float[np.ndarray, "dwells rows rows"]]:
    """Each source's covariance of a dwell's rows, whitened with all of them: together they are the identity."""
    triad, dwells = fit.estimator.triad, fit.dwells
    given = np.asarray(getattr(dwells, f"{triad}_covariance"), float)
    variance = float(np.asarray(fit.estimator.scatter)) ** 2
    parts = {NOISE: given, SCATTER: np.broadcast_to(variance * np.eye(3), given.shape)}
    reference = getattr(dwells, f"reference_{triad}")
    if reference is not None:
        u = np.asarray(reference, float)
        angle = rig.position_uncertainty or 0.0
        alone = 1.0 if dwells.shared_angle is None else np.asarray(dwells.shared_angle) == 0.0
        position = rig_covariance(u, angle * np.broadcast_to(alone, len(u)))
        rate = (rig.rate_uncertainty or 0.0) if triad == "gyro" else 0.0
        parts[POSITION], parts[RATE] = position, rig_covariance(u, 0.0, rate)
        parts[NOISE] = given - parts[POSITION] - parts[RATE]
    if rows == 1:  # along the output only
        output = np.asarray(getattr(dwells, triad), float)
        unit = output / np.linalg.norm(output, axis=1, keepdims=True)
        parts = {
            k: np.einsum("ni,nij,nj->n", unit, c, unit)[:, None, None] for k, c in parts.items()
        }
    root = np.linalg.inv(np.linalg.cholesky(sum(parts.values())))
    return {k: root @ c @ np.swapaxes(root, 1, 2) for k, c in parts.items()}


def _root(share: Float[np.ndarray, "dwells rows rows"]) -> Float[np.ndarray, "dwells rows rows"]:
    """R with RᵀR = share, for shares that may be singular."""
    values, vectors = np.linalg.eigh(0.5 * (share + np.swapaxes(share, 1, 2)))
    return np.sqrt(np.maximum(values, 0.0))[:, :, None] * np.swapaxes(vectors, 1, 2)


def _degrees(source: str, fit: Fit, share: Float[np.ndarray, "dwells rows rows"]) -> float:
    if source == NOISE:
        return max(float(np.sum(np.asarray(fit.dwells.count) - 1.0)), 1.0)
    if source == SCATTER:
        part = float(np.mean(np.trace(share, axis1=1, axis2=2))) / share.shape[1]
        return max(residual_degrees(fit), 1) * part**2
    return math.inf
