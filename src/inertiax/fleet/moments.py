"""Sums over dwells that the invariant problem of one device is made of, for a batch in the last axis.

In the frame of the current estimate a specific force u (in units of g) has the residual w (‖u‖ − 1), and its
derivatives by a shift β and a lower-triangular change G of that frame, u' = u − β − G u, are

    ∂‖u‖/∂β_i = −u_i/‖u‖,   ∂‖u‖/∂G_ij = −u_i u_j/‖u‖.

So the normal matrix holds nothing but the moments Σ w² u_i u_j …/‖u‖² of second to fourth order: 31 different
numbers for its 81 elements. Nothing is left out: it is the Gauss-Newton matrix in other coordinates.
The nine unknowns are β₀ β₁ β₂ G₀₀ G₁₀ G₂₀ G₁₁ G₂₁ G₂₂.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float


# Dwells summed in one expression: more take longer to compile, and are summed in several parts.
TERMS = 24
_PAIRS = ((0, 0), (1, 0), (2, 0), (1, 1), (2, 1), (2, 2))
_SINGLES = ((0,), (1,), (2,))
_FACTORS = ((), *_SINGLES, (0, 0), (1, 1), (2, 2))


def _places() -> np.ndarray:
    """Where each element of the normal matrix lies among the products of factors and pairs."""
    known: dict[tuple[int, ...], int] = {}
    for row, factor in enumerate(_FACTORS):
        for column, pair in enumerate(_PAIRS):
            known.setdefault(tuple(sorted(factor + pair)), row * len(_PAIRS) + column)
    unknowns = (*_SINGLES, *_PAIRS)
    return np.array([[known[tuple(sorted(a + b))] for b in unknowns] for a in unknowns])


_PLACES = _places()


def square(u: Float[Array, "3 *rest"]) -> Float[Array, "*rest"]:
    """‖u‖²."""
    return u[0] * u[0] + u[1] * u[1] + u[2] * u[2]


def normal_matrix(
    u: Float[Array, "3 dwells batch"], squared: Float[Array, "dwells batch"]
) -> Float[Array, "9 9 batch"]:
    """JᵀJ of the nine unknowns; `squared` are the weights w²."""
    pairs = jnp.concatenate([u * u[None, 0], u[1:] * u[None, 1], u[2:] * u[None, 2]])
    factors = jnp.concatenate([jnp.ones_like(u[:1]), u, u * u])
    sums = _sums(factors, pairs * (squared / square(u))[None])
    return sums.reshape(len(_FACTORS) * len(_PAIRS), -1)[_PLACES]


def gradient(
    u: Float[Array, "3 dwells batch"], squared: Float[Array, "dwells batch"]
) -> Float[Array, "9 batch"]:
    """−Jᵀr of the nine unknowns; `squared` are the weights w²."""
    length = square(u)
    inverse = jax.lax.rsqrt(length)
    pull = squared * (length * inverse - 1.0) * inverse
    sums = _sums(jnp.concatenate([jnp.ones_like(u[:1]), u]), u * pull[None])
    return jnp.concatenate([sums[0], sums[1], sums[2, 1:], sums[3, 2:]])


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
