"""Errors that rows of a least squares have in common: the inverse root of their covariance, of low rank beside white.

With the whitened signatures $U$ of common errors of unit variance the whitened rows have covariance $I + U U^T$, whose
inverse root is

$$S = I - F F^T, \\qquad F = U W \\,\\mathrm{diag}\\Big(\\frac{1 - (1 + \\lambda)^{-1/2}}{\\lambda}\\Big)^{1/2}, \\qquad
U^T U = W \\,\\mathrm{diag}(\\lambda)\\, W^T.$$
"""

import numpy as np
from jaxtyping import Float

from .._jax import jnp
from .._typing import AnyArray
from .linear_algebra import symmetric_eigen


def inverse_root(
    gram: Float[AnyArray, "*batch error error"],
) -> Float[AnyArray, "*batch error error"]:
    """X of F = U X, from Uᵀ U; any leading axes. NumPy for NumPy, JAX for JAX."""
    xp = np if isinstance(gram, np.ndarray) else jnp
    value, vector = symmetric_eigen(gram)
    value = xp.maximum(value, 0.0)
    small = value < 1e-8  # the limit of the factor is one half
    factor = xp.where(small, 0.5, (1.0 - 1.0 / xp.sqrt(1.0 + value)) / xp.where(small, 1.0, value))
    return vector * xp.sqrt(factor)[..., None, :]
