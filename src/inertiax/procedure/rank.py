"""Whether dwells determine all unknowns: one rule for the audit of a plan and for the outcome of a solve.

Columns of the Jacobian are scaled by kind (biases, matrix elements, g-sensitivities) and temperature term, by the best
determined parameter of each, so that a weak one stays weak. Scaled to unit length each, its column would look as good
as any other, however small it was.
"""

import numpy as np
from jaxtyping import Bool, Float

from .._jax import Array, jnp
from .._typing import AnyArray
from ..numerics.linear_algebra import cholesky, singular_pivot


# Singular value, relative to the largest, below which a combination of unknowns counts as undetermined. Its standard
# deviation would be 10⁴ times that of the best determined one: for a bias or a scale factor known to 10⁻⁴, as
# dwells of some seconds give it, an error of 1, where the linearisation behind every estimate does not hold.
TOLERANCE = 1e-4

_SQUARINGS = 6


def kind_scale(
    normal: Float[AnyArray, "unknowns unknowns"], names: tuple[str, ...], size: int
) -> AnyArray:
    """Norms of the columns for a normal matrix of coefficients, row-major (size, names), alike for parameters of
    one kind; NumPy for NumPy, JAX for JAX."""
    xp = np if isinstance(normal, np.ndarray) else jnp
    columns = xp.sqrt(xp.diagonal(normal)).reshape(size, len(names))
    kinds = [name.split("[")[0] for name in names]
    largest = {k: columns[:, np.array([own == k for own in kinds])].max(axis=1) for k in kinds}
    scale = xp.stack([largest[k] for k in kinds], axis=1).reshape(-1)
    return xp.where(scale > 0.0, scale, xp.ones_like(scale))


def has_full_rank(
    normal: Float[np.ndarray, "unknowns unknowns"], names: tuple[str, ...], size: int
) -> bool:
    """Whether a normal matrix JᵀJ of coefficients, row-major (size, names), determines all of them; on the host."""
    if not np.all(np.isfinite(normal)):
        return False
    scale = kind_scale(normal, names, size)
    values = np.linalg.eigvalsh(normal / np.outer(scale, scale))
    return bool(values[0] > _least(values.dtype) * values[-1])


def determines_all(
    normal: Float[Array, "unknowns unknowns"], names: tuple[str, ...], size: int
) -> Bool[Array, ""]:
    """`has_full_rank` under JAX, without LAPACK: A − τ² λ E is positive definite.

    λ = (tr A⁶⁴)^(1/64) is not below the largest eigenvalue and at most n^(1/64) above it, 7 % for 63 unknowns,
    so that what passes here has full rank on the host.
    """
    scale = kind_scale(normal, names, size)
    scaled = normal / (scale[:, None] * scale[None, :])
    trace = jnp.trace(scaled)
    power, log = scaled / trace, jnp.log(trace)
    for k in range(_SQUARINGS):
        power = power @ power
        trace = jnp.trace(power)
        power, log = power / trace, log + jnp.log(trace) / 2.0 ** (k + 1)
    largest = jnp.exp(log)
    shift = jnp.asarray(_least(normal.dtype), normal.dtype) * largest
    shifted = scaled - shift * jnp.eye(len(scaled), dtype=scaled.dtype)
    return jnp.all(jnp.isfinite(jnp.diagonal(cholesky(shifted))))


def _least(dtype: np.dtype) -> float:
    """Smallest eigenvalue over the largest; in float32 rounding sets it."""
    return max(TOLERANCE**2, singular_pivot(dtype))
