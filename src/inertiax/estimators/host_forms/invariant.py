"""The magnitude of gravity at rest: `Invariant`.

    r = (‖f‖ − g) / σ,   f = (E + Γ)⁻¹ (a' − a⁰),   ∂‖f‖/∂p = −((E + Γ)⁻ᵀ f / ‖f‖)_i x

where parameter p acts on output i through x: 1 for a bias, f_j for Γ_ij.
"""

from typing import Any

import numpy as np
import scipy.linalg
from jaxtyping import Float

from ...reduction.dwells import Dwells
from .form import AbstractHostForm, LinearisedDwells, Vectors


class InvariantOnHost(AbstractHostForm):
    """‖compensated output‖ = g."""

    def __init__(self, estimator: Any):
        super().__init__(estimator)
        self.misalignments: bool = estimator.misalignments

    def linearise(self, vectors: Vectors, dwells: Dwells) -> LinearisedDwells:
        errors = self.layout.unpack(vectors)
        output = np.asarray(dwells.accel)
        refine = np.linalg.inv(np.eye(3) + errors.matrix)
        force = np.einsum("nij,nj->ni", refine, output - errors.bias)
        size = np.linalg.norm(force, axis=1)
        back = np.einsum("nji,nj->ni", refine, force / size[:, None])
        along = output / np.linalg.norm(output, axis=1, keepdims=True)
        variance = np.einsum("ni,nij,nj->n", along, np.asarray(dwells.accel_covariance), along)
        sigma = np.sqrt(np.maximum(variance, 0.0))
        total = np.sqrt(np.square(sigma) + self.scatter**2)
        misfit = (size - self.gravity)[:, None]
        with np.errstate(divide="ignore", invalid="ignore"):  # dwells without noise and scatter
            rows = misfit / total[:, None]
            slopes = -back[:, self.layout.output] * self.layout.inputs(force, force)
            jacobian = (slopes / total[:, None])[:, None, :]
        return self.weighed(dwells, rows, jacobian, misfit, sigma[:, None])

    def start(self, dwells: Dwells) -> Float[np.ndarray, " parameter"]:
        """The ellipsoid's, or zero where Γ is diagonal: faces alone determine no ellipsoid."""
        nothing = np.zeros(self.layout.size)
        if not self.misalignments:
            return nothing
        try:
            found = self._ellipsoid(np.asarray(dwells.accel)[np.asarray(dwells.valid)])
        except np.linalg.LinAlgError:
            return nothing
        return found if np.all(np.isfinite(found)) else nothing

    def _ellipsoid(self, outputs: Float[np.ndarray, "dwell 3"]) -> Float[np.ndarray, " parameter"]:
        """As `estimators.invariant.ellipsoid_start`; raises `LinAlgError` where the quadric is no ellipsoid."""
        x, y, z = (outputs / self.gravity).T
        design = np.stack(
            [x**2, y**2, z**2, 2 * x * y, 2 * x * z, 2 * y * z, 2 * x, 2 * y, 2 * z], axis=1
        )
        normal = scipy.linalg.cho_factor(design.T @ design)
        q = scipy.linalg.cho_solve(normal, design.sum(axis=0))
        shape = np.array([[q[0], q[3], q[4]], [q[3], q[1], q[5]], [q[4], q[5], q[2]]])
        centre = -scipy.linalg.cho_solve(scipy.linalg.cho_factor(shape), q[6:])
        form = shape / (1.0 - q[6:] @ centre)
        # LᵀL = form with L lower: Cholesky of the form with both axes reversed, reversed back.
        lower = np.linalg.cholesky(form[::-1, ::-1])[::-1, ::-1].T
        matrix = np.tril(np.linalg.inv(lower)) - np.eye(3)
        packed = self.layout.pack(self.gravity * centre[None], matrix[None], np.zeros((1, 3, 3)))
        return packed[0]
