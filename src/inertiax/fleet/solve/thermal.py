"""The invariant accelerometer problem over temperature for many devices in one program.

Parameters are curves θ(T) = φ(T) C. A dwell's Jacobian by the coefficients C is the Kronecker product
φ(T) ⊗ g of the basis and the nine-parameter row g, so

    gradient = Σ φ gᵀ r,    normal matrix = Σ φφᵀ ⊗ ggᵀ,

two matrix products per device: the second form of `procedure.thermal_iterations.normal_matrix` for
`estimators.Invariant`, held to it by `tests/test_fleet.py` through the fits (1e-5 sigma) and to the Kronecker rows by
`tests/test_fleet_moments.py`. Devices on the same plan have nearly the same normal matrix, so one inverse, of their
mean, serves all for the first steps, which leave a few per cent of the way. There each device gets its own normal
matrix, which serves for the steps that are left, until they are small, and for the covariance. A device on a plan of
its own may be led away by the others' inverse: where its sum of squares has not become smaller, it begins again with
its own normal matrix alone, which is made anew after the first steps. A step that makes the sum of squares larger is
taken back and made shorter.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ...numerics.lane_cholesky import inverse_blocks
from ...physics.temperature import AbstractBasis
from .invariant import BatchFit, is_small, predicted, ROUNDINGS


SHARED_STEPS = 5
SOON = 2  # own steps of a device that began again, after which its normal matrix is made anew
EVERY = 6  # own steps, after which those that are not settled get a new one
SHORTER = 0.25  # of a step that led uphill
FLAT = 1e-6  # relative, of a sum of squares: what is no step uphill


class _State(NamedTuple):
    """Of the steps that devices take with their own normal matrices."""

    trial: Float[Array, "batch size 9"]
    base: Float[Array, "batch size 9"]  # the last place that was no worse than those before
    cost: Float[Array, " batch"]  # sum of squares there
    done: Bool[Array, " batch"]
    steps: Int[Array, " batch"]
    steps_taken: Int[Array, ""]
    inverse: Float[Array, "batch unknowns unknowns"]
    scale: Float[Array, "batch size 9"]


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
    others' needs more steps, and all of its call then wait for it.
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

    def moved(residual: Array, row: Array, metric: Array) -> Array:
        slope = jnp.matmul(phi, jnp.swapaxes(row * residual[:, None], 1, 2))
        return jnp.matmul(slope.reshape(-1, 1, size * 9), metric).reshape(-1, size, 9)

    def step(c: Array, metric: Array) -> Array:
        return moved(*rows(c), metric)

    zero = jnp.zeros((batch, size, 9), a.dtype)
    first_residual, first = rows(zero)
    usable = jnp.all(jnp.isfinite(first), axis=(1, 2))
    kept = jnp.where(usable[:, None, None], first, jnp.zeros_like(first))
    # As of one device with the dwells of all.
    joined = (jnp.swapaxes(x, 0, 1).reshape(1, x.shape[1], -1) for x in (phi, kept))
    total = normal_matrices(*joined)
    shared = inverse_blocks(total / batch, 9)
    near = jax.lax.fori_loop(0, SHARED_STEPS, lambda _, c: c + step(c, shared), zero)
    cost = _cost(rows(near)[0])
    lost = ~(cost <= _cost(first_residual))  # also where it is no number
    near = jnp.where(lost[:, None, None], zero, near)
    cost = jnp.where(lost, _cost(first_residual), cost)
    rounding = jnp.square(ROUNDINGS * jnp.finfo(a.dtype).eps) * _cost(w)

    def factorised(c: Array) -> tuple[Array, Array]:
        normal = normal_matrices(phi, rows(c)[1])
        scale = jnp.sqrt(jnp.diagonal(normal, axis1=1, axis2=2)).reshape(zero.shape)
        return inverse_blocks(normal, 9), scale

    def anew(state: _State) -> tuple[Array, Array]:
        inverse, scale = factorised(state.base)
        kept = state.done[:, None, None]
        return jnp.where(kept, state.inverse, inverse), jnp.where(kept, state.scale, scale)

    def refine(state: _State) -> _State:
        taken, done = state.steps_taken, state.done
        due = (taken % EVERY == 0) | ((taken == SOON) & jnp.any(lost & ~done))
        inverse, scale = jax.lax.cond(due, anew, lambda s: (s.inverse, s.scale), state)
        residual, row = rows(state.trial)
        now = _cost(residual)
        worse = ~(now <= (1.0 + FLAT) * state.cost + rounding)
        change = moved(residual, row, inverse)
        # The matrix of a device's beginning is not that of its minimum.
        small = is_small(change, scale, tolerance, axis=(1, 2)) & ~worse & ~(lost & (taken < SOON))
        ahead = jnp.where(
            worse[:, None, None],
            state.base + SHORTER * (state.trial - state.base),
            state.trial + change,
        )
        kept, held = done | worse, done[:, None, None]
        return _State(
            trial=jnp.where(held, state.trial, ahead),
            base=jnp.where(kept[:, None, None], state.base, state.trial),
            cost=jnp.where(kept, state.cost, now),
            done=done | small,
            steps=state.steps + jnp.where(done, 0, 1),
            steps_taken=taken + 1,
            inverse=inverse,
            scale=scale,
        )

    usable &= jnp.all(jnp.isfinite(near), axis=(1, 2))
    begin = _State(
        trial=near,
        base=near,
        cost=cost,
        done=~usable,
        steps=jnp.full(batch, SHARED_STEPS, jnp.int32),
        steps_taken=jnp.zeros((), jnp.int32),
        # The first step makes it, of all that can be solved.
        inverse=jnp.full((batch, size * 9, size * 9), jnp.nan, a.dtype),
        scale=zero,
    )
    going = lambda s: (s.steps_taken + SHARED_STEPS < max_steps) & jnp.any(~s.done)
    end = jax.lax.while_loop(going, refine, begin)
    c, own = end.trial, end.inverse
    residual, _ = rows(c)
    units = jnp.tile(jnp.concatenate([jnp.full((3,), gravity), jnp.ones((6,), a.dtype)]), size)
    misfit = jnp.where(w > 0, residual / jnp.where(w > 0, w, jnp.ones_like(w)), jnp.zeros_like(w))
    return BatchFit(
        parameters=c.reshape(-1, size * 9) * units[None],
        covariance=own * (units[:, None] * units[None, :])[None],
        misfit=(misfit * gravity)[:, :, None],
        converged=end.done & usable,
        num_steps=end.steps,
    )


def _cost(residual: Float[Array, "batch dwells"]) -> Float[Array, " batch"]:
    return jnp.sum(jnp.square(residual), axis=1)


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
