"""Solve and invert many small symmetric positive definite matrices at once, without LAPACK.

Two layouts. *Lanes*: an array `(n, n, batch)`, so that the batch rides in the processor's vector lanes; for up
to about a dozen unknowns. *Blocks*: an array `(batch, n, n)` in which all but the diagonal blocks is matrix
products; for tens of unknowns.
"""

import functools

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .own_kernels import kept


# A pivot below so many roundings of its diagonal tells that a column depends on those before it.
DEPENDENT = 500.0


def invert_lanes(
    matrix: Float[Array, "n n batch"], lowest: Float[Array, "n batch"] | None = None
) -> Float[Array, "n n batch"]:
    """Inverses of symmetric matrices by Gauss and Jordan's elimination, all elements alike at every pivot.

    NaN where a matrix is not positive definite to rounding, or a pivot is not above `lowest`. With the unit vector e of
    a pivot d = eᵀ A e, one elimination is A − (A e − d e)(eᵀ A + d eᵀ)/d, by which row and column of the pivot are d
    times those of the inverse: they are divided by the pivots at the end. Source: Golub & Van Loan, *Matrix
    Computations* (2013), section 3.4.
    """
    n = matrix.shape[0]
    diagonal = jnp.stack([matrix[k, k] for k in range(n)])
    least = diagonal * (DEPENDENT * jnp.finfo(matrix.dtype).eps) if lowest is None else lowest
    at = lambda x, k, axis: jax.lax.dynamic_index_in_dim(x, k, axis, keepdims=False)

    def pivot(k, state):
        rest, over = state
        row, unit = at(rest, k, 0), (jnp.arange(n) == k)[:, None].astype(matrix.dtype)
        one = _over_pivot(at(row, k, 0), at(least, k, 0))
        rest = _eliminated(rest, *_arms(at(rest, k, 1), row, one, unit))
        return rest, jax.lax.dynamic_update_index_in_dim(over, one, k, 0)

    # A loop: written out, it would take most of the compile time.
    return _scaled(*jax.lax.fori_loop(0, n, pivot, (matrix, jnp.zeros_like(least))))


@kept
def _over_pivot(pivot: Array, lowest: Array) -> Array:
    return jnp.where(pivot > lowest, 1.0 / pivot, jnp.full((), jnp.nan, pivot.dtype))


@kept
def _arms(column: Array, row: Array, over: Array, unit: Array) -> tuple[Array, Array]:
    # Products where a choice would keep the loop out of the vector lanes.
    return column * (1.0 - unit), row * over[None] * (1.0 - unit) + 2.0 * unit


@kept
def _eliminated(matrix: Array, column: Array, row: Array) -> Array:
    return matrix - column[:, None] * row[None]


@kept
def _scaled(matrix: Array, scale: Array) -> Array:
    return matrix * scale[:, None] * scale[None]


def invert_lanes_by_blocks(
    matrix: Float[Array, "n n batch"], block: int
) -> Float[Array, "n n batch"]:
    """`invert_lanes` for tens of unknowns, so many pivots at a time; `block` divides n.

    Rows and columns are scaled to a unit diagonal first. With the columns E of the unit matrix that belong to a block
    D = Eᵀ A E, one elimination is A − (A E − E) D⁻¹ (Eᵀ A + Eᵀ), for D near one.
    """
    n, batch = len(matrix), matrix.shape[2]
    scale = jax.lax.rsqrt(jnp.stack([matrix[k, k] for k in range(n)]))
    a = _scaled(matrix, scale)
    lowest = jnp.full((block, batch), DEPENDENT * jnp.finfo(a.dtype).eps, a.dtype)
    for start in range(0, n, block):
        here = slice(start, start + block)
        unit = jnp.eye(n, dtype=a.dtype)[:, here, None]
        row = product_of(invert_lanes(a[here, here], lowest), a[here] + jnp.swapaxes(unit, 0, 1))
        a = _less_product(a, a[:, here] - unit, row)
    return _scaled(a, scale)


@kept
def product_of(
    left: Float[Array, "rows inner batch"], right: Float[Array, "inner columns batch"]
) -> Float[Array, "rows columns batch"]:
    """Product of each device's two matrices, written out."""
    terms = (left[:, k, None] * right[None, k] for k in range(len(right)))
    return functools.reduce(jnp.add, terms)


@kept
def _less_product(matrix: Array, left: Array, right: Array) -> Array:
    terms = (left[:, k, None] * right[None, k] for k in range(len(right)))
    return functools.reduce(jnp.subtract, terms, matrix)


def inverse_blocks(matrix: Float[Array, "batch n n"], block: int) -> Float[Array, "batch n n"]:
    """Inverse by block Cholesky; `block` divides n. NaN where not positive definite.

    Rows and columns are scaled to a unit diagonal first, for parameters of different units.
    """
    scale = jax.lax.rsqrt(jnp.diagonal(matrix, axis1=1, axis2=2))
    scaled = matrix * scale[:, :, None] * scale[:, None, :]
    inverse = _inverse_factor(scaled, block)
    product = jnp.matmul(jnp.swapaxes(inverse, 1, 2), inverse)
    return product * scale[:, :, None] * scale[:, None, :]


def _inverse_factor(matrix: Float[Array, "batch n n"], block: int) -> Float[Array, "batch n n"]:
    """Inverse of the lower Cholesky factor, block row by block row."""
    batch, n, _ = matrix.shape
    rest = matrix
    rows: list[Array] = []  # block rows of L⁻¹ so far, each (batch, block, n)
    factor: list[Array] = []  # block columns of L below their diagonal block
    inverse = jnp.zeros_like(matrix)
    for start in range(0, n, block):
        corner = _inverse_corner(rest[:, :block, :block])
        below = jnp.matmul(rest[:, block:, :block], jnp.swapaxes(corner, 1, 2))
        factor.append(below)
        rest = rest[:, block:, block:] - jnp.matmul(below, jnp.swapaxes(below, 1, 2))
        # L⁻¹'s block row: corner · (E − Σ L_ik (L⁻¹)_k); the sum is over the block columns before.
        unit = (
            jnp.zeros((batch, block, n), matrix.dtype)
            .at[:, :, start : start + block]
            .set(jnp.eye(block, dtype=matrix.dtype))
        )
        for k, row in enumerate(rows):
            offset = start - (k + 1) * block
            unit = unit - jnp.matmul(factor[k][:, offset : offset + block], row)
        rows.append(jnp.matmul(corner, unit))
        inverse = inverse.at[:, start : start + block].set(rows[-1])
    return inverse


def _inverse_corner(matrix: Float[Array, "batch block block"]) -> Float[Array, "batch block block"]:
    """Inverse of the lower factor of one diagonal block, by elimination beside a unit matrix.

    A loop over columns: written out, it would take most of the compile time.
    """
    n = matrix.shape[1]
    rows = jnp.arange(n)

    def eliminate(j, state):
        rest, inverse = state
        scale = jax.lax.rsqrt(rest[:, j, j])[:, None]
        below = jnp.where(rows > j, rest[:, :, j], jnp.zeros_like(rest[:, :, j])) * scale
        pivot_rest, pivot_inverse = rest[:, j] * scale, inverse[:, j] * scale
        rest = rest - below[:, :, None] * pivot_rest[:, None, :]
        inverse = inverse - below[:, :, None] * pivot_inverse[:, None, :]
        return rest, inverse.at[:, j].set(pivot_inverse)

    unit = jnp.broadcast_to(jnp.eye(n, dtype=matrix.dtype), matrix.shape)
    return jax.lax.fori_loop(0, n, eliminate, (matrix, unit))[1]
