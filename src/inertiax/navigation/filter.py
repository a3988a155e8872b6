"""An error-state Kalman filter on SE₂(3) whose states include a calibration's coefficients over temperature.

    error = (ζ, drift, calibration):  tilts, heading, velocity, position; Allan noise; coefficients in prior σ

Outputs are compensated and integrated at every sample; covariances move once a segment (1 s at 100 samples of 100 Hz),
by transitions that are summed over its samples (`segment`). Calibration states are constants, so that only nine rows
of the transition are not trivial, and a covariance of n states costs 18 n² operations, not 2 n³.

Updates are Joseph's form, and the error's axes are turned with the estimate (`filter_state.reset_jacobian`).

**Reference:** Barrau and Bonnabel, IEEE TAC 62 (2017) 1797-1812; Sola, "Quaternion kinematics for the error-state
Kalman filter", arXiv 1711.02508, section 6 (reset).
"""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from .._typing import AnyArray, Mat3, Vec3
from ..calibration.calibration import Calibration
from ..calibration.triad import MAPPED, refuse_stacked
from ..data.plausible_units import check_from_zero
from ..numerics.linear_algebra import cholesky, cholesky_solve
from ..physics.leaves import as_plain, is_traced
from ..physics.shapes import check_one
from .calibration_states import calibration_states, CalibrationStates
from .checks import check_data, check_near, check_rotation, check_speed, FARTHEST, FASTEST
from .filter_state import Estimate, FilterState, NAVIGATION, reset_jacobian, retract
from .level_frame import LevelFrame
from .process import ImuNoise, slow_noise
from .se23 import ExtendedPose
from .segment import advance, Samples, Transition
from .strapdown import ImuData
from .update_checks import check_update
from .updates import AbstractUpdate, innovation, Rows, rows_of


Sigma = float | Float[AnyArray, ""] | Float[AnyArray, "3"]


class FilterModel(eqx.Module):
    """What a filter computes with: a pytree without a device's labels."""

    states: CalibrationStates
    noise: ImuNoise
    frame: LevelFrame
    gravity: Float[AnyArray, ""]  # m/s², by which the calibration scales g-sensitivity
    samples: int = eqx.field(static=True)  # in a segment


class Correction(eqx.Module):
    """One update as it was applied, for smoothing; zero where there was no measurement."""

    gain: Float[Array, "*segments n m"]
    slope: Float[Array, "*segments m n"]  # H
    weighted: Float[Array, "*segments m"]  # S⁻¹ y
    information: Float[Array, "*segments m m"]  # S⁻¹
    reset: Float[Array, "*segments 9 9"]
    variance: Float[Array, "*segments m"]  # of the measurement
    nis: Float[Array, "*segments"]  # yᵀ S⁻¹ y
    used: Bool[Array, "*segments"]


class Track(eqx.Module):
    """A run of a filter: what it knew at each segment's end from the measurements so far.

    Under `vmap` every field gains leading axes of runs.
    """

    start: FilterState
    time: Float[Array, "*runs segments"]  # s from the start of the data
    estimate: Estimate
    # Covariance of the first d states, those that change, with all.
    rows: Float[Array, "*runs segments d n"]
    transition: Transition
    corrections: tuple[Correction, ...]
    log_likelihood: Float[Array, "*runs"]  # of all measurements
    last: FilterState

    @property
    def covariance(self) -> Float[Array, "*runs segments 9 9"]:
        """Of tilts and heading (rad), velocity (m/s) and position (m), east, north, up."""
        return self.rows[..., :NAVIGATION, :NAVIGATION]

    @property
    def sigma(self) -> Float[Array, "*runs segments 9"]:
        """Standard deviations of the same."""
        return jnp.sqrt(jnp.diagonal(self.covariance, axis1=-2, axis2=-1))


class Filter(eqx.Module):
    """An error-state filter with calibration states.

    **Arguments:**

    - `calibration`: the device's. Its coefficients' covariance is the prior of those that `states` chooses.
    - `states`: `"*"`, a family such as `"*.bias"` or `"gyro.matrix"`, `"accel.scale"`, one parameter, or a sequence of
      these; `()` for none: the calibration counts as exact. Each coefficient over temperature is a state.
    - `noise`: `ImuNoise`, densities in SI (not per sample).
    - `frame`: `LevelFrame`, the origin in whose east, north and up attitudes, velocities and positions are.
    - `samples`: samples in a segment. Covariances move and updates act at segments' ends.
    - `thermal`: false for one constant a parameter, whatever the temperature (filters of 15 and 21 states).

    The methods are pure: they go through `jit`, `vmap` and `grad`, in the precision of the data.
    Raises `ValueError` for patterns that choose nothing, stacked devices, effects, or fewer than two samples.

    **Example:** see the page "Filter with calibration states".
    """

    calibration: Calibration
    model: FilterModel

    def __init__(
        self,
        calibration: Calibration,
        states: str | Sequence[str] = "*",
        *,
        noise: ImuNoise,
        frame: LevelFrame,
        samples: int = 100,
        thermal: bool = True,
    ):
        if samples < 2:
            raise ValueError(f"`Filter(samples=...)` must be 2 or more; got {samples}.")
        refuse_stacked(calibration.triads, "Filter(calibration)", MAPPED)
        self.calibration = calibration
        chosen = calibration_states(calibration, states, thermal=thermal)
        self.model = FilterModel(
            chosen, noise, frame, jnp.asarray(calibration.gravity), as_plain(samples)
        )

    @property
    def names(self) -> tuple[str, ...]:
        """Parameter and function of temperature of each calibration state, such as `accel.bias[0] of φ1`."""
        states = self.model.states
        return tuple(f"{n} of φ{a}" for n, a in zip(states.names, states.functions, strict=True))

    def start(
        self,
        attitude: Mat3,
        velocity: Vec3,
        position: Vec3,
        *,
        attitude_sigma: Sigma,
        velocity_sigma: Sigma,
        position_sigma: Sigma,
    ) -> FilterState:
        """The state before the first sample.

        **Arguments:** case-to-level matrix, velocity (m/s) and position (m) in the frame, and their standard
        deviations (rad about east, north and up; m/s; m), one number or three.

        Raises `ValueError` for a matrix that is no rotation, other shapes, and implausible sizes.
        """
        check_rotation("Filter.start(attitude=...)", attitude)
        check_one("Filter.start(...)", velocity=velocity, position=position)
        check_speed("Filter.start(velocity=...)", velocity)
        check_near("Filter.start(position=...)", position)
        check_from_zero("Filter.start(attitude_sigma=...)", attitude_sigma, np.pi, "rad")
        check_from_zero("Filter.start(velocity_sigma=...)", velocity_sigma, FASTEST, "m/s")
        check_from_zero("Filter.start(position_sigma=...)", position_sigma, FARTHEST, "m")
        return _start(
            self.model,
            ExtendedPose(*(jnp.asarray(x) for x in (attitude, velocity, position))),
            (attitude_sigma, velocity_sigma, position_sigma),
        )

    def run(
        self, start: FilterState, data: ImuData, updates: Sequence[AbstractUpdate] = ()
    ) -> Track:
        """Filter a run: raw outputs in, `Track` out.

        **Arguments:** `data` are a whole number of segments; `updates` have one row a segment and act in
        their order.

        Raises `ValueError` where sizes do not fit, coordinates are too far for the precision, a standard deviation is
        not above zero, or positions are no metres in the frame.
        """
        check_data("Filter.run(data=...)", data)
        for update in updates:
            check_update(update, self.model.frame)
        return run(self.model, start, data, tuple(updates))

    def ends(self, data: ImuData) -> Float[AnyArray, " segments"]:
        """Times of the segments' ends, s from the start of the data."""
        count = _segments(data, self.model.samples)
        step = data.step if is_traced(data.step) else float(data.step)
        return np.arange(1, count + 1) * step * self.model.samples


def _start(
    model: FilterModel, pose: ExtendedPose, sigmas: tuple[Sigma, Sigma, Sigma]
) -> FilterState:
    dtype = jnp.asarray(pose.position).dtype
    slow = slow_noise(model.noise, jnp.ones((), dtype))
    full = [jnp.broadcast_to(jnp.asarray(s, dtype), (3,)) for s in sigmas]
    known = jnp.diag(jnp.concatenate([jnp.concatenate(full) ** 2, slow.start]))
    prior = jnp.asarray(model.states.correlation, dtype)
    corner = jnp.zeros((known.shape[0], prior.shape[0]), dtype)
    covariance = jnp.block([[known, corner], [corner.T, prior]])
    estimate = Estimate(pose, jnp.zeros_like(slow.start), jnp.zeros(prior.shape[0], dtype))
    return FilterState(estimate, covariance)


def _segments(data: ImuData, samples: int) -> int:
    total = jnp.shape(data.accel)[0]
    if total == 0 or total % samples:
        raise ValueError(
            f"`Filter.run(data=...)`: {total} samples are not a whole number of segments of {samples}; cut the data "
            f"or choose `Filter(samples=...)`."
        )
    return total // samples


def _cut(data: ImuData, samples: int, dtype: jnp.dtype) -> Samples:
    """Data by segments, each with the sample before it; the first sample of all stands for the one before it."""
    count = _segments(data, samples)
    rows = np.arange(count)[:, None] * samples + np.arange(samples + 1)[None, :] - 1
    take = lambda x: jnp.asarray(x, dtype)[np.maximum(rows, 0)]
    step = jnp.broadcast_to(jnp.asarray(data.step, dtype), (count,))
    return Samples(take(data.accel), take(data.gyro), take(data.temperature), step)


@eqx.filter_jit
def run(
    model: FilterModel, start: FilterState, data: ImuData, updates: tuple[AbstractUpdate, ...]
) -> Track:
    """`Filter.run` on the labelless model."""
    like = jnp.asarray(start.covariance)
    dtype = like.dtype
    model = jax.tree.map(lambda x: jnp.asarray(x, dtype) if eqx.is_inexact_array(x) else x, model)
    segments = _cut(data, model.samples, dtype)
    count = segments.step.shape[0]
    rows = tuple(rows_of(u, count, like) for u in updates)
    slow = slow_noise(model.noise, segments.step[0] * model.samples)
    changing = NAVIGATION + model.noise.count

    def one(state: FilterState, inputs: tuple[Samples, tuple[Rows, ...]]):
        samples, measured = inputs
        estimate, transition = advance(
            state.estimate, samples, model.states, slow, model.frame, jnp.asarray(model.gravity)
        )
        covariance = _propagate(jnp.asarray(state.covariance), transition, slow.variance)
        state, corrections, likelihood = FilterState(estimate, covariance), [], jnp.zeros((), dtype)
        for update, row in zip(updates, measured, strict=True):
            state, correction, part = _correct(update, state, row)
            corrections.append(correction)
            likelihood = likelihood + part
        kept = state.covariance[:changing]
        return state, (state.estimate, kept, transition, tuple(corrections), likelihood)

    # Of each segment only its start is kept for a gradient, and the rest computed again.
    last, out = jax.lax.scan(jax.checkpoint(one), start, (segments, rows))
    time = jnp.cumsum(segments.step * model.samples)
    return Track(start, time, out[0], out[1], out[2], out[3], jnp.sum(out[4]), last)


def _propagate(covariance: Array, transition: Transition, variance: Array) -> Float[Array, "n n"]:
    """F P Fᵀ + Q, with F = [[Φ, B], [0, diag(decay, 1)]]."""
    slow = transition.decay.shape[0]
    constants = jnp.ones(covariance.shape[0] - NAVIGATION - slow, covariance.dtype)
    decay = jnp.concatenate([transition.decay, constants])
    top = jnp.concatenate([transition.navigation, transition.others], axis=1)
    moved = top @ covariance
    corner = moved @ top.T + transition.noise
    side = moved[:, NAVIGATION:] * decay[None, :]
    rest = covariance[NAVIGATION:, NAVIGATION:] * (decay[:, None] * decay[None, :])
    rest = rest + jnp.diag(jnp.concatenate([variance, jnp.zeros_like(constants)]))
    corner = 0.5 * (corner + corner.T)
    return jnp.block([[corner, side], [side.T, rest]])


def _correct(
    update: AbstractUpdate, state: FilterState, row: Rows
) -> tuple[FilterState, Correction, Array]:
    """One measurement, in Joseph's form, and the reset of the error's axes."""
    covariance = jnp.asarray(state.covariance)
    y, slope = innovation(update, state.estimate, row.value)
    crossed = slope @ covariance
    spread = crossed @ slope.T + jnp.diag(row.variance)
    factor = cholesky(spread)
    information = cholesky_solve(factor, jnp.eye(y.shape[0], dtype=y.dtype))
    nis = jnp.vdot(y, information @ y)
    used = row.valid if update.gate is None else row.valid & (nis <= update.gate)
    keep = jnp.where(used, 1.0, 0.0).astype(y.dtype)
    y, slope, crossed = keep * y, keep * slope, keep * crossed
    gain = crossed.T @ information
    partly = covariance - gain @ crossed
    covariance = partly - (partly @ slope.T) @ gain.T + (gain * row.variance[None, :]) @ gain.T
    move = gain @ y
    reset = reset_jacobian(move[:NAVIGATION])
    after = FilterState(retract(state.estimate, move), _turned(covariance, reset))
    logdet = 2.0 * jnp.sum(jnp.log(jnp.diagonal(factor)))
    likelihood = -0.5 * keep * (nis + logdet + y.shape[0] * jnp.log(2.0 * jnp.pi))
    correction = Correction(
        gain, slope, information @ y, information, reset, row.variance, nis, used
    )
    return after, correction, likelihood


def _turned(covariance: Array, reset: Array) -> Float[Array, "n n"]:
    """diag(J, E) P diag(J, E)ᵀ, made symmetric."""
    top = reset @ covariance[:NAVIGATION]
    corner = top[:, :NAVIGATION] @ reset.T
    side = top[:, NAVIGATION:]
    rest = covariance[NAVIGATION:, NAVIGATION:]
    joined = jnp.block([[corner, side], [side.T, rest]])
    return 0.5 * (joined + joined.T)
