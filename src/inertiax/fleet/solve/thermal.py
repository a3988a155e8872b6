"""The invariant accelerometer problem over temperature for many devices in one program.

Where all attitudes come again at all temperatures, the normal matrix (see `thermal_rows`) is the product of one of the
basis and one of the nine rows, whose inverses are small. A step with these leads each device into the neighbourhood of
its minimum. There its whole normal matrix is made, which serves for the steps that are left, until they are small, and
for the covariance. All of this leaves what 32 bits can leave, a millionth of the way, and is done in them, unless
the unknowns are told apart so badly that the inverse asks for more; the steps that are left are taken in full.

Where that first step has not made the sum of squares smaller, a device begins at zero with its whole normal matrix,
which is made anew after the first steps. A step that makes the sum of squares larger is taken back and made shorter.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, Shaped

from ...numerics.own_kernels import kept
from ...physics.temperature import AbstractBasis
from .invariant import BatchFit, remainder, ROUNDINGS
from .moments import largest_of
from .thermal_rows import Coefficients, Matrices, ThermalRows


SOON = 2  # own steps of a device that begins at zero, after which its normal matrix is made anew
EVERY = 6  # own steps, after which those that are not settled get a new one
NEAR = 0.2  # of the sum of squares at zero, above which the first step has not led near
# Largest change of a coefficient by the first own step, in g or per unit, after which the matrix that it was made with
# is right to 1.5 per cent of a standard deviation (0.9 seen at 0.007, 2.1 at 0.01).
FAR = 0.006
SHORTER = 0.25  # of a step that led uphill
FLAT = 1e-6  # relative, of a sum of squares: what is no step uphill
# Variance of an unknown beside that with all others known, up to which its inverse in 32 bits is right to 3e-4.
INFLATION = 300.0


class _Start(NamedTuple):
    """Near each device's minimum."""

    place: Coefficients
    cost: Float[Array, " batch"]
    lost: Bool[Array, " batch"]  # begins at zero
    change: Coefficients  # of the first step from here
    inverse: Matrices
    scale: Coefficients


class _State(NamedTuple):
    """Of the steps that devices take with their own normal matrices."""

    trial: Coefficients
    base: Coefficients  # the last place that was no worse than those before
    cost: Float[Array, " batch"]  # sum of squares there
    size: Float[
        Array, " batch"
    ]  # of the last step, in standard deviations; 0 where none tells of the next
    residual: Float[Array, " row"]  # before the last step
    done: Bool[Array, " batch"]
    steps: Int[Array, " batch"]
    steps_taken: Int[Array, ""]


def fit_thermal_invariant(
    outputs: Float[Array, "batch dwells 3"],
    temperature: Float[Array, "batch dwells"],
    weights: Float[Array, "batch dwells"],
    gravity: Float[Array, ""],
    basis: AbstractBasis,
    *,
    tolerance: float = 1e-5,
    max_steps: int = 40,
) -> BatchFit:
    """Curves of a batch of devices; arguments as for `invariant.fit_invariant`, batch *first*.

    Parameters come row-major `(size, 9)`, in m/s² and per unit. `tolerance` bounds what is left to the minimum, in
    standard deviations. A device that needs more steps has all of its call wait for it.
    """
    given = (outputs, temperature, weights, gravity, basis)
    rows = ThermalRows(*given)
    full, batch = rows.outputs.dtype, len(weights)
    start = _start(ThermalRows(*jax.tree.map(_in_32_bits, given)))
    rounding, coarse = (
        (ROUNDINGS * float(jnp.finfo(of).eps)) ** 2 * rows.total for of in (full, jnp.float32)
    )
    usable = jnp.all(jnp.isfinite(start.place), axis=(0, 1))
    # These wait for an inverse of their own in full.
    poor = usable & _is_poor(start)
    place, scale = start.place.astype(full), start.scale.astype(full)
    change = jnp.where(poor, 0.0, start.change.astype(full))

    def steps_with(inverse: Array, scale: Array, state: _State, most: Array | int) -> _State:
        def refined(state: _State) -> _State:
            done = state.done
            here = rows.at(state.trial)
            change = rows.step(here, inverse).astype(full)
            cost = rows.cost(here)
            worse = ~(cost <= (1.0 + FLAT) * state.cost + rounding)
            size = _largest(change * scale)
            small = remainder(size, size / state.size) < tolerance
            small |= _largest(change) < ROUNDINGS * jnp.finfo(full).eps
            # The matrix of a device's beginning is not that of its minimum.
            small &= ~worse & ~(start.lost & (state.steps_taken < SOON))
            back = state.base + SHORTER * (state.trial - state.base)
            ahead = jnp.where(worse, back, state.trial + change)
            stays = done | worse
            return _State(
                trial=jnp.where(done, state.trial, ahead),
                base=jnp.where(stays, state.base, state.trial),
                cost=jnp.where(stays, state.cost, cost),
                size=jnp.where(worse, 0.0, size),
                residual=here.residual,
                done=done | small,
                steps=state.steps + jnp.where(done, 0, 1),
                steps_taken=state.steps_taken + 1,
            )

        last = jnp.minimum(state.steps_taken + most, max_steps)
        going = lambda s: (s.steps_taken < last) & jnp.any(~s.done)
        return jax.lax.while_loop(going, refined, state)

    state = _State(
        trial=place + change,
        base=place,
        # What 32 bits make of it is no bar.
        cost=start.cost.astype(full) * 1.001 + coarse,
        size=_largest(change * scale),
        residual=jnp.zeros_like(rows.weights),
        done=poor | ~usable,
        steps=jnp.full(batch, 2, jnp.int32),
        steps_taken=jnp.ones((), jnp.int32),
    )
    first = jnp.where(jnp.any(start.lost), SOON, EVERY)
    state = steps_with(start.inverse, scale, state, first)

    state = state._replace(done=state.done & ~poor & ~(usable & (_largest(change) > FAR)))

    units = jnp.tile(jnp.concatenate([jnp.full((3,), gravity), jnp.ones((6,), full)]), basis.size)

    def again(carry: tuple[_State, Array, Array]) -> tuple[_State, Array, Array]:
        state, inverse, scale = carry
        new, new_scale = rows.inverse(rows.at(state.base))
        inverse = jnp.where(state.done, inverse, new)
        scale = jnp.where(state.done, scale, new_scale)
        done = state.done | jnp.isnan(inverse[0, 0])
        state = state._replace(done=done, size=jnp.zeros_like(state.size))
        most = jnp.where(state.steps_taken < 2 * EVERY, SOON, EVERY)
        return steps_with(inverse, scale, state, most), inverse, scale

    def to_the_end() -> tuple[_State, Array]:
        end, inverse, _ = jax.lax.while_loop(
            lambda c: (c[0].steps_taken < max_steps) & jnp.any(~c[0].done),
            again,
            (state, start.inverse.astype(full), scale),
        )
        return end, _in_units(inverse, units)

    end, covariance = jax.lax.cond(
        jnp.all(state.done), lambda: (state, _in_units(start.inverse, units)), to_the_end
    )
    usable &= ~jnp.isnan(covariance[:, 0, 0])
    weight = rows.weights
    misfit = end.residual / jnp.where(weight > 0, weight, jnp.ones_like(weight))
    misfit = jnp.where(weight > 0, misfit, jnp.zeros_like(weight)).reshape(rows.shape)
    return BatchFit(
        parameters=end.trial.reshape(-1, batch).T * units[None],
        covariance=covariance,
        misfit=(misfit * gravity).T[:, :, None],
        converged=end.done & usable,
        num_steps=end.steps,
    )


def _start(rows: ThermalRows) -> _Start:
    zero = rows.at_zero()
    place = rows.step_as_if_apart(zero)
    near, before = rows.at(place), rows.cost(zero)
    lost = ~(rows.cost(near) <= NEAR * before)  # also where it is no number
    place = jnp.where(lost, 0.0, place)
    near = jax.lax.cond(jnp.any(lost), lambda: rows.at(place), lambda: near)
    inverse, scale = rows.inverse(near)
    return _Start(place, rows.cost(near), lost, rows.step(near, inverse), inverse, scale)


def _is_poor(start: _Start) -> Bool[Array, " batch"]:
    """Whether 32 bits are too few for a device's inverse, or there is none."""
    own = jnp.stack([start.inverse[k, k] for k in range(len(start.inverse))])
    return ~(_largest(own.reshape(start.scale.shape) * jnp.square(start.scale)) < INFLATION)


def _in_32_bits(x: Shaped[Array, "..."] | np.ndarray | np.generic | float) -> Array | float:
    return x if isinstance(x, float) else jnp.asarray(x, jnp.float32)


@kept
def _in_units(inverse: Matrices, units: Float[Array, " unknowns"]) -> Array:
    """Covariances, device first."""
    ahead = jnp.moveaxis(inverse, 2, 0).astype(units.dtype)
    return ahead * (units[:, None] * units[None, :])[None]


def _largest(step: Coefficients) -> Float[Array, " batch"]:
    return largest_of(jnp.abs(step).reshape(-1, step.shape[-1]))
