"""A barometer's error over temperature: a polynomial that is zero at a reference temperature."""

import numpy as np
from jaxtyping import Float

from .._jax import Array, jnp
from .._records import field, Module
from .._typing import AnyArray, Scalar
from ..physics.leaves import as_leaf
from ..physics.temperature import Curve


class BarometerCalibration(Module):
    """p = p' − B(T) + B(T_ref): what a barometer reads beyond what it would at the reference temperature.

    Its absolute offset needs a second barometer and is no part of it.

    Raises `ValueError` for a curve of more than one parameter, or a covariance of another size.
    """

    curve: Curve  # B, Pa, one parameter
    covariance: Float[AnyArray, "size size"]  # of the coefficients, Pa²
    reference: Scalar | float = field(converter=as_leaf)  # T_ref, °C

    def __check_init__(self):
        size, count = jnp.shape(self.curve.coefficients)[-2:]
        if count != 1 or jnp.shape(self.covariance) != (size, size):
            raise ValueError(
                f"`BarometerCalibration(curve=...)`: {count} parameters and a covariance of shape "
                f"{jnp.shape(self.covariance)}; one parameter and ({size}, {size}) are needed."
            )

    def offset(self, temperature: Scalar | float) -> Float[Array, ""]:
        """B(T) − B(T_ref), Pa, at one temperature, °C."""
        return self.curve(temperature)[0] - self.curve(jnp.asarray(self.reference))[0]

    def __call__(self, pressure: Scalar | float, temperature: Scalar | float) -> Float[Array, ""]:
        """The pressure, Pa, of one sample at one temperature, °C; `vmap` it over samples."""
        return jnp.asarray(pressure) - self.offset(temperature)

    def over(
        self, temperatures: Float[np.ndarray, " n"]
    ) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
        """Offsets, Pa, and their 1 sigma at many temperatures, °C, on the host."""
        basis = self.curve.basis
        phi = basis.rows(np.asarray(temperatures, float))
        phi = phi - basis.rows(np.array([float(self.reference)]))
        spread = np.einsum("na,ab,nb->n", phi, np.asarray(self.covariance), phi)
        return (phi @ np.asarray(self.curve.coefficients))[:, 0], np.sqrt(np.maximum(spread, 0.0))
