"""A strapdown navigator in JAX, with the calibration inside: outputs in, attitude, velocity and place out.

Local-level frame (east, north, up) on the WGS 84 ellipsoid; per sample of length h,

    C' = −Ω_in C + C Ω_ib          C: case to level; ω_in = Earth rate + transport rate
    v' = C f + g(φ, h) − (2 ω_ie + ω_en) × v
    φ' = v_n / (R_M + h),  λ' = v_e / ((R_N + h) cos φ),  h' = v_u

with the attitude turned exactly by the sample's rotation vector and velocity and place by the midpoint rule.
Everything is differentiable: `jax.jacfwd` of `navigate` by a `Calibration`'s coefficients maps calibration
errors to navigation errors, and `refine` estimates coefficients from what a run should have shown.

Sampled rates are taken as constant over a sample; coning and sculling inside one are left out.

**Reference:** Titterton and Weston, *Strapdown Inertial Navigation Technology*, 2nd ed., IET 2004, ch. 3.
"""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._typing import AnyArray, Scalar, Vec3
from ..calibration.calibration import Calibration
from ..numerics.least_squares import gauss_newton, least_squares, Solution
from ..physics import earth, rotation


class State(eqx.Module):
    """Where the device is; leading axes are times."""

    attitude: Float[AnyArray, "*time 3 3"]  # case to level
    velocity: Float[AnyArray, "*time 3"]  # m/s: east, north, up
    place: Float[AnyArray, "*time 3"]  # latitude and longitude, rad; height, m


class ImuData(eqx.Module):
    """Outputs of a run at equal steps; each sample is the mean over its step."""

    accel: Float[AnyArray, "time 3"]  # m/s²
    gyro: Float[AnyArray, "time 3"]  # rad/s
    temperature: Float[AnyArray, " time"]  # °C
    step: Scalar | float  # s


Compensation = Callable[[Array, Array, Array], tuple[Array, Array]]


def radii(latitude: Scalar | float) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """Meridian and normal radius of curvature of WGS 84 at a latitude (rad), m."""
    e2 = earth.FLATTENING * (2.0 - earth.FLATTENING)
    root = 1.0 - e2 * jnp.sin(jnp.asarray(latitude)) ** 2
    normal = earth.SEMI_MAJOR_AXIS / jnp.sqrt(root)
    return normal * (1.0 - e2) / root, normal


def transport_rate(velocity: Vec3, place: Vec3) -> Float[Array, "3"]:
    """Rate of the local-level frame over the curved Earth (ENU), rad/s."""
    meridian, normal = radii(place[0])
    east, north = velocity[0], velocity[1]
    over = east / (normal + place[2])
    return jnp.stack([-north / (meridian + place[2]), over, over * jnp.tan(place[0])])


def acceleration(force: Vec3, velocity: Vec3, place: Vec3) -> Float[Array, "3"]:
    """v' in the local-level frame from the specific force in the same frame, m/s²."""
    turning = 2.0 * earth.earth_rate(place[0]) + transport_rate(velocity, place)
    down = -earth.rest_force(earth.gravity(place[0], place[2]))
    return jnp.asarray(force) + down - jnp.cross(turning, jnp.asarray(velocity))


def place_rate(velocity: Vec3, place: Vec3) -> Float[Array, "3"]:
    """Rate of latitude and longitude (rad/s) and of height (m/s)."""
    meridian, normal = radii(place[0])
    return jnp.stack(
        [
            velocity[1] / (meridian + place[2]),
            velocity[0] / ((normal + place[2]) * jnp.cos(place[0])),
            velocity[2],
        ]
    )


def advance(state: State, force: Vec3, rate: Vec3, step: Scalar | float) -> State:
    """One sample: specific force (m/s²) and absolute rate (rad/s) in the case frame over `step` s."""
    c, v, p = (jnp.asarray(x) for x in (state.attitude, state.velocity, state.place))
    h, force = jnp.asarray(step), jnp.asarray(force)
    half_turn = rotation.exp(0.5 * h * jnp.asarray(rate))
    half = _level_turn(0.5 * h, v, p) @ c @ half_turn
    middle_v = v + 0.5 * h * acceleration(half @ force, v, p)
    middle_p = p + 0.5 * h * place_rate(v, p)
    return State(
        attitude=_level_turn(h, middle_v, middle_p) @ c @ half_turn @ half_turn,
        velocity=v + h * acceleration(half @ force, middle_v, middle_p),
        place=p + h * place_rate(middle_v, middle_p),
    )


def _level_turn(time: Array, velocity: Array, place: Array) -> Float[Array, "3 3"]:
    """The rotation from the old to the new level frame, to second order: Earth rate turns it by
    7e-5 rad in a second, so that what is left out is 6e-14 rad for a step of 1 s."""
    level = earth.earth_rate(place[0]) + transport_rate(velocity, place)
    turn = rotation.skew(-time * level)
    return jnp.eye(3, dtype=turn.dtype) + turn + 0.5 * turn @ turn


def navigate(compensation: Compensation | Calibration, data: ImuData, start: State) -> State:
    """The states after every sample, with the outputs compensated inside the loop.

    **Arguments:** `compensation(accel, gyro, temperature)` is a `Calibration` or any function like it.
    """

    def one(state: State, sample: tuple[Array, Array, Array]) -> tuple[State, State]:
        force, rate = compensation(*sample)
        after = advance(state, force, rate, data.step)
        return after, after

    samples = (jnp.asarray(data.accel), jnp.asarray(data.gyro), jnp.asarray(data.temperature))
    return jax.lax.scan(one, jax.tree.map(jnp.asarray, start), samples)[1]


def errors(state: State, truth: State) -> Float[Array, "9"]:
    """Navigation error of one state: position (m: east, north, up), velocity (m/s), and the small
    rotation of the level frame (rad) by which the attitude is off; its third component is heading."""
    p, q = jnp.asarray(state.place), jnp.asarray(truth.place)
    meridian, normal = radii(q[0])
    off = p - q
    position = jnp.stack(
        [off[1] * (normal + q[2]) * jnp.cos(q[0]), off[0] * (meridian + q[2]), off[2]]
    )
    turned = jnp.asarray(state.attitude) @ jnp.asarray(truth.attitude).T
    return jnp.concatenate(
        [position, jnp.asarray(state.velocity) - jnp.asarray(truth.velocity), rotation.log(turned)]
    )


# Trajectories ------------------------------------------------------------------------------------


Path = Callable[[Array], tuple[Array, Array]]


def ideal_data(
    path: Path, start: Vec3, count: int, step: Scalar | float
) -> tuple[Float[Array, "time 3"], Float[Array, "time 3"], State, State]:
    """What ideal triads read along a path, and where the device really was.

    **Arguments:** `path(t)` gives the local-level velocity (m/s) and the rotation from the case to the
    level frame, as smooth functions of time; `start` is latitude, longitude (rad) and height (m);
    `count` steps of `step` s are made.
    **Returns** specific force and rate at the middle of each step, the state at the start, and the
    states after every step. Rates come from differentiating the path, places from integrating it.
    """
    velocity = lambda t: path(t)[0]

    def move(place: Array, t: Array) -> tuple[Array, tuple[Array, Array]]:
        # Fourth order, so that the truth is far better than the navigator's second order.
        k1 = place_rate(velocity(t), place)
        k2 = place_rate(velocity(t + 0.5 * step), place + 0.5 * step * k1)
        k3 = place_rate(velocity(t + 0.5 * step), place + 0.5 * step * k2)
        k4 = place_rate(velocity(t + step), place + step * k3)
        after = place + step / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        return after, (after, place + 0.5 * step * 0.5 * (k2 + k3))

    first = jnp.asarray(start)
    times = jnp.asarray(step) * jnp.arange(count, dtype=first.dtype)
    _, (places, middles) = jax.lax.scan(move, first, times)

    def read(t: Array, place: Array) -> tuple[Array, Array]:
        one = jnp.ones_like(t)
        (v, c), (v_rate, c_rate) = jax.jvp(path, (t,), (one,))
        level = earth.earth_rate(place[0]) + transport_rate(v, place)
        rate = rotation.unskew(c.T @ c_rate) + c.T @ level
        return c.T @ (v_rate - acceleration(jnp.zeros(3), v, place)), rate

    force, rate = jax.vmap(read)(times + 0.5 * step, middles)
    v, c = jax.vmap(path)(times + step)
    v0, c0 = path(jnp.zeros(()))
    return force, rate, State(c0, v0, first), State(c, v, places)


# Sensitivity and refinement ----------------------------------------------------------------------


def with_coefficients(calibration: Calibration, values: Float[AnyArray, " values"]) -> Calibration:
    """The calibration with all curve coefficients replaced: accelerometers' first, row-major."""
    where, offset, new = _triads(calibration), 0, []
    for coefficients in where:
        size = int(np.prod(np.shape(coefficients)))
        new.append(jnp.asarray(values)[offset : offset + size].reshape(np.shape(coefficients)))
        offset += size
    return eqx.tree_at(_triads, calibration, new)


def coefficients_of(calibration: Calibration) -> Float[Array, " values"]:
    """All curve coefficients in one vector, as `with_coefficients` takes them."""
    return jnp.concatenate([jnp.asarray(c).reshape(-1) for c in _triads(calibration)])


def _triads(calibration: Calibration) -> list:
    return [
        triad.curve.coefficients
        for triad in (calibration.accel, calibration.gyro)
        if triad is not None
    ]


def error_sensitivity(
    calibration: Calibration, data: ImuData, start: State, truth: State
) -> Float[Array, "9 values"]:
    """∂(navigation error at the end)/∂(calibration coefficients), by forward differentiation through
    the navigator. `truth` is the state that the last sample should lead to."""

    def final(values: Array) -> Array:
        states = navigate(with_coefficients(calibration, values), data, start)
        return errors(jax.tree.map(lambda x: x[-1], states), truth)

    return jax.jacfwd(final)(coefficients_of(calibration))


def refine(
    calibration: Calibration,
    data: ImuData,
    start: State,
    residual: Callable[[State], Float[Array, " rows"]],
    directions: Float[AnyArray, "values unknowns"],
) -> tuple[Calibration, Solution]:
    """Calibration refined from a run: least squares with the gradient through the navigator.

    **Arguments:** `residual(states)` holds what the run should have shown, in standard deviations (a
    position fix, zero velocity at a stop, …); the coefficients move along the columns of `directions`, whose
    unit is one prior standard deviation each. The prior, unit variance along each column, is part of the
    problem, so that what the run does not show stays where it was.
    **Returns** the refined calibration and the `Solution` in the directions' unit.
    """
    before, columns = coefficients_of(calibration), jnp.asarray(directions)

    def rows(x: Array, args: None) -> Array:
        del args
        changed = with_coefficients(calibration, before + columns @ x)
        return jnp.concatenate([residual(navigate(changed, data, start)), x])

    # Positions are known to 1e-9 m in rounding, so a tighter test would never be met.
    solution = least_squares(rows, jnp.zeros(columns.shape[1]), solver=gauss_newton(tolerance=1e-4))
    moved = jnp.asarray(solution.parameters)
    return with_coefficients(calibration, before + columns @ moved), solution
