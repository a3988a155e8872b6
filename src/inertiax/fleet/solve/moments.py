"""Sums over dwells that the invariant problem of one device is made of, for a batch in the last axis.

In the frame of the current estimate a specific force u (in units of g) has the residual w (‖u‖ − 1), and its
derivatives by a shift β and a lower-triangular change G of that frame, u' = u − β − G u, are

    ∂‖u‖/∂β_i = −u_i/‖u‖,   ∂‖u‖/∂G_ij = −u_i u_j/‖u‖.

So the normal matrix holds nothing but the moments Σ w² u_i u_j …/‖u‖² of second to fourth order: 31 different
numbers for its 81 elements. Nothing is left out: it is the Gauss-Newton matrix of `estimators.Invariant`, second
form, in other coordinates; `tests/test_fleet_moments.py` holds them together to rounding.
The nine unknowns are β₀ β₁ β₂ G₀₀ G₁₀ G₂₀ G₁₁ G₂₁ G₂₂.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float


# Dwells summed in one expression: more take longer to compile, and are summed in several parts.
TERMS = 24
# Second moments, in the order of the pairs, as a matrix.
_SYMMETRIC = np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])


def square(u: Float[Array, "3 *rest"]) -> Float[Array, "*rest"]:
    """‖u‖²."""
    return u[0] * u[0] + u[1] * u[1] + u[2] * u[2]


def normal_matrix(
    u: Float[Array, "3 dwells batch"], weights: Float[Array, "dwells batch"]
) -> Float[Array, "9 9 batch"]:
    """Σ v φφᵀ; `weights` are v."""
    pairs = jnp.concatenate([u * u[None, 0], u[1:] * u[None, 1], u[2:] * u[None, 2]])
    weighted = pairs * weights[None]
    second, fourth = _total(weighted), _sums(pairs, weighted)
    third = _sums(u, weighted)
    corner = second[_SYMMETRIC]
    top = jnp.concatenate([corner, third], axis=1)
    return jnp.concatenate([top, jnp.concatenate([jnp.swapaxes(third, 0, 1), fourth], axis=1)])


def gradient(
    u: Float[Array, "3 dwells batch"], pull: Float[Array, "dwells batch"]
) -> Float[Array, "9 batch"]:
    """Σ p φ; `pull` is p."""
    pulled = u * pull[None]
    sums = _sums(u, pulled)
    return jnp.concatenate([_total(pulled), sums[0], sums[1, 1:], sums[2, 2:]])


def _total(y: Float[Array, "columns dwells batch"]) -> Float[Array, "columns batch"]:
    """Σ_d y_d, written out like `_sums`."""
    return _sums(jnp.ones((1, *y.shape[1:]), y.dtype), y)[0]


def _sums(
    x: Float[Array, "rows dwells batch"], y: Float[Array, "columns dwells batch"]
) -> Float[Array, "rows columns batch"]:
    """Σ_d x_id y_jd, written out: a batched matrix product, and a sum over an axis, cost several times as much."""
    dwells = x.shape[1]
    parts = -(-dwells // TERMS)
    if parts > 1:
        terms = -(-dwells // parts)
        missing = ((0, 0), (0, terms * parts - dwells), (0, 0))
        x, y = (jnp.pad(z, missing).reshape(len(z), terms, -1) for z in (x, y))
    total = x[:, None, 0] * y[None, :, 0]
    for k in range(1, x.shape[1]):
        total = total + x[:, None, k] * y[None, :, k]
    return total.reshape(len(x), len(y), parts, -1).sum(axis=2) if parts > 1 else total
