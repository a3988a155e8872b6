"""A strapdown navigator in JAX, with the calibration inside: outputs in, attitude, velocity and place out.

Local-level frame (east, north, up) on the WGS 84 ellipsoid; per sample of length h,

    C' = −Ω_in C + C Ω_ib          C: case to level; ω_in = Earth rate + transport rate
    v' = C f + g(φ, h) − (2 ω_ie + ω_en) × v
    φ' = v_n / (R_M + h),  λ' = v_e / ((R_N + h) cos φ),  h' = v_u

with the attitude turned exactly by the sample's rotation vector and velocity and place by the midpoint rule.
Positions are metres from an origin, so that all of it works in 32 bits. Everything is differentiable:
`jax.jacfwd` of `navigate` by a `Calibration`'s coefficients maps calibration errors to navigation errors, and
`refine` estimates coefficients from what a run should have shown.

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
from .checks import check_place, check_rotation, check_samples, check_speed


class State(eqx.Module):
    """Where the device is; leading axes are times.

    The position is in metres along the latitude and longitude circles from `origin`, so that 32 bits hold it to
    micrometres near there: east = (R_N₀ + h₀) cos φ₀ (λ − λ₀), north = (R_M₀ + h₀) (φ − φ₀), up = h − h₀. That is a
    linear map of latitude and longitude, exact at any distance.

    Raises `ValueError` for an origin in degrees or an attitude that is no rotation.
    """

    attitude: Float[AnyArray, "*time 3 3"]  # case to level
    velocity: Float[AnyArray, "*time 3"]  # m/s: east, north, up
    origin: Float[AnyArray, "*time 3"]  # latitude and longitude, rad; height, m
    # m from the origin: east, north, up
    position: Float[AnyArray, "*time 3"] = eqx.field(default=None)

    def __init__(
        self,
        attitude: AnyArray,
        velocity: AnyArray,
        origin: AnyArray,
        position: AnyArray | None = None,
    ):
        self.attitude = attitude
        self.velocity = velocity
        self.origin = origin
        self.position = jnp.zeros_like(jnp.asarray(velocity)) if position is None else position

    def __check_init__(self):
        check_place("State(origin=...)", self.origin)
        check_rotation("State(attitude=...)", self.attitude)
        check_speed("State(velocity=...)", self.velocity)

    @property
    def place(self) -> Float[Array, "*time 3"]:
        """Latitude and longitude (rad) and height (m), in JAX's precision."""
        return place_of(jnp.asarray(self.origin), jnp.asarray(self.position))


def scales(origin: Float[AnyArray, "*time 3"]) -> Float[Array, "*time 3"]:
    """Metres of `State.position` per rad of longitude, per rad of latitude and per m of height."""
    origin = jnp.asarray(origin)
    meridian, normal = radii(origin[..., 0])
    height, one = origin[..., 2], jnp.ones_like(origin[..., 2])
    return jnp.stack([(normal + height) * jnp.cos(origin[..., 0]), meridian + height, one], axis=-1)


def place_of(
    origin: Float[AnyArray, "*time 3"], position: Float[AnyArray, "*time 3"]
) -> Float[Array, "*time 3"]:
    """Latitude and longitude (rad) and height (m) of a position (m) from an origin."""
    east, north, up = jnp.moveaxis(jnp.asarray(position) / scales(origin), -1, 0)
    return jnp.asarray(origin) + jnp.stack([north, east, up], axis=-1)


class ImuData(eqx.Module):
    """Outputs of a run at equal steps; each sample is the mean over its step.

    Raises `ValueError` for shapes that do not fit and for numbers that are implausible in these units.
    """

    accel: Float[AnyArray, "time 3"]  # m/s²
    gyro: Float[AnyArray, "time 3"]  # rad/s
    temperature: Float[AnyArray, " time"]  # °C
    step: Scalar | float  # s

    def __check_init__(self):
        # Axes to map over, shapes and other things than arrays may stand in the place of each.
        columns = [isinstance(x, np.ndarray | jax.Array) for x in (self.accel, self.gyro)]
        if all(columns) and not isinstance(self.temperature, jax.ShapeDtypeStruct | None):
            check_samples("ImuData", self)


# Last step of `refine`, in standard deviations, by the digits that numbers have. Rounding moves positions by 1e-9 m
# in 64 bits and by millimetres in 32, and no iteration comes to rest within that.
REFINED = {64: 1e-4, 32: 1e-2}

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


def position_rate(velocity: Vec3, place: Vec3, origin: Vec3) -> Float[Array, "3"]:
    """Rate of `State.position`, m/s: the velocity by the ratio of the circles' radii there and at the origin."""
    return jnp.asarray(velocity) * scales(origin) / scales(place)


def advance(state: State, force: Vec3, rate: Vec3, step: Scalar | float) -> State:
    """One sample: specific force (m/s²) and absolute rate (rad/s) in the case frame over `step` s."""
    return _plus(state, _increments(state, force, rate, step))


def _plus(state: State, increments: tuple[Array, Array, Array]) -> State:
    now = tuple(jnp.asarray(x) + dx for x, dx in zip(_moved(state), increments, strict=True))
    return eqx.tree_at(_moved, state, now)


def _moved(state):  # untyped, as `tree_at` calls it with what is no state
    return state.attitude, state.velocity, state.position


def _increments(
    state: State, force: Vec3, rate: Vec3, step: Scalar | float
) -> tuple[Array, Array, Array]:
    """Changes of attitude, velocity and position in one sample, each to its own relative rounding."""
    c, v, p, origin = (
        jnp.asarray(x) for x in (state.attitude, state.velocity, state.position, state.origin)
    )
    h, force = jnp.asarray(step), jnp.asarray(force)
    one = jnp.eye(3, dtype=c.dtype)
    place = place_of(origin, p)
    half_turn = rotation.exp(0.5 * h * jnp.asarray(rate))
    half = (one + _level_turn(0.5 * h, v, place)) @ c @ half_turn
    middle_v = v + 0.5 * h * acceleration(half @ force, v, place)
    middle = place_of(origin, p + 0.5 * h * position_rate(v, place, origin))
    turn = rotation.exp_less_identity(h * jnp.asarray(rate))
    # (E + l) C (E + r) − C
    change = _level_turn(h, middle_v, middle) @ (c + c @ turn) + c @ turn
    return (
        change,
        h * acceleration(half @ force, middle_v, middle),
        h * position_rate(middle_v, middle, origin),
    )


def _level_turn(time: Array, velocity: Array, place: Array) -> Float[Array, "3 3"]:
    """The rotation from the old to the new level frame less E, to second order: Earth rate turns it by
    7e-5 rad in a second, so that what is left out is 6e-14 rad for a step of 1 s."""
    level = earth.earth_rate(place[0]) + transport_rate(velocity, place)
    turn = rotation.skew(-time * level)
    return turn + 0.5 * turn @ turn


def navigate(compensation: Compensation | Calibration, data: ImuData, start: State) -> State:
    """The states after every sample, with the outputs compensated inside the loop.

    Sums are compensated (Kahan 1965): what rounding takes from a step is given to the next one, so that a run of
    an hour in 32 bits is as good as its samples.

    **Arguments:** `compensation(accel, gyro, temperature)` is a `Calibration` or any function like it.
    """

    def one(carry: tuple[State, State], sample: tuple[Array, ...]) -> tuple[tuple, State]:
        state, lost = carry
        force, rate = compensation(*sample)
        steps = _increments(state, force, rate, data.step)
        turned, faster, further = _moved(lost)
        steps = steps[0] - turned, steps[1] - faster, steps[2] - further
        after = _plus(state, steps)
        added = (a - b for a, b in zip(_moved(after), _moved(state), strict=True))
        lost = eqx.tree_at(_moved, lost, tuple(a - dx for a, dx in zip(added, steps, strict=True)))
        return (after, lost), after

    samples = (jnp.asarray(data.accel), jnp.asarray(data.gyro), jnp.asarray(data.temperature))
    start = jax.tree.map(jnp.asarray, start)
    nothing = jax.tree.map(jnp.zeros_like, start)
    return jax.lax.scan(one, (start, nothing), samples)[1]


def errors(state: State, truth: State) -> Float[Array, "9"]:
    """Navigation error of one state: position (m: east, north, up), velocity (m/s: the same), and the rotation vector
    (rad, about east, north and up of the level frame) that takes the true attitude to the other,
    log(C Cᵀ_true); its third component is heading."""
    here = scales(place_of(truth.origin, truth.position))
    apart = (jnp.asarray(state.origin) - jnp.asarray(truth.origin))[jnp.array([1, 0, 2])]
    metres = lambda s: jnp.asarray(s.position) * (here / scales(s.origin))
    position = metres(state) - metres(truth) + apart * here
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

    origin = jnp.asarray(start)

    def move(carry: tuple[Array, Array], t: Array) -> tuple[tuple[Array, Array], tuple]:
        # Fourth order, so that the truth is far better than the navigator's second order.
        position, lost = carry
        speed = lambda moved, t: position_rate(velocity(t), place_of(origin, moved), origin)
        k1 = speed(position, t)
        k2 = speed(position + 0.5 * step * k1, t + 0.5 * step)
        k3 = speed(position + 0.5 * step * k2, t + 0.5 * step)
        k4 = speed(position + step * k3, t + step)
        change = step / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4) - lost
        after = position + change
        middle = place_of(origin, position + 0.5 * step * 0.5 * (k2 + k3))
        return (after, (after - position) - change), (after, middle)

    nowhere = jnp.zeros_like(origin)
    times = jnp.asarray(step) * jnp.arange(count, dtype=origin.dtype)
    _, (positions, middles) = jax.lax.scan(move, (nowhere, nowhere), times)

    def read(t: Array, place: Array) -> tuple[Array, Array]:
        one = jnp.ones_like(t)
        (v, c), (v_rate, c_rate) = jax.jvp(path, (t,), (one,))
        level = earth.earth_rate(place[0]) + transport_rate(v, place)
        rate = rotation.unskew(c.T @ c_rate) + c.T @ level
        return c.T @ (v_rate - acceleration(jnp.zeros(3), v, place)), rate

    force, rate = jax.vmap(read)(times + 0.5 * step, middles)
    v, c = jax.vmap(path)(times + step)
    v0, c0 = path(jnp.zeros(()))
    origins = jnp.broadcast_to(origin, positions.shape)
    return force, rate, State(c0, v0, origin), State(c, v, origins, positions)


# Sensitivity and refinement ----------------------------------------------------------------------


def with_coefficients(calibration: Calibration, values: Float[AnyArray, " values"]) -> Calibration:
    """The calibration with all curve coefficients replaced: accelerometers' first, row-major.

    Raises `ValueError` for another number of values.
    """
    return calibration.with_values("*", values)


def coefficients_of(calibration: Calibration) -> Float[Array, " values"]:
    """All curve coefficients in one vector, as `with_coefficients` takes them."""
    return jnp.asarray(calibration.coefficients)


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
    problem, so that what the run does not show stays where it was. In 32 bits, which know positions to
    millimetres, the last step is below a hundredth of a standard deviation; fixes of centimetres want 64 bits.
    **Returns** the refined calibration and the `Solution` in the directions' unit.
    """
    before, columns = coefficients_of(calibration), jnp.asarray(directions)

    def rows(x: Array, args: None) -> Array:
        del args
        changed = with_coefficients(calibration, before + columns @ x)
        return jnp.concatenate([residual(navigate(changed, data, start)), x])

    tolerance = REFINED[jnp.finfo(columns.dtype).bits]
    start_at = jnp.zeros(columns.shape[1], columns.dtype)
    solution = least_squares(rows, start_at, solver=gauss_newton(tolerance=tolerance))
    moved = jnp.asarray(solution.parameters)
    return with_coefficients(calibration, before + columns @ moved), solution
