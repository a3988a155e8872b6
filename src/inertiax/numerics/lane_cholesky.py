"""Solve and invert many small symmetric positive definite matrices at once, without LAPACK.

Two layouts. *Lanes*: an array `(n, n, batch)`, so that the batch rides in the processor's vector lanes; for up
to about a dozen unknowns. *Blocks*: an array `(batch, n, n)` in which all but the diagonal blocks is matrix
products; for tens of unknowns.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float


# A pivot below so many roundings of its diagonal tells that a column depends on those before it.
DEPENDENT = 500.0


def invert_lanes(matrix: Float[Array, "n n batch"]) -> Float[Array, "n n batch"]:
    """Inverses of symmetric matrices whose size is a multiple of three, by sweeps of three rows at a time.

    NaN where a matrix is not positive definite to rounding. Source: Goodnight, *A tutorial on the sweep operator*,
    Am. Stat. 33 (1979) 149. What is swept leaves at the top and comes in again at the bottom, so that every round is
    the same.
    """
    n = matrix.shape[0]
    diagonal = jnp.stack([matrix[k, k] for k in range(n)])

    def sweep(_, state):
        a, lowest = state
        pivot = _inverse_three(a[:3, :3], lowest[:3])
        top, left = a[:3, 3:], a[3:, :3]
        row = (
            pivot[:, 0, None] * top[None, 0]
            + pivot[:, 1, None] * top[None, 1]
            + pivot[:, 2, None] * top[None, 2]
        )
        rest = (
            a[3:, 3:]
            - left[:, 0, None] * row[None, 0]
            - left[:, 1, None] * row[None, 1]
            - left[:, 2, None] * row[None, 2]
        )
        above = jnp.concatenate([rest, jnp.swapaxes(row, 0, 1)], axis=1)
        below = jnp.concatenate([row, -pivot], axis=1)
        return jnp.concatenate([above, below]), jnp.concatenate([lowest[3:], lowest[:3]])

    lowest = diagonal * (DEPENDENT * jnp.finfo(matrix.dtype).eps)
    # A loop: written out, it would take most of the compile time.
    return -jax.lax.fori_loop(0, n // 3, sweep, (matrix, lowest))[0]


def _inverse_three(a: Float[Array, "3 3 batch"], lowest: Float[Array, "3 batch"]) -> Array:
    """Inverse by L D Lᵀ; NaN where a pivot is not above `lowest`."""
    nan, one = jnp.full((), jnp.nan, a.dtype), jnp.ones((), a.dtype)
    reciprocal = lambda x, low: jnp.where(x > low, one / x, nan)
    d0 = reciprocal(a[0, 0], lowest[0])
    l10, l20 = a[1, 0] * d0, a[2, 0] * d0
    d1 = reciprocal(a[1, 1] - l10 * a[1, 0], lowest[1])
    c21 = a[2, 1] - l20 * a[1, 0]
    l21 = c21 * d1
    d2 = reciprocal(a[2, 2] - l20 * a[2, 0] - l21 * c21, lowest[2])
    m20 = l10 * l21 - l20
    i21, i20, i10 = -l21 * d2, m20 * d2, -l10 * d1 - l21 * m20 * d2
    i11, i00 = d1 + l21 * l21 * d2, d0 + l10 * l10 * d1 + m20 * m20 * d2
    return jnp.stack([i00, i10, i20, i10, i11, i21, i20, i21, d2]).reshape(a.shape)


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
