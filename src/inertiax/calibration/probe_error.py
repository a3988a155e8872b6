"""An error of the temperature probe that all temperatures share, as a covariance of a curve's coefficients.

A probe that reads δ too low makes θ(T + δ) of θ(T): another polynomial, whose coefficients differ by δ times those of
dθ/dT. With a stated standard deviation σ of δ the coefficients c have the covariance σ² c' c'ᵀ beside that of the fit.
"""

import numpy as np
from jaxtyping import Float

from .._typing import AnyArray
from ..physics.temperature import AbstractBasis, Polynomial


def probe_covariance(
    coefficients: Float[AnyArray, "*devices size parameters"],
    basis: AbstractBasis,
    sigma: float | Float[AnyArray, "*devices"],
) -> Float[np.ndarray, "*devices unknowns unknowns"]:
    """Covariance of coefficients, row-major (size, parameters), by a probe error of `sigma` °C, 1 sigma.

    Zero for constants, and for splines, whose error is left out.
    """
    values = np.asarray(coefficients, float)
    slope = np.zeros_like(values)
    if isinstance(basis, Polynomial):
        scale = 2.0 / (basis.high - basis.low)
        slope[..., :-1, :] = scale * np.polynomial.chebyshev.chebder(values, axis=-2)
    flat = slope.reshape(*values.shape[:-2], -1)
    return np.square(sigma)[..., None, None] * flat[..., :, None] * flat[..., None, :]
