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

Devices stand last in every array, and what is worked out element by element stands in one row of dwells and devices:
products of small matrices and short loops cost more than their arithmetic. Only the sums of a normal matrix are
products of matrices.
"""

import functools
from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ...estimators.invariant import _COLUMNS, _ROWS
from ...numerics.lane_cholesky import inverse_blocks, invert_lanes_by_blocks
from ...numerics.own_kernels import kept
from ...physics.temperature import AbstractBasis, Polynomial
from .invariant import BatchFit, is_small, ROUNDINGS
from .moments import sum_of_parts, sum_of_terms, TERMS


SHARED_STEPS = 5
SOON = 2  # own steps of a device that began again, after which its normal matrix is made anew
EVERY = 6  # own steps, after which those that are not settled get a new one
SHORTER = 0.25  # of a step that led uphill
FLAT = 1e-6  # relative, of a sum of squares: what is no step uphill


class _State(NamedTuple):
    """Of the steps that devices take with their own normal matrices."""

    trial: Float[Array, "size 9 batch"]
    base: Float[Array, "size 9 batch"]  # the last place that was no worse than those before
    cost: Float[Array, " batch"]  # sum of squares there
    done: Bool[Array, " batch"]
    steps: Int[Array, " batch"]
    steps_taken: Int[Array, ""]
    inverse: Float[Array, "unknowns unknowns batch"]
    scale: Float[Array, "size 9 batch"]


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
    # Devices last, where they fill the vector lanes.
    size, batch = basis.size, len(weights)
    over, pairs = _products_of(basis)
    over = jnp.transpose(jax.vmap(jax.vmap(over))(temperature), (2, 1, 0))
    phi = over[:size]
    # What is worked out element by element, in one row: loops of few devices are no vectors.
    a = jnp.transpose(outputs, (2, 1, 0)).reshape(3, -1) / gravity
    w = (weights.T * gravity).reshape(-1)
    shape = weights.T.shape

    def rows(c: Array) -> tuple[Array, Array, Array]:
        theta = _along(phi, c).reshape(9, -1)
        over_scale = _reciprocals(theta)
        force = _forces(theta, a, over_scale)
        back = jax.lax.rsqrt(_square(force))
        residual = (_square(force) * back - 1.0) * w
        return residual, _turned(theta, force, back, over_scale), force

    def moved(c: Array, metric: Array) -> tuple[Array, Array]:
        """Weighted residuals, and a step with an inverse normal matrix: all devices' or each one's."""
        residual, turned, force = rows(c)
        pulls = _columns(turned, force, residual * w).reshape(9, *shape)
        slope = _over_dwells(phi, pulls).reshape(size * 9, batch)
        change = jnp.matmul(metric, slope) if metric.ndim == 2 else _of_each(metric, slope)
        return residual.reshape(shape), change.reshape(size, 9, batch)

    def misfits(c: Array) -> Array:
        return rows(c)[0].reshape(shape)

    zero = jnp.zeros((size, 9, batch), a.dtype)
    first = _columns(*rows(zero)[1:], w).reshape(9, *shape)
    usable = jnp.all(jnp.isfinite(first), axis=(0, 1))
    kept_rows = jnp.where(usable, first, jnp.zeros_like(first))
    mean = jnp.mean(normal_matrices(over, kept_rows, pairs), axis=2)
    shared = inverse_blocks(mean[None], 9)[0]
    near = jax.lax.fori_loop(0, SHARED_STEPS, lambda _, c: c + moved(c, shared)[1], zero)
    cost, before = _cost(misfits(near)), _cost(misfits(zero))
    lost = ~(cost <= before)  # also where it is no number
    near = jnp.where(lost, zero, near)
    cost = jnp.where(lost, before, cost)
    rounding = jnp.square(ROUNDINGS * jnp.finfo(a.dtype).eps) * _cost(w.reshape(shape))

    def factorised(c: Array) -> tuple[Array, Array]:
        normal = normal_matrices(over, _columns(*rows(c)[1:], w).reshape(9, *shape), pairs)
        scale = jnp.sqrt(jnp.diagonal(normal, axis1=0, axis2=1)).T.reshape(zero.shape)
        return invert_lanes_by_blocks(normal, 9), scale

    def anew(state: _State) -> tuple[Array, Array]:
        inverse, scale = factorised(state.base)
        kept = state.done
        return jnp.where(kept, state.inverse, inverse), jnp.where(kept, state.scale, scale)

    def refine(state: _State) -> _State:
        taken, done = state.steps_taken, state.done
        due = (taken % EVERY == 0) | ((taken == SOON) & jnp.any(lost & ~done))
        inverse, scale = jax.lax.cond(due, anew, lambda s: (s.inverse, s.scale), state)
        residual, change = moved(state.trial, inverse)
        now = _cost(residual)
        worse = ~(now <= (1.0 + FLAT) * state.cost + rounding)
        # The matrix of a device's beginning is not that of its minimum.
        small = is_small(change, scale, tolerance, axis=(0, 1)) & ~worse & ~(lost & (taken < SOON))
        ahead = jnp.where(
            worse, state.base + SHORTER * (state.trial - state.base), state.trial + change
        )
        stays = done | worse
        return _State(
            trial=jnp.where(done, state.trial, ahead),
            base=jnp.where(stays, state.base, state.trial),
            cost=jnp.where(stays, state.cost, now),
            done=done | small,
            steps=state.steps + jnp.where(done, 0, 1),
            steps_taken=taken + 1,
            inverse=inverse,
            scale=scale,
        )

    usable &= jnp.all(jnp.isfinite(near), axis=(0, 1))
    begin = _State(
        trial=near,
        base=near,
        cost=cost,
        done=~usable,
        steps=jnp.full(batch, SHARED_STEPS, jnp.int32),
        steps_taken=jnp.zeros((), jnp.int32),
        # The first step makes it, of all that can be solved.
        inverse=jnp.full((size * 9, size * 9, batch), jnp.nan, a.dtype),
        scale=zero,
    )
    going = lambda s: (s.steps_taken + SHARED_STEPS < max_steps) & jnp.any(~s.done)
    end = jax.lax.while_loop(going, refine, begin)
    c, own = end.trial, end.inverse
    units = jnp.tile(jnp.concatenate([jnp.full((3,), gravity), jnp.ones((6,), a.dtype)]), size)
    weight = w.reshape(shape)
    counted = jnp.where(weight > 0, weight, jnp.ones_like(weight))
    misfit = jnp.where(weight > 0, misfits(c) / counted, jnp.zeros_like(weight))
    return BatchFit(
        parameters=c.reshape(size * 9, batch).T * units[None],
        covariance=jnp.moveaxis(own, 2, 0) * (units[:, None] * units[None, :])[None],
        misfit=(misfit * gravity).T[:, :, None],
        converged=end.done & usable,
        num_steps=end.steps,
    )


def _cost(residual: Float[Array, "dwells batch"]) -> Float[Array, " batch"]:
    return jnp.sum(jnp.square(residual), axis=0)


# --- element by element: second form of `invariant.predicted`, in one row of dwells and devices ----------------


@kept
def _reciprocals(theta: Float[Array, "9 row"]) -> Float[Array, "3 row"]:
    return 1.0 / (1.0 + jnp.stack([theta[3], theta[5], theta[8]]))


@kept
def _forces(theta: Array, a: Array, over_scale: Array) -> Float[Array, "3 row"]:
    b0, b1, b2, _, g10, _, g20, g21, _ = theta
    d0, d1, d2 = over_scale
    f0 = (a[0] - b0) * d0
    f1 = (a[1] - b1 - g10 * f0) * d1
    return jnp.stack([f0, f1, (a[2] - b2 - g20 * f0 - g21 * f1) * d2])


@kept
def _square(force: Array) -> Float[Array, " row"]:
    return force[0] * force[0] + force[1] * force[1] + force[2] * force[2]


@kept
def _turned(theta: Array, force: Array, back: Array, over_scale: Array) -> Float[Array, "3 row"]:
    """(E + Γ)⁻ᵀ f/‖f‖: minus the derivatives of ‖f‖ by the bias."""
    _, _, _, _, g10, _, g20, g21, _ = theta
    d0, d1, d2 = over_scale
    v2 = force[2] * back * d2
    v1 = (force[1] * back - g21 * v2) * d1
    return jnp.stack([(force[0] * back - g10 * v1 - g20 * v2) * d0, v1, v2])


@kept
def _columns(turned: Array, force: Array, weight: Array) -> Float[Array, "9 row"]:
    """Minus the derivatives by the nine parameters, times a weight."""
    v = [x * weight for x in turned]
    return jnp.stack([*v, *(v[i] * force[j] for i, j in zip(_ROWS, _COLUMNS, strict=True))])


# --- sums ---------------------------------------------------------------------------------------------------------


@kept
def _along(phi: Array, c: Array) -> Float[Array, "9 dwells batch"]:
    """Parameters at every dwell, φ C."""
    terms = (phi[k][None] * c[k][:, None] for k in range(len(phi)))
    return functools.reduce(jnp.add, terms)


def _over_dwells(phi: Array, pulls: Array) -> Float[Array, "size 9 batch"]:
    """Σ φ gᵀ over dwells, in parts: one long sum waits for itself at every term."""
    dwells, batch = phi.shape[1:]
    terms = next((t for t in range(TERMS, TERMS // 2, -1) if dwells % t == 0), TERMS)
    parts = -(-dwells // terms)
    if parts * terms != dwells:
        missing = ((0, 0), (0, terms * parts - dwells), (0, 0))
        phi, pulls = jnp.pad(phi, missing), jnp.pad(pulls, missing)
    x, y = (z.reshape(len(z), terms, -1) for z in (phi, pulls))
    return sum_of_parts(sum_of_terms(x, y).reshape(len(x), len(y), parts, batch))


@kept
def _of_each(matrix: Array, vector: Array) -> Array:
    """Each device's matrix times its vector, in parts."""
    parts = [
        functools.reduce(jnp.add, (matrix[:, k] * vector[None, k] for k in range(s, s + 9)))
        for s in range(0, len(vector), 9)
    ]
    return functools.reduce(jnp.add, parts)


def normal_matrices(
    over: Float[Array, "products dwells batch"],
    rows: Float[Array, "parameters dwells batch"],
    pairs: Int[np.ndarray, "2 size size"],
) -> Float[Array, "unknowns unknowns batch"]:
    """Σ φφᵀ ⊗ ggᵀ of each device, from the products above the diagonals only; for `pairs` see `_products_of`."""
    size, parameters = pairs.shape[1], len(rows)
    place, least = _places(parameters), int(pairs.min())
    right, left = _own_products(_device_first(rows)), _device_first(over[least:])
    sums = _device_last(jnp.matmul(right, jnp.swapaxes(left, 1, 2)))
    one, other = pairs - least
    half = lambda p: sums[place[None, :, None, :], p[:, None, :, None]]
    full = 0.5 * (half(one) + half(other))
    return full.reshape(size * parameters, size * parameters, -1)


@kept
def _device_first(x: Array) -> Array:
    return jnp.moveaxis(x, 2, 0)


@kept
def _device_last(x: Array) -> Array:
    return jnp.moveaxis(x, 0, 2)


@kept
def _own_products(rows: Array) -> Float[Array, "batch pairs dwells"]:
    return jnp.concatenate(
        [rows[:, i, None] * rows[:, : i + 1] for i in range(rows.shape[1])], axis=1
    )


def _products_of(
    basis: AbstractBasis,
) -> tuple[Callable[[Array], Array], Int[np.ndarray, "2 size size"]]:
    """Functions of temperature, first those of the basis, and the two of them whose mean is each product φ_k φ_l.

    Chebyshev's polynomials have T_k T_l = (T_{k+l} + T_{|k−l|})/2, so twice as many make all products.
    """
    k, l = np.indices((basis.size, basis.size))
    if isinstance(basis, Polynomial):
        twice = Polynomial(2 * basis.degree, basis.low, basis.high)
        return twice, np.stack([k + l, np.abs(k - l)])
    i, j = np.tril_indices(basis.size)

    def with_products(temperature: Array) -> Array:
        phi = basis(temperature)
        return jnp.concatenate([phi, phi[i] * phi[j]])

    place = basis.size + _places(basis.size)
    return with_products, np.stack([place, place])


def _places(n: int) -> Int[np.ndarray, "n n"]:
    """Where each of the n² pairs is found among those with i ≥ j."""
    i, j = np.tril_indices(n)
    place = np.zeros((n, n), int)
    place[i, j] = place[j, i] = np.arange(len(i))
    return place
