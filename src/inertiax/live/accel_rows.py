"""Rows of a rest for the accelerometers, as `calibrate` would have them: by gravity's magnitude, or by a reference.

The equations are those of `estimators.invariant` and `estimators.reference_accel`, in NumPy with their derivatives
written out; a test holds both forms together.

    invariant:  r = ‖f‖ − g,   f = (E + Γ)⁻¹ (a' − a⁰),   Γ lower triangular
                ∂r/∂a⁰ = −w,   ∂r/∂Γ_ij = −w_i f_j,       w = (E + Γ)⁻ᵀ f / ‖f‖
    reference:  r = a⁰ + (E + Γ) a_ref − a',              Γ full
"""

import dataclasses
from typing import TypeAlias

import numpy as np
from jaxtyping import Float

from .posterior import Posterior, posterior_of, Rows
from .warming import slope_std, with_slopes


_LOWER = ((0, 0), (1, 0), (1, 1), (2, 0), (2, 1), (2, 2))
_FULL = tuple((i, j) for i in range(3) for j in range(3))
_MOST_STEPS = 20

# Standard deviations of the priors: several times what the worst parts of data sheets are off by, so that they only
# say where to turn while rests do not (convention). m/s² and 1.
PRIOR_BIAS = {"consumer": 2.0, "tactical": 0.2, "navigation": 0.02}
PRIOR_MATRIX = {"consumer": 0.1, "tactical": 0.02, "navigation": 0.005}


@dataclasses.dataclass(frozen=True, eq=False)
class RestMeans:
    """Means of the accelerometers over rests, m/s²."""

    accel: Float[np.ndarray, "rest 3"]
    covariance: Float[np.ndarray, "rest 3 3"]  # of the mean, by the noise within the rest
    reference: Float[np.ndarray, "rest 3"] | None = None


@dataclasses.dataclass(frozen=True)
class ByMagnitude:
    """The specific force at rest has the magnitude g: bias and a lower triangular matrix, 9 parameters."""

    gravity: float  # m/s²

    @property
    def names(self) -> tuple[str, ...]:
        """Of the parameters."""
        return _names(_LOWER)

    def rows(self, vector: Float[np.ndarray, " parameter"], rests: RestMeans) -> Rows:
        """One row a rest; its noise is that along the specific force."""
        residual, jacobian = self._magnitude(vector, rests.accel)
        along = rests.accel / np.linalg.norm(rests.accel, axis=1, keepdims=True)
        variance = np.einsum("ki,kij,kj->k", along, rests.covariance, along)
        return Rows(jacobian, jacobian @ vector - residual, variance)

    def tried(
        self, vector: Float[np.ndarray, " parameter"], up: Float[np.ndarray, "candidate 3"]
    ) -> Float[np.ndarray, "candidate row parameter"]:
        """Derivatives of the row that a rest would add with the specific force along `up` (unit, case axes)."""
        output = self.gravity * up @ (np.eye(3) + _matrix(vector, _LOWER)).T + vector[:3]
        return self._magnitude(vector, output)[1][:, None, :]

    def _magnitude(
        self, vector: Float[np.ndarray, " parameter"], output: Float[np.ndarray, "rest 3"]
    ) -> tuple[Float[np.ndarray, " rest"], Float[np.ndarray, "rest parameter"]]:
        inverse = np.linalg.inv(np.eye(3) + _matrix(vector, _LOWER))
        force = (output - vector[:3]) @ inverse.T
        size = np.linalg.norm(force, axis=1)
        w = (force / size[:, None]) @ inverse
        by_matrix = np.stack([-w[:, i] * force[:, j] for i, j in _LOWER], axis=1)
        return size - self.gravity, np.concatenate([-w, by_matrix], axis=1)


@dataclasses.dataclass(frozen=True)
class ByReference:
    """The specific force is known: bias and a full matrix, 12 parameters, linear."""

    gravity: float  # m/s², of the directions that are tried

    @property
    def names(self) -> tuple[str, ...]:
        """Of the parameters."""
        return _names(_FULL)

    def rows(self, vector: Float[np.ndarray, " parameter"], rests: RestMeans) -> Rows:
        """Three rows a rest."""
        del vector  # linear
        if rests.reference is None:
            raise ValueError("`ByReference.rows`: rests without a reference specific force.")
        jacobian = _reference_rows(rests.reference)
        value = (rests.accel - rests.reference).reshape(-1)
        variance = np.diagonal(rests.covariance, axis1=1, axis2=2).reshape(-1)
        return Rows(jacobian.reshape(-1, 12), value, variance)

    def tried(
        self, vector: Float[np.ndarray, " parameter"], up: Float[np.ndarray, "candidate 3"]
    ) -> Float[np.ndarray, "candidate row parameter"]:
        """Derivatives of the three rows that a rest would add with the specific force along `up`."""
        del vector
        return _reference_rows(self.gravity * up)


AccelModel: TypeAlias = ByMagnitude | ByReference  # what one rest tells of the accelerometers


def accel_rows(
    model: AccelModel,
    vector: Float[np.ndarray, " parameter"],
    rests: RestMeans,
    away: Float[np.ndarray, " rest"] | None = None,
) -> Rows:
    """Rows of all rests; with `away` (see `accel_posterior`) those of outputs a' − s (T − T̄), s the slopes."""
    if away is None:
        return model.rows(vector, rests)
    slopes = vector[len(model.names) :]
    outputs = rests.accel - away[:, None] * slopes
    return with_slopes(
        model.rows(
            vector[: len(model.names)], RestMeans(outputs, rests.covariance, rests.reference)
        ),
        away,
        slopes,
    )


def accel_posterior(
    model: AccelModel,
    rests: RestMeans,
    grade: str | None,
    start: Posterior | None = None,
    away: Float[np.ndarray, " rest"] | None = None,
) -> Posterior:
    """The posterior of the accelerometers' parameters, linearised where it ends up (Gauss-Newton steps).

    **Arguments:** `grade` of the device chooses the priors ("consumer" where it is not known), whose means are zero.
    `start` is the posterior before. `away` is how far each rest was from the mean temperature, °C: with it the biases'
    slopes, m/s² per °C, stand behind the parameters.
    """
    std = prior_std(model, grade)
    if away is not None:
        std = np.append(std, slope_std(std[:3]))
    zero = np.zeros(len(std))
    vector = zero.copy()
    if start is not None:
        vector[: len(start.mean)] = start.mean
    found = posterior_of(accel_rows(model, vector, rests, away), zero, std)
    for _ in range(_MOST_STEPS):
        moved = found.mean - vector
        vector = found.mean
        found = posterior_of(accel_rows(model, vector, rests, away), zero, std)
        if np.all(np.abs(moved) < 1e-3 * found.std):
            break
    return found


def prior_std(model: AccelModel, grade: str | None) -> Float[np.ndarray, " parameter"]:
    """Standard deviations of the priors, m/s² and 1."""
    grade = grade or "consumer"
    of = lambda name: PRIOR_BIAS[grade] if ".bias" in name else PRIOR_MATRIX[grade]
    return np.array([of(name) for name in model.names])


def compensated(
    vector: Float[np.ndarray, " parameter"], output: Float[np.ndarray, "rest 3"]
) -> Float[np.ndarray, "rest 3"]:
    """Specific force of outputs by an estimate of either model, m/s²."""
    elements = _LOWER if len(vector) == 3 + len(_LOWER) else _FULL
    return (output - vector[:3]) @ np.linalg.inv(np.eye(3) + _matrix(vector, elements)).T


def _reference_rows(force: Float[np.ndarray, "rest 3"]) -> Float[np.ndarray, "rest 3 12"]:
    made = np.zeros((len(force), 3, 12))
    for i in range(3):
        made[:, i, i] = 1.0
        made[:, i, 3 + 3 * i : 6 + 3 * i] = force
    return made


def _matrix(
    vector: Float[np.ndarray, " parameter"], elements: tuple[tuple[int, int], ...]
) -> Float[np.ndarray, "3 3"]:
    matrix = np.zeros((3, 3))
    for value, (i, j) in zip(vector[3:], elements):
        matrix[i, j] = value
    return matrix


def _names(elements: tuple[tuple[int, int], ...]) -> tuple[str, ...]:
    biases = tuple(f"accel.bias[{i}]" for i in range(3))
    return biases + tuple(f"accel.matrix[{i},{j}]" for i, j in elements)
