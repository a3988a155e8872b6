"""Sums over dwells that the invariant problem of one device is made of, for a batch in the last axis.

In any frame a specific force u (in units of g) has the residual w (‖u‖ − 1), and its derivatives by a shift β and a
lower-triangular change G of that frame, u' = u − β − G u, are

    ∂‖u‖/∂β_i = −u_i/‖u‖,   ∂‖u‖/∂G_ij = −u_i u_j/‖u‖:

the nine monomials φ(u) over −‖u‖. So Jᵀ J = Σ v φφᵀ with v = w²/‖u‖², and −Jᵀ r = Σ p φ with p = w² (1 − 1/‖u‖).
`tests/test_fleet_moments.py` holds both to numerical derivatives and to `estimators.Invariant`.
The nine unknowns are β₀ β₁ β₂ G₀₀ G₁₀ G₂₀ G₁₁ G₂₁ G₂₂.
"""

import functools

import jax.numpy as jnp
from jaxtyping import Array, Float

from ...numerics.own_kernels import kept


# Dwells summed in one expression: more take longer to compile, and are summed in several parts.
TERMS = 24


def square(u: Float[Array, "3 *rest"]) -> Float[Array, "*rest"]:
    """‖u‖²."""
    return u[0] * u[0] + u[1] * u[1] + u[2] * u[2]


def monomials(u: Float[Array, "3 *rest"]) -> Float[Array, "9 *rest"]:
    """φ(u) = (u₀ u₁ u₂ | u₀u₀ u₁u₀ u₂u₀ | u₁u₁ u₂u₁ | u₂u₂)."""
    return jnp.concatenate([u, u * u[None, 0], u[1:] * u[None, 1], u[2:] * u[None, 2]])


def normal_matrix(
    phi: Float[Array, "9 dwells batch"], weights: Float[Array, "dwells batch"]
) -> Float[Array, "9 9 batch"]:
    """Σ v φφᵀ; `weights` are v."""
    return products(phi * weights[None], phi)


def total(
    phi: Float[Array, "rows dwells batch"], pull: Float[Array, "dwells batch"]
) -> Float[Array, "rows batch"]:
    """Σ p φ; `pull` is p."""
    return products(pull[None], phi)[0]


def products(
    x: Float[Array, "rows dwells batch"], y: Float[Array, "columns dwells batch"]
) -> Float[Array, "rows columns batch"]:
    """Σ_d x_id y_jd, written out: a batched matrix product, and a sum over an axis, cost several times as much."""
    dwells, batch = x.shape[1:]
    if dwells <= TERMS:
        return sum_of_terms(x, y)
    # In parts: one long sum waits for itself at every term.
    terms = next((t for t in range(TERMS, TERMS // 2, -1) if dwells % t == 0), TERMS)
    parts = -(-dwells // terms)
    if parts * terms != dwells:
        missing = ((0, 0), (0, terms * parts - dwells), (0, 0))
        x, y = jnp.pad(x, missing), jnp.pad(y, missing)
    x, y = (z.reshape(len(z), terms, -1) for z in (x, y))
    return sum_of_parts(sum_of_terms(x, y).reshape(len(x), len(y), parts, batch))


def squares(x: Float[Array, "9 dwells batch"]) -> Float[Array, "9 9 batch"]:
    """Σ_d x_id x_jd: three rows at a time up to the diagonal, and their mirror image."""
    if x.shape[1] > TERMS:
        return products(x, x)
    return mirrored(*(rows(x) for rows in _LOWER))


def _lower_rows(x: Array, *, first: int) -> Array:
    """Three rows of Σ_d x_id x_jd, up to the diagonal."""
    last = first + 3
    terms = (x[first:last, None, k] * x[None, :last, k] for k in range(x.shape[1]))
    return functools.reduce(jnp.add, terms)


_LOWER = tuple(kept(functools.partial(_lower_rows, first=k)) for k in (0, 3, 6))


@kept
def mirrored(first: Array, middle: Array, last: Array) -> Array:
    """A symmetric matrix from its rows up to the diagonal, three by three."""
    turned = lambda block: jnp.swapaxes(block, 0, 1)
    first = jnp.concatenate([first, turned(middle[:, :3]), turned(last[:, :3])], axis=1)
    middle = jnp.concatenate([middle, turned(last[:, 3:6])], axis=1)
    return jnp.concatenate([first, middle, last])


@kept
def sum_of_terms(x: Array, y: Array) -> Array:
    """Σ_d x_id y_jd in one expression, of as many dwells as there are."""
    terms = (x[:, None, k] * y[None, :, k] for k in range(x.shape[1]))
    return functools.reduce(jnp.add, terms)


@kept
def sum_of_parts(parts: Array) -> Array:
    """Sum over the third axis, written out."""
    return functools.reduce(jnp.add, (parts[:, :, k] for k in range(parts.shape[2])))


@kept
def largest_of(rows: Float[Array, "rows batch"]) -> Float[Array, " batch"]:
    """Largest over the first axis, written out."""
    return functools.reduce(jnp.maximum, rows)
