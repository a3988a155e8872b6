"""What is estimated of one triad, the same for all devices of a run."""

import msgspec
import numpy as np
from jaxtyping import Float, Int

from ...physics.temperature import AbstractBasis, chebyshev_rows, Constant, Polynomial


class TriadModel(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Estimator, its parameters and their basis over temperature."""

    estimator: str
    names: tuple[str, ...]
    degree: int
    low: float  # °C, mapped to -1
    high: float  # °C, mapped to +1

    @property
    def unknowns(self) -> int:
        """Coefficients of one device, row-major (degree + 1, parameters)."""
        return (self.degree + 1) * len(self.names)

    @property
    def kinds(self) -> tuple[Int[np.ndarray, " _"], ...]:
        """Places of the coefficients of each kind (biases, matrix, g-sensitivity); none where there is but one kind."""
        kind = np.array([name.partition("[")[0] for name in self.names] * (self.degree + 1))
        found = tuple(np.flatnonzero(kind == k) for k in dict.fromkeys(kind.tolist()))
        return found if len(found) > 1 else ()


def basis_of(model: TriadModel) -> AbstractBasis:
    """The temperature basis of a triad's model."""
    return Constant() if model.degree == 0 else Polynomial(model.degree, model.low, model.high)


def basis_values(
    model: TriadModel, temperatures: Float[np.ndarray, " grid"]
) -> Float[np.ndarray, "grid size"]:
    """`basis_of(model)` at many temperatures (°C), in NumPy."""
    if model.degree == 0:
        return np.ones((len(temperatures), 1))
    return chebyshev_rows(temperatures, model.degree, model.low, model.high)


def curve_covariance(
    model: TriadModel,
    covariance: Float[np.ndarray, "*devices unknowns unknowns"],
    temperatures: Float[np.ndarray, " grid"],
) -> Float[np.ndarray, "*devices grid parameters"]:
    """Variance of every parameter's curve, φ(T) C φ(T)ᵀ, from the covariance of the coefficients."""
    phi = basis_values(model, temperatures)
    size, count = model.degree + 1, len(model.names)
    blocks = covariance.reshape(*covariance.shape[:-2], size, count, size, count)
    own = np.einsum("...aibi->...abi", blocks)
    return np.einsum("ta,...abi,tb->...ti", phi, own, phi)


def curves(
    model: TriadModel,
    coefficients: Float[np.ndarray, "*devices unknowns"],
    temperatures: Float[np.ndarray, " grid"],
) -> Float[np.ndarray, "*devices grid parameters"]:
    """Every parameter over temperature."""
    shape = (*coefficients.shape[:-1], model.degree + 1, len(model.names))
    return np.einsum(
        "ta,...ai->...ti", basis_values(model, temperatures), coefficients.reshape(shape)
    )
