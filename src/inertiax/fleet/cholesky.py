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


def sweep_lanes(matrix: Float[Array, "n n batch"], pivots: int) -> Float[Array, "n n batch"]:
    """Sweep (Gauss-Jordan) on the first `pivots` rows of a symmetric matrix, without exchange of rows.

    [[A, B], [Bᵀ, C]] becomes [[A⁻¹, A⁻¹B], [−BᵀA⁻¹, C − BᵀA⁻¹B]]; NaN where A is not positive definite to
    rounding. Source: Goodnight, *A tutorial on the sweep operator*, Am. Stat. 33 (1979) 149.
    """
    n = matrix.shape[0]
    diagonal = jnp.stack([matrix[k, k] for k in range(n)])
    lowest = diagonal * (DEPENDENT * jnp.finfo(matrix.dtype).eps)
    numbers = jnp.arange(n)
    zero, one = jnp.zeros((), matrix.dtype), jnp.ones((), matrix.dtype)

    def step(k, a):
        at = (numbers == k)[:, None]
        row, column = a[k], a[:, k]
        pivot = jnp.where(row[k] > lowest[k], one / row[k], jnp.full((), jnp.nan, a.dtype))
        row = jnp.where(at, one, row) * pivot[None]
        rest = jnp.where(at[:, :, None] | at[None], zero, a)
        return rest - jnp.where(at, -one, column)[:, None] * row[None]

    # A loop: written out, it would take most of the compile time.
    return jax.lax.fori_loop(0, pivots, step, matrix)


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
