"""Small dense linear algebra: Cholesky without LAPACK under JAX, the same inverse on the host, eigenvalues in turn.

Calibration problems are tall and narrow (tens to thousands of rows, 3 to 100 columns): normal equations with scaled
columns are accurate enough there. Under JAX they are written out in plain `jnp`: a batch rides in the vector lanes,
and LAPACK-backed solves under `vmap` dead-lock in some jaxlib versions on CPU.
"""

import numpy as np
from jaxtyping import Float
from numpy.typing import DTypeLike

from .._jax import Array, jax, jnp
from .._typing import AnyArray


# Up to this size a factorisation is unrolled into scalars (batch in the vector lanes); beyond it a
# loop over columns keeps compile time independent of the size.
_UNROLLED = 12


def cholesky(matrix: Float[Array, "n n"]) -> Float[Array, "n n"]:
    """Lower factor L of a symmetric positive definite matrix, L Lᵀ = A, without LAPACK.

    Not-positive pivots give NaN, which the callers turn into an outcome.
    """
    return _cholesky_unrolled(matrix) if matrix.shape[0] <= _UNROLLED else _cholesky_loop(matrix)


def _cholesky_unrolled(matrix: Float[Array, "n n"]) -> Float[Array, "n n"]:
    n = matrix.shape[0]
    zero = jnp.zeros((), matrix.dtype)
    rows = [[zero] * n for _ in range(n)]
    for j in range(n):
        pivot = matrix[j, j] - sum((rows[j][k] ** 2 for k in range(j)), zero)
        rows[j][j] = jnp.sqrt(pivot)
        for i in range(j + 1, n):
            inner = sum((rows[i][k] * rows[j][k] for k in range(j)), zero)
            rows[i][j] = (matrix[i, j] - inner) / rows[j][j]
    return jnp.stack([jnp.stack(row) for row in rows])


def _cholesky_loop(matrix: Float[Array, "n n"]) -> Float[Array, "n n"]:
    n = matrix.shape[0]
    below = jnp.arange(n)

    def eliminate(j, carry):
        rest, lower = carry
        column = jnp.where(below >= j, rest[:, j], jnp.zeros_like(rest[:, j])) / jnp.sqrt(
            rest[j, j]
        )
        return rest - jnp.outer(column, column), lower.at[:, j].set(column)

    _, lower = jax.lax.fori_loop(0, n, eliminate, (matrix, jnp.zeros_like(matrix)))
    return lower


def cholesky_solve(
    lower: Float[Array, "n n"], right: Float[Array, "n *columns"]
) -> Float[Array, "n *columns"]:
    """Solve L Lᵀ x = b by substitution, without LAPACK; `right` is a vector or has columns."""
    n = lower.shape[0]

    def forward(i, y):
        return y.at[i].set((y[i] - lower[i] @ y.at[i].set(0.0)) / lower[i, i])

    def backward(k, x):
        i = n - 1 - k
        return x.at[i].set((x[i] - lower[:, i] @ x.at[i].set(0.0)) / lower[i, i])

    # Entries not yet solved must not enter the inner product: L is zero above the diagonal, so a
    # plain product with the running vector is right in both directions.
    if n <= _UNROLLED:
        solution = _substitute_unrolled(lower, right)
    else:
        solution = jax.lax.fori_loop(0, n, forward, right)
        solution = jax.lax.fori_loop(0, n, backward, solution)
    return solution


def _substitute_unrolled(
    lower: Float[Array, "n n"], right: Float[Array, "n *columns"]
) -> Float[Array, "n *columns"]:
    n = lower.shape[0]
    y: list[Array] = []
    for i in range(n):
        known = [lower[i, k] * y[k] for k in range(i)]
        y.append((right[i] - sum(known, jnp.zeros_like(right[i]))) / lower[i, i])
    x: list[Array] = [jnp.zeros_like(v) for v in y]
    for i in reversed(range(n)):
        known = [lower[k, i] * x[k] for k in range(i + 1, n)]
        x[i] = (y[i] - sum(known, jnp.zeros_like(y[i]))) / lower[i, i]
    return jnp.stack(x)


def singular_pivot(dtype: DTypeLike) -> float:
    """Squared pivots of a normal matrix of unit diagonal at or below this count as zero, $\\varepsilon^{3/4}$.

    Where the rows do not determine the unknowns, the last pivot is a sum of rounding errors of either sign,
    so that a test of its sign alone misses some (53 of 600 random ones). At the limit (condition numbers of $10^6$
    in float64, 400 in float32) a solution of the normal equations keeps a quarter of its digits.
    """
    return float(np.finfo(dtype).eps) ** 0.75


def regular_cholesky(scaled: Float[Array, "n n"]) -> Float[Array, "n n"]:
    """`cholesky` of a matrix of unit diagonal; NaN throughout where it is singular but for rounding."""
    lower = cholesky(scaled)
    smallest = jnp.min(jnp.square(jnp.diagonal(lower)))
    return jnp.where(smallest > singular_pivot(scaled.dtype), lower, jnp.nan)


def spd_inverse(matrix: Float[Array, "n n"]) -> Float[Array, "n n"]:
    """Inverse of a symmetric positive definite matrix, rows and columns scaled to unit diagonal
    first (parameters of different units would spoil the pivots); NaN where it is singular."""
    scale = jax.lax.rsqrt(jnp.diagonal(matrix))
    scaled = matrix * scale[:, None] * scale[None, :]
    identity = jnp.eye(matrix.shape[0], dtype=matrix.dtype)
    inverse = cholesky_solve(regular_cholesky(scaled), identity)
    return inverse * scale[:, None] * scale[None, :]


def scaled_inverse(normal: Float[np.ndarray, "n n"]) -> Float[np.ndarray, "n n"]:
    """`spd_inverse` on the host, by NumPy; NaN throughout where the matrix is singular or not finite."""
    found = scaled_factor(normal)
    if found is None:
        return np.full_like(normal, np.nan)
    lower, scale = found
    root = np.linalg.solve(lower, np.diag(scale))
    return root.T @ root


def scaled_factor(
    normal: Float[np.ndarray, "n n"],
) -> tuple[Float[np.ndarray, "n n"], Float[np.ndarray, " n"]] | None:
    """L and s with L Lᵀ = diag(s) A diag(s) of unit diagonal; `None` where A is singular or not finite."""
    diagonal = np.diagonal(normal)
    if not (np.all(np.isfinite(normal)) and np.all(diagonal > 0)):
        return None
    scale = 1.0 / np.sqrt(diagonal)
    try:
        lower = np.linalg.cholesky(normal * np.outer(scale, scale))
    except np.linalg.LinAlgError:
        return None
    regular = np.min(np.diagonal(lower)) ** 2 > singular_pivot(normal.dtype)
    return (lower, scale) if regular else None


def symmetric_eigen(
    matrix: Float[AnyArray, "*batch n n"],
) -> tuple[Float[AnyArray, "*batch n"], Float[AnyArray, "*batch n n"]]:
    """Eigenvalues, which increase, and eigenvectors (columns) of symmetric matrices; NumPy for NumPy, JAX for JAX.

    Under JAX one matrix after the other, also under `vmap`: two batched calls of LAPACK in one program can wait for
    each other for good (jaxlib 0.10 on two cores). Equal eigenvalues, whose vectors have no derivative, count as
    if they stayed equal.
    """
    if isinstance(matrix, np.ndarray):
        return np.linalg.eigh(matrix)
    from .eigen_in_turn import eigen_of_one  # needs JAX to be imported

    return jnp.vectorize(eigen_of_one, signature="(n,n)->(n),(n,n)")(matrix)
