"""Slow noise of one triad that was estimated together with the other: its rows of the joint least squares as a problem
of its own.

With the joint design J = (J₁, J₂) of a triad's own unknowns and all others, least squares of J₁ without what J₂
explains, Q J₁ with Q = I − J₂ (J₂ᵀJ₂)⁻¹ J₂ᵀ, give the same estimates and the same covariance (Frisch and Waugh,
Econometrica 1, 1933). Rows of the other triad are left out: its slow noise hardly reaches this one's parameters.
"""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float, Int

from .._jax import eqx, jnp
from ..data.recording import Rig
from ..estimators import AbstractEstimator, JointImu
from ..estimators.host_forms import LinearisedDwells
from ..physics.temperature import AbstractBasis
from ..procedure.single_device import Problem
from ..reduction.dwells import Dwells
from .results import TriadResult
from .slow_noise import with_slow_noise


class RowsOfTriad(Problem):
    """What `slow_noise` asks of a `Problem`, of one triad's rows of a joint one, without correlations that dwells
    share."""

    def __init__(
        self,
        estimator: AbstractEstimator,
        basis: AbstractBasis,
        dwells: Dwells,
        design: Float[np.ndarray, "rows unknowns"],
        weighted: Float[np.ndarray, "rows unknowns"],
        residual: Float[np.ndarray, " rows"],
    ):
        """`design` and `residual` have unit covariance; `weighted` is V⁻¹ times the whitened design."""
        self.estimator, self.basis, self.dwells = estimator, basis, dwells
        self.num_dwells, self.at_nodes, self.shared = dwells.num_dwells, basis.at_nodes, None
        self._design, self._weighted, self._residual = design, weighted, residual

    def at(self, coefficients, dwells: Dwells | None = None) -> LinearisedDwells:
        """The number of a dwell's rows alone is asked for."""
        del coefficients, dwells
        rows = self._residual.reshape(self.num_dwells, -1)
        nothing = np.zeros((*rows.shape, self.estimator.num_parameters))
        return LinearisedDwells(rows, nothing, rows, rows)

    def design(
        self, jacobian: Float[np.ndarray, "dwell row parameter"]
    ) -> Float[np.ndarray, "rows unknown"]:
        del jacobian
        return self._weighted

    def rows(
        self, coefficients, dwells: Dwells | None = None
    ) -> tuple[Float[np.ndarray, "row unknown"], Float[np.ndarray, " row"]]:
        del coefficients, dwells
        return self._design, self._residual


def with_slow_noise_of(
    joint: Problem,
    coefficients: Float[np.ndarray, "size parameter"],
    free: Bool[np.ndarray, "size parameter"],
    rows: tuple[Int[np.ndarray, " dwell"], slice],
    result: TriadResult,
    rig: Rig,
) -> TriadResult:
    """A triad's result with the slow noise of its residuals in its covariance; see the module.

    It stays as it is where its rows are of motions, and where its unknowns are not all of its parameters.

    **Arguments:** `free` marks the joint unknowns; `rows` are the dwells that have rows of the triad, and their place
    in a dwell's; `result` is the triad's by the joint fit, its basis' functions the first of the joint one's.
    """
    estimator, solution = joint.estimator, result.solution
    assert isinstance(estimator, JointImu)
    triad = result.estimator.triad
    mapped = np.asarray(estimator.triad_map(triad))
    by_motions = triad == "gyro" and joint.dwells.motion is not None
    if by_motions or np.any(mapped.sum(axis=0) > 1.0):  # a symmetric matrix repeats unknowns
        return result
    own = free & mapped.any(axis=0)
    once = joint.decorrelated(joint.design(joint.at(coefficients).jacobian))
    residual = joint.rows(coefficients)[1]
    others = once[:, (free & ~own).ravel()]
    size = np.linalg.norm(others, axis=0)
    others = others / np.where(size > 0.0, size, 1.0)
    design = once[:, own.ravel()]
    design = design - others @ np.linalg.lstsq(others, design, rcond=None)[0]
    kept, place = rows

    def taken(x: Float[np.ndarray, "rows ..."]) -> Float[np.ndarray, "taken ..."]:
        by_dwell = x.reshape(joint.num_dwells, -1, *x.shape[1:])
        return by_dwell[kept, place].reshape(-1, *x.shape[1:])

    problem = RowsOfTriad(
        result.estimator, solution.curve.basis, result.dwells,
        taken(design), taken(joint.weighted(design)), taken(residual),
    )  # fmt: skip
    covariance, slow = with_slow_noise(
        problem, np.asarray(solution.curve.coefficients), np.asarray(solution.covariance), rig
    )
    changed = eqx.tree_at(lambda s: s.covariance, solution, jnp.asarray(covariance))
    return dataclasses.replace(result, solution=changed, slow_noise=slow)
