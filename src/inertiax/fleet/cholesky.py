"""Factor, solve and invert many small symmetric positive definite matrices at once, without LAPACK.

Two layouts. *Lanes*: a matrix is a nested list of arrays of shape `(batch,)`, written out in scalars, so
that the batch rides in the processor's vector lanes; for up to about a dozen unknowns. *Blocks*: an
array `(batch, n, n)` in which all but the diagonal blocks is matrix products; for tens of unknowns.
"""

from collections.abc import Sequence
from typing import TypeAlias

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float


Lane: TypeAlias = Float[Array, " batch"]
Lower: TypeAlias = list[list[Lane]]  # row i has i + 1 entries


def factor_lanes(matrix: Sequence[Sequence[Lane]]) -> Lower:
    """Lower factor with *inverted* pivots on the diagonal; NaN where not positive definite."""
    lower: Lower = []
    for i, row in enumerate(matrix):
        mine: list[Lane] = []
        for j in range(i):
            rest = row[j] - sum((mine[k] * lower[j][k] for k in range(j)), jnp.zeros_like(row[j]))
            mine.append(rest * lower[j][j])
        square = row[i] - sum((x * x for x in mine), jnp.zeros_like(row[i]))
        lower.append([*mine, jax.lax.rsqrt(square)])
    return lower


def solve_lanes(lower: Lower, right: Sequence[Lane]) -> list[Lane]:
    """x of L Lᵀ x = b for a factor of `factor_lanes`."""
    n = len(lower)
    y: list[Lane] = []
    for i in range(n):
        known = sum((lower[i][k] * y[k] for k in range(i)), jnp.zeros_like(right[i]))
        y.append((right[i] - known) * lower[i][i])
    x = list(y)
    for i in reversed(range(n)):
        known = sum((lower[k][i] * x[k] for k in range(i + 1, n)), jnp.zeros_like(y[i]))
        x[i] = (y[i] - known) * lower[i][i]
    return x


def invert_lanes(lower: Lower) -> Float[Array, "batch n n"]:
    """(L Lᵀ)⁻¹ for a factor of `factor_lanes`: L⁻¹ by substitution, all columns at once, then its square."""
    n = len(lower)
    unit = jnp.eye(n, dtype=lower[0][0].dtype)[:, :, None]
    rows: list[Array] = []  # of L⁻¹, each (n, batch)
    for i in range(n):
        rest = jnp.broadcast_to(unit[i], (n, lower[0][0].shape[0]))
        for k, row in enumerate(rows):
            rest = rest - lower[i][k][None] * row
        rows.append(rest * lower[i][i][None])
    inverse = jnp.moveaxis(jnp.stack(rows), 2, 0)
    return jnp.matmul(jnp.swapaxes(inverse, 1, 2), inverse)


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
