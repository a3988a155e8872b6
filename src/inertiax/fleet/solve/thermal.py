"""The invariant accelerometer problem over temperature for many devices in one program.

Parameters are curves θ(T) = φ(T) C. A dwell's Jacobian by the coefficients C is the Kronecker product
φ(T) ⊗ g of the basis and the nine-parameter row g, so

    gradient = Σ φ gᵀ r,    normal matrix = Σ φφᵀ ⊗ ggᵀ,

two matrix products per device: the second form of `procedure.thermal_iterations.normal_matrix` for
`estimators.Invariant`, held to it by `tests/test_fleet.py` through the fits (1e-5 sigma) and to the Kronecker rows by
`tests/test_fleet_moments.py`. Devices on the same plan have nearly the same normal matrix, so one inverse, of their
mean, serves all for the first steps, which leave a few per cent of the way. There each device gets its own normal
matrix, which serves for the steps that are left, until they are small, and for the covariance.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...numerics.lane_cholesky import inverse_blocks
from ...physics.temperature import AbstractBasis
from .invariant import BatchFit, is_small, predicted


SHARED_STEPS = 5


def fit_thermal_invariant(
    outputs: Float[Array, "batch dwells 3"],
    temperature: Float[Array, "batch dwells"],
    weights: Float[Array, "batch dwells"],
    gravity: Float[Array, ""],
    basis: AbstractBasis,
    *,
    tolerance: float = 1e-6,
    max_steps: int = 40,
) -> BatchFit:
    """Curves of a batch of devices; arguments as for `invariant.fit_invariant`, batch *first*.

    Parameters come row-major `(size, 9)`, in m/s² and per unit. A device whose plan differs much from the
    others' needs more steps, and may not be `converged` within `max_steps`.
    """
    # Dwells last, where they fill the vector lanes.
    a = jnp.moveaxis(outputs, 2, 0) / gravity
    w = weights * gravity
    phi = jnp.moveaxis(jax.vmap(jax.vmap(basis))(temperature), 2, 1)
    size, batch = basis.size, len(weights)

    def rows(c: Array) -> tuple[Array, Array]:
        theta = jnp.moveaxis(jnp.matmul(jnp.swapaxes(c, 1, 2), phi), 1, 0)
        magnitude, columns = predicted(theta, a)
        return (magnitude - 1.0) * w, jnp.stack([x * w for x in columns], axis=1)

    def gradient(c: Array) -> Array:
        residual, row = rows(c)
        return jnp.matmul(phi, jnp.swapaxes(row * residual[:, None], 1, 2))

    def step(c: Array, metric: Array) -> Array:
        return jnp.matmul(gradient(c).reshape(-1, 1, size * 9), metric).reshape(c.shape)

    zero = jnp.zeros((batch, size, 9), a.dtype)
    first = rows(zero)[1]
    usable = jnp.all(jnp.isfinite(first), axis=(1, 2))
    kept = jnp.where(usable[:, None, None], first, jnp.zeros_like(first))
    # As of one device with the dwells of all.
    joined = (jnp.swapaxes(x, 0, 1).reshape(1, x.shape[1], -1) for x in (phi, kept))
    total = normal_matrices(*joined)
    shared = inverse_blocks(total / batch, 9)
    near = jax.lax.fori_loop(0, SHARED_STEPS, lambda _, c: c + step(c, shared), zero)
    normal = normal_matrices(phi, rows(near)[1])
    own = inverse_blocks(normal, 9)
    scale = jnp.sqrt(jnp.diagonal(normal, axis1=1, axis2=2)).reshape(zero.shape)

    def unsettled(state):
        return (state[1] < max_steps) & jnp.any(~state[2])

    def refine(state):
        c, k, done, steps = state
        change = step(c, own)
        small = is_small(change, scale, tolerance, axis=(1, 2))
        c = jnp.where(done[:, None, None], c, c + change)
        return c, k + 1, done | small, steps + jnp.where(done, 0, 1)

    usable &= jnp.all(jnp.isfinite(near), axis=(1, 2))
    taken = jnp.full(batch, SHARED_STEPS, jnp.int32)
    c, _, done, steps = jax.lax.while_loop(unsettled, refine, (near, SHARED_STEPS, ~usable, taken))
    residual, _ = rows(c)
    units = jnp.tile(jnp.concatenate([jnp.full((3,), gravity), jnp.ones((6,), a.dtype)]), size)
    misfit = jnp.where(w > 0, residual / jnp.where(w > 0, w, jnp.ones_like(w)), jnp.zeros_like(w))
    return BatchFit(
        parameters=c.reshape(-1, size * 9) * units[None],
        covariance=own * (units[:, None] * units[None, :])[None],
        misfit=(misfit * gravity)[:, :, None],
        converged=done & usable,
        num_steps=steps,
    )


def normal_matrices(
    phi: Float[Array, "batch size dwells"], rows: Float[Array, "batch parameters dwells"]
) -> Float[Array, "batch unknowns unknowns"]:
    """Σ φφᵀ ⊗ ggᵀ of each device, from the products above the diagonals only."""
    size, parameters = phi.shape[1], rows.shape[1]
    of_phi, place_phi = _pairs(size)
    of_row, place_row = _pairs(parameters)
    left = phi[:, of_phi[0]] * phi[:, of_phi[1]]
    right = rows[:, of_row[0]] * rows[:, of_row[1]]
    sums = jnp.matmul(left, jnp.swapaxes(right, 1, 2))
    full = sums[:, place_phi[:, None, :, None], place_row[None, :, None, :]]
    return full.reshape(-1, size * parameters, size * parameters)


def _pairs(n: int) -> tuple[tuple[np.ndarray, np.ndarray], np.ndarray]:
    """Pairs i ≥ j of n indices, and where each of all n² pairs is found among them."""
    i, j = np.tril_indices(n)
    place = np.zeros((n, n), int)
    place[i, j] = place[j, i] = np.arange(len(i))
    return (i, j), place
