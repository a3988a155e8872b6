"""What a NumPy form does: the estimator's functions of many dwells at once, with the Jacobian."""

import abc
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from ..._jax import eqx
from ...reduction.dwells import Dwells, known_force
from .layout import Layout


Vectors = Float[np.ndarray, "dwell parameter"]


class LinearisedDwells(NamedTuple):
    """Every dwell at its own parameters; residual and Jacobian of padding are zero."""

    residual: Float[np.ndarray, "dwell row"]  # whitened
    jacobian: Float[np.ndarray, "dwell row parameter"]  # of it
    misfit: Float[np.ndarray, "dwell misfit"]  # SI units
    sigma: Float[np.ndarray, "dwell misfit"]  # of it, by the dwells' own noise


class AbstractHostForm(abc.ABC):
    """An estimator's functions on the host; formulas and units are the estimator's own."""

    def __init__(self, estimator: Any):
        self.triad: str = estimator.triad
        self.layout = Layout(estimator.names)
        self.scatter = float(estimator.scatter)
        self.robust: float | None = estimator.robust
        self.gravity = float(getattr(estimator, "gravity", 1.0))

    @abc.abstractmethod
    def linearise(self, vectors: Vectors, dwells: Dwells) -> LinearisedDwells:
        """`residual` with its Jacobian, and `misfit`."""

    @abc.abstractmethod
    def start(self, dwells: Dwells) -> Float[np.ndarray, " parameter"]:
        """Closed-form approximation from all dwells."""

    def compensate(self, vectors: Vectors, dwells: Dwells) -> Dwells:
        """Outputs refined by equation (3), and their covariance."""
        errors = self.layout.unpack(vectors)
        refine = np.linalg.inv(np.eye(3) + errors.matrix)
        output = np.asarray(getattr(dwells, self.triad)) - errors.bias
        if self.triad == "gyro":
            output = output - _times(errors.g_sensitivity, self.force(dwells) / self.gravity)
        own = f"{self.triad}_covariance"
        covariance = refine @ np.asarray(getattr(dwells, own)) @ np.swapaxes(refine, 1, 2)
        return eqx.tree_at(
            lambda d: (getattr(d, self.triad), getattr(d, own)),
            dwells,
            (_times(refine, output), covariance),
        )

    def compose(self, first: Vectors, second: Vectors) -> Vectors:
        """Equation (6): `second` was estimated on dwells compensated with `first`."""
        a, b = self.layout.unpack(first), self.layout.unpack(second)
        return self.layout.pack(
            a.bias + b.bias + _times(a.matrix, b.bias),
            a.matrix + b.matrix + a.matrix @ b.matrix,
            a.g_sensitivity + b.g_sensitivity + a.matrix @ b.g_sensitivity,
        )

    def force(self, dwells: Dwells) -> Float[np.ndarray, "dwell 3"]:
        """Specific force of each dwell, m/s²: the reference's, else the (compensated) outputs', else zero."""
        known = known_force(dwells.reference_accel, dwells.accel)
        return np.zeros((dwells.num_dwells, 3)) if known is None else np.asarray(known)

    def weighed(
        self,
        dwells: Dwells,
        rows: Float[np.ndarray, "dwell row"],
        jacobian: Float[np.ndarray, "dwell row parameter"],
        misfit: Float[np.ndarray, "dwell misfit"],
        sigma: Float[np.ndarray, "dwell misfit"],
    ) -> LinearisedDwells:
        """Whitened rows under the pseudo-Huber loss of `base.soften`, zero for padding."""
        if self.robust is not None:
            root = np.sqrt(1.0 + np.square(rows / self.robust))
            # ½ r̃² = δ² (√(1 + (r/δ)²) − 1), so dr̃/dr = r / (r̃ root).
            jacobian = jacobian * (np.sqrt(0.5 * (1.0 + root)) / root)[:, :, None]
            rows = rows * np.sqrt(2.0 / (1.0 + root))
        valid = np.asarray(dwells.valid)
        return LinearisedDwells(
            np.where(valid[:, None], rows, 0.0),
            np.where(valid[:, None, None], jacobian, 0.0),
            misfit,
            sigma,
        )


def whitening(
    covariance: Float[np.ndarray, "dwell n n"], scatter: float
) -> Float[np.ndarray, "dwell n n"]:
    """L⁻¹ with L Lᵀ = covariance + scatter² E; no numbers where that is not positive definite."""
    total = covariance + scatter**2 * np.eye(covariance.shape[-1])
    try:
        lower = np.linalg.cholesky(total)
    except np.linalg.LinAlgError:  # some dwell's; the others keep their weights
        lower = np.stack([_cholesky(one) for one in total])
    return np.linalg.inv(lower)


def _cholesky(matrix: Float[np.ndarray, "n n"]) -> Float[np.ndarray, "n n"]:
    try:
        return np.linalg.cholesky(matrix)
    except np.linalg.LinAlgError:
        return np.full_like(matrix, np.nan)


def _times(
    matrix: Float[np.ndarray, "dwell 3 3"], vector: Float[np.ndarray, "dwell 3"]
) -> Float[np.ndarray, "dwell 3"]:
    return np.einsum("nij,nj->ni", matrix, vector)
