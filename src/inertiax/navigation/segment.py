"""One segment of samples: the means through it, and how errors at its start, noise and calibration come out at its end.

Samples are averages over their step h. With increments α = ω h and β = f h, corrected for coning and sculling by the
sample before,

    α* = α + α₋ × α / 12,    β* = J(α) β + (α₋ × β + β₋ × α)/12

the frame fixed to the Earth moves

    C ← exp(−ω_ie h) C exp(α*),    v ← v + C β* + h (g(p) − 2 ω_ie × v),    p ← p + h (v + v₊)/2

Attitudes are a running product, velocities and positions running sums, so that a segment has no loop over samples.
Errors (see `filter_state`) obey θ' = −ω_ie × θ + C δω, ν' = −C f × θ + C δf − 2 ω_ie × ν + Γ ρ, ρ' = ν; over a
segment of
length T, with S = ∫ C f and D = ∫ (T − t) C f, to first order in ω_ie T and Γ T²,

    θ⁺ = (E − W T) θ,   ν⁺ = (E − 2WT) ν + Γ T ρ − (S× − 2 W D× − (T S − D)× W) θ,   ρ⁺ = ρ + T (E − W T) ν − D× θ

**Reference:** Savage, "Strapdown inertial navigation integration algorithm design", J. Guidance 21 (1998), 19-28 and
208-221 (coning and sculling of two samples).
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..physics import rotation
from ..physics.error_model import (
    AccelerometerErrors,
    compensate_accel,
    compensate_gyro,
    GyroErrors,
    solve3,
)
from .calibration_states import CalibrationStates
from .filter_state import Estimate
from .level_frame import earth_turn, LevelFrame
from .process import drift, drift_columns, SlowNoise
from .se23 import ExtendedPose, so3_left_jacobian


class Samples(eqx.Module):
    """Raw outputs of one segment, the sample before it first; leading axes are segments."""

    accel: Float[Array, "*segments rows 3"]  # m/s²
    gyro: Float[Array, "*segments rows 3"]  # rad/s
    temperature: Float[Array, "*segments rows"]  # °C
    step: Float[Array, "*segments"]  # s


class Transition(eqx.Module):
    """From errors at a segment's start to those at its end; what is not here is a constant or a decay."""

    navigation: Float[Array, "9 9"]
    others: Float[Array, "9 others"]  # from drift and calibration states
    decay: Float[Array, " slow"]
    noise: Float[Array, "9 9"]  # covariance that white noise adds


class _Compensated(eqx.Module):
    force: Float[Array, "rows 3"]  # the sample before the segment first
    rate: Float[Array, "rows 3"]
    # Regressors times functions of temperature, (c, a) row-major.
    accel_regressors: Float[Array, "samples accel_products"]
    gyro_regressors: Float[Array, "samples gyro_products"]
    accel_inverse: Float[Array, "3 3"]  # (E + Γ)⁻¹ at the segment's mean temperature
    gyro_inverse: Float[Array, "3 3"]
    g_sensitivity: Float[Array, "3 3"]  # D/g


def advance(
    estimate: Estimate,
    samples: Samples,
    states: CalibrationStates,
    slow: SlowNoise,
    frame: LevelFrame,
    gravity: Array,
) -> tuple[Estimate, Transition]:
    """The estimate after a segment, and the transition of its errors.

    **Arguments:** `gravity` (m/s²) is the calibration's, by which its g-sensitivity is scaled.
    """
    found = _compensate(estimate, samples, states, gravity)
    pose, (force_response, rate_response), transition = _through(
        estimate.navigation, found.force, found.rate, samples.step, frame
    )
    by_accel, by_gyro = _output_responses(found, force_response, rate_response)
    calibrated = (
        jnp.concatenate(
            [
                states.accel.gather(_by_coefficient(by_accel, found.accel_regressors, 4)),
                states.gyro.gather(_by_coefficient(by_gyro, found.gyro_regressors, 7)),
            ],
            axis=1,
        )
        * jnp.asarray(states.scale)[None, :]
    )
    drifts = jnp.concatenate([by_accel.sum(0), by_gyro.sum(0)], axis=1)
    outputs = jnp.concatenate([by_accel, by_gyro], axis=2) * slow.white[None, None, :]
    noise = jnp.einsum("kai,kbi->ab", outputs, outputs) / samples.step
    others = jnp.concatenate([drift_columns(drifts, slow.decay.shape[0]), calibrated], axis=1)
    after = Estimate(pose, estimate.slow * slow.decay, estimate.calibration)
    return after, Transition(transition, others, slow.decay, noise)


def _compensate(
    estimate: Estimate, samples: Samples, states: CalibrationStates, gravity: Array
) -> _Compensated:
    """Forces and rates of a segment (with the sample before), and what their errors depend on."""
    accel_curve, gyro_curve = states.moved(estimate.calibration)
    off = drift(estimate.slow)

    def parameters(temperature: Array) -> tuple[Array, Array, Array, Array]:
        a, g = states.accel.basis(temperature), states.gyro.basis(temperature)
        return a, g, jnp.tensordot(a, accel_curve, 1), jnp.tensordot(g, gyro_curve, 1)

    def one(accel: Array, gyro: Array, temperature: Array) -> tuple[Array, ...]:
        a, g, accel_p, gyro_p = parameters(temperature)
        force = compensate_accel(
            AccelerometerErrors(accel_p[:, 0], accel_p[:, 1:]), accel - off[:3]
        )
        errors = GyroErrors(gyro_p[:, 0], gyro_p[:, 1:4], gyro_p[:, 4:])
        rate = compensate_gyro(errors, gyro - off[3:], force, gravity)
        unit = jnp.ones((1,), force.dtype)
        of_accel = jnp.outer(jnp.concatenate([unit, force]), a).reshape(-1)
        of_gyro = jnp.outer(jnp.concatenate([unit, rate, force / gravity]), g).reshape(-1)
        return force, rate, of_accel, of_gyro

    found = jax.vmap(one)(samples.accel, samples.gyro, samples.temperature)
    _, _, accel_p, gyro_p = parameters(jnp.mean(samples.temperature[1:]))
    unit = jnp.eye(3, dtype=accel_p.dtype)
    inverse = lambda m: jax.vmap(solve3, in_axes=(None, 1), out_axes=1)(unit + m, unit)
    return _Compensated(
        found[0], found[1], found[2][1:], found[3][1:],
        inverse(accel_p[:, 1:]), inverse(gyro_p[:, 1:4]), gyro_p[:, 4:] / gravity,
    )  # fmt: skip


def _running_product(turns: Float[Array, "samples 3 3"]) -> Float[Array, "samples+1 3 3"]:
    """E, R₁, R₁R₂, …"""
    products = jax.lax.associative_scan(lambda a, b: a @ b, turns)
    unit = jnp.eye(3, dtype=turns.dtype)[None]
    return jnp.concatenate([unit, products])


def _through(
    start: ExtendedPose, force: Array, rate: Array, step: Array, frame: LevelFrame
) -> tuple[ExtendedPose, tuple[Array, Array], Array]:
    """The pose after a segment, the responses of its error to each sample's force and rate, and to the error before."""
    count = force.shape[0] - 1
    turn, gain = step * rate, step * force
    before, here, gained = turn[:-1], turn[1:], gain[1:]
    coning = jnp.cross(before, here) / 12.0
    sculling = (jnp.cross(before, gained) + jnp.cross(gain[:-1], here)) / 12.0
    along = jax.vmap(lambda a, b: so3_left_jacobian(a) @ b)(here, gained) + sculling
    half = jax.vmap(rotation.exp)(0.5 * (here + coning))
    turned = _running_product(half @ half)
    whole = jnp.arange(count + 1, dtype=step.dtype) * step
    middles = whole[:-1] + 0.5 * step
    attitude = jnp.asarray(start.attitude)
    middle_frames = earth_turn(frame, middles) @ attitude
    level_gain = jnp.einsum("kij,kj->ki", middle_frames @ turned[:-1], along)
    velocity, position = _integrate(start, level_gain, step, frame)
    pose = ExtendedPose(
        earth_turn(frame, whole[-1:])[0] @ attitude @ turned[-1], velocity, position
    )
    left = whole[-1] - middles
    # What is still to come after a sample's middle: half its own share, all of the later ones'.
    later = jnp.cumsum(level_gain[::-1], axis=0)[::-1] - 0.5 * level_gain
    moment = left[:, None] * level_gain
    later_moment = jnp.cumsum(moment[::-1], axis=0)[::-1] - 0.5 * moment
    cases = middle_frames @ turned[:-1] @ half
    responses = _sample_responses(cases, later, later_moment, left, step)
    transition = _transition(
        level_gain.sum(0), moment.sum(0), whole[-1], frame, jnp.asarray(start.position)
    )
    return pose, responses, transition


def _integrate(
    start: ExtendedPose, level_gain: Array, step: Array, frame: LevelFrame
) -> tuple[Array, Array]:
    """Velocity and position after a segment; gravity and Coriolis terms along the path of a first pass."""
    rate = frame.earth_rate(step)
    v0, p0 = jnp.asarray(start.velocity), jnp.asarray(start.position)
    steps = jnp.arange(level_gain.shape[0], dtype=step.dtype)[:, None] * step
    first = jnp.cumsum(level_gain, axis=0) - 0.5 * level_gain
    g0 = frame.gravity_at(p0)
    v = v0[None, :] + first + (steps + 0.5 * step) * g0[None, :]
    p = p0[None, :] + jnp.cumsum(v, axis=0) * step
    pull = jax.vmap(frame.gravity_at)(p) - 2.0 * jnp.cross(rate[None, :], v)
    gained = jnp.cumsum(level_gain + step * pull, axis=0)
    before = jnp.concatenate([jnp.zeros((1, 3), gained.dtype), gained[:-1]])
    # Sums begin at zero, so that single precision loses nothing to a far position.
    moved = jnp.sum(0.5 * (before + gained), axis=0) * step + level_gain.shape[0] * step * v0
    return v0 + gained[-1], p0 + moved


def _sample_responses(
    cases: Array, later: Array, later_moment: Array, left: Array, step: Array
) -> tuple[Array, Array]:
    """∂ζ at the end/∂(force, rate) of each sample: [0, C, τC] h and [C, −S× C, −D× C] h."""
    zero = jnp.zeros_like(cases)
    skews = jax.vmap(rotation.skew)
    by_force = jnp.concatenate([zero, cases, left[:, None, None] * cases], axis=1)
    by_rate = jnp.concatenate([cases, -skews(later) @ cases, -skews(later_moment) @ cases], axis=1)
    return step * by_force, step * by_rate


def _transition(
    gain: Array, moment: Array, time: Array, frame: LevelFrame, position: Array
) -> Float[Array, "9 9"]:
    unit = jnp.eye(3, dtype=gain.dtype)
    earth = rotation.skew(frame.earth_rate(time))
    schuler = frame.gravity_gradient(position)
    s, d = rotation.skew(gain), rotation.skew(moment)
    o = jnp.zeros_like(unit)
    tilt_to_velocity = -s + 2.0 * earth @ d + rotation.skew(time * gain - moment) @ earth
    return jnp.block(
        [
            [unit - time * earth, o, o],
            [tilt_to_velocity, unit - 2.0 * time * earth, time * schuler],
            [-d, time * (unit - time * earth), unit + 0.5 * time**2 * schuler],
        ]
    )


def _output_responses(
    found: _Compensated, by_force: Array, by_rate: Array
) -> tuple[Float[Array, "samples 9 3"], Float[Array, "samples 9 3"]]:
    """∂ζ/∂(error of the outputs' model): what is added to an output and not modelled is taken from force and rate."""
    through_rate = by_rate @ found.gyro_inverse
    by_accel = -(by_force - through_rate @ found.g_sensitivity) @ found.accel_inverse
    return by_accel, -through_rate


def _by_coefficient(
    by_output: Float[Array, "samples 9 3"],
    regressors: Float[Array, "samples products"],
    count: int,
) -> Float[Array, "9 3 regressors size"]:
    """Response to every coefficient: Σ over samples of output response times regressor times φ(T)."""
    samples = by_output.shape[0]
    summed = by_output.reshape(samples, 27).T @ regressors
    return summed.reshape(9, 3, count, -1)
