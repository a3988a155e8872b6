"""What each source has of the covariance of a dwell's rows: noise within dwells, scatter between them, rig.

A dwell's covariance is a sum Σ = Σ₁ + Σ₂ + …, whitened by L Lᵀ = Σ. Source s has the share L⁻¹ Σ_s L⁻ᵀ of it; together
the shares are the identity. With the whitened Jacobian J, V the rows' covariance where dwells share errors of their
positioning (`procedure.shared_errors`) and P = (JᵀV⁻¹J)⁻¹, a source gives P Jᵀ V⁻¹ (share) V⁻¹ J P to the coefficients.

Gyros by gravity's turn have the rates at rest and two tilts a dwell: the bias' scatter τ between rests is in the
former as τ², in the latter over the motion's time T as τ² T².
"""

import numpy as np
from jaxtyping import Float

from ..data.recording import Rig
from ..estimators import AbstractEstimator
from ..estimators.host_forms.gravity_rotation import tilt_covariance
from ..procedure.single_device import Problem
from ..reduction.dwells import Dwells
from ..reduction.rig_errors import (
    angles_of_moves,
    heading_errors,
    leans_by_themselves,
    own_angle,
    rig_covariance,
)
from .earth_rate import HEADING


NOISE, SCATTER, POSITION, RATE = "dwell noise", "re-positioning", "rig position", "rig rate"
LEVEL = "rig level"
OF_THE_DEVICE = (NOISE, SCATTER)  # what the residuals may show to be of another size


def shares(
    estimator: AbstractEstimator, dwells: Dwells, rig: Rig, rows: int
) -> dict[str, Float[np.ndarray, "dwell row row"]]:
    """Each source's share of the covariance of a dwell's `rows` rows."""
    return (
        _turned(estimator, dwells)
        if dwells.motion is not None
        else _of_means(estimator, dwells, rig, rows)
    )


def given(
    problem: Problem,
    share: Float[np.ndarray, "dwell row row"],
    design: Float[np.ndarray, "rows unknowns"],
    covariance: Float[np.ndarray, "unknowns unknowns"],
) -> Float[np.ndarray, "unknowns unknowns"]:
    """What a source with this share gives to the coefficients; `design` is V⁻¹J, `covariance` P."""
    by_dwell = design.reshape(problem.num_dwells, share.shape[1], -1)
    moved = np.einsum("nsr,nru->nsu", root(share), by_dwell).reshape(-1, design.shape[1])
    made = covariance @ (moved.T @ moved) @ covariance
    return 0.5 * (made + made.T)


def _of_means(
    estimator: AbstractEstimator, dwells: Dwells, rig: Rig, rows: int
) -> dict[str, Float[np.ndarray, "dwell row row"]]:
    triad = estimator.triad
    given = np.asarray(getattr(dwells, f"{triad}_covariance"), float)
    variance = float(np.asarray(estimator.scatter)) ** 2
    parts = {NOISE: given, SCATTER: np.broadcast_to(variance * np.eye(3), given.shape)}
    reference = getattr(dwells, f"reference_{triad}")
    if reference is not None:
        u = np.asarray(reference, float)
        angle = rig.position_uncertainty or 0.0
        position = rig_covariance(u, own_angle(dwells, angle))
        position = position + (angles_of_moves(dwells, angle) if triad == "gyro" else 0.0)
        rate = (rig.rate_uncertainty or 0.0) if triad == "gyro" else 0.0
        parts[POSITION], parts[RATE] = position, rig_covariance(u, 0.0, rate)
        stated = [parts[POSITION], parts[RATE]]
        if triad == "gyro":
            parts[HEADING] = heading_errors(dwells) * np.ones_like(given)
            stated.append(parts[HEADING])
        else:
            parts[LEVEL] = leans_by_themselves(dwells, rig) * np.ones_like(given)
            stated.append(parts[LEVEL])
        parts[NOISE] = given - sum(stated)
    if rows == 1:  # along the output only
        output = np.asarray(getattr(dwells, triad), float)
        unit = output / np.linalg.norm(output, axis=1, keepdims=True)
        parts = {
            k: np.einsum("ni,nij,nj->n", unit, c, unit)[:, None, None] for k, c in parts.items()
        }
    return _relative(parts)


def _turned(
    estimator: AbstractEstimator, dwells: Dwells
) -> dict[str, Float[np.ndarray, "dwell 5 5"]]:
    motion = dwells.motion
    assert motion is not None
    wander = np.zeros(dwells.num_dwells) if motion.wander is None else np.asarray(motion.wander)
    drifted = wander * np.sum(np.asarray(motion.step), axis=1)
    variance = float(np.asarray(estimator.scatter)) ** 2
    square = lambda x, size: np.square(x)[:, None, None] * np.eye(size)
    at_rest = {NOISE: np.asarray(dwells.gyro_covariance, float) - square(wander, 3)}
    at_rest[SCATTER] = square(wander, 3)
    # Less than τ T where a hand's turning was counted as noise (`noise_of_motions`).
    drifted = np.minimum(drifted, np.sqrt(np.asarray(motion.noise)))
    tilts = {NOISE: tilt_covariance(dwells) - square(drifted, 2)}
    tilts[SCATTER] = square(drifted, 2) + variance * np.eye(2)
    at_rest, tilts = _relative(at_rest), _relative(tilts)
    made = {}
    for source in at_rest:
        made[source] = np.zeros((dwells.num_dwells, 5, 5))
        made[source][:, :3, :3], made[source][:, 3:, 3:] = at_rest[source], tilts[source]
    return made


def _relative(
    parts: dict[str, Float[np.ndarray, "dwell row row"]],
) -> dict[str, Float[np.ndarray, "dwell row row"]]:
    inverse = np.linalg.inv(np.linalg.cholesky(sum(parts.values())))
    return {k: inverse @ c @ np.swapaxes(inverse, 1, 2) for k, c in parts.items()}


def root(share: Float[np.ndarray, "dwells rows rows"]) -> Float[np.ndarray, "dwells rows rows"]:
    """The symmetric R with R R = share, for shares that may be singular."""
    values, vectors = np.linalg.eigh(0.5 * (share + np.swapaxes(share, 1, 2)))
    scaled = vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :]
    return scaled @ np.swapaxes(vectors, 1, 2)
