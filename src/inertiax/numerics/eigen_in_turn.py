"""Eigenvalues and eigenvectors of one symmetric matrix after the other under JAX, with their derivative."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float


@jax.custom_batching.sequential_vmap
def _eigen_in_turn(matrix: Float[Array, "n n"]) -> tuple[Array, Array]:
    values, vectors = jnp.linalg.eigh(matrix)
    return values, vectors


@jax.custom_jvp
def eigen_of_one(matrix: Float[Array, "n n"]) -> tuple[Array, Array]:
    """Of one matrix, in turn under `vmap`; see `linear_algebra.symmetric_eigen`."""
    return _eigen_in_turn(matrix)


@eigen_of_one.defjvp
def _eigen_slope(primals: tuple[Array], tangents: tuple[Array]):
    values, vectors = eigen_of_one(*primals)
    change = vectors.T @ (0.5 * (tangents[0] + tangents[0].T)) @ vectors
    gap = values[None, :] - values[:, None]
    turn = jnp.where(gap == 0.0, 0.0, change / jnp.where(gap == 0.0, 1.0, gap))
    return (values, vectors), (jnp.diagonal(change), vectors @ turn)
