"""The station run with a device on it: from a plan to measurements with known truth.

`simulate_dwells` goes straight to dwell means: quick, pure JAX, for Monte Carlo under `vmap` over
keys. `simulate_recordings` writes the logs that a device would have sent, slews included.
"""

import math
from collections.abc import Callable, Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, PRNGKeyArray

from .._typing import AnyArray
from ..data.recording import Recording
from ..physics import earth
from ..physics.error_model import distort_accel, distort_gyro
from ..reduction.dwells import Dwells
from .chamber import first_order_lag
from .motion import Motion, move, Turn
from .plan import Plan
from .triad import Device, NAVIGATION_NOISE, Noise


class Truth(eqx.Module):
    """What was really there, row by row of the measurements it comes with."""

    temperature: Float[AnyArray, " row"]  # °C, of the sensing elements
    force: Float[AnyArray, "row 3"]  # m/s², specific force in the case frame
    rate: Float[AnyArray, "row 3"]  # rad/s, absolute angular rate in the case frame


class Readout(eqx.Module):
    """Steps to which the outputs are rounded; 0 = none."""

    accel: float = eqx.field(static=True, default=0.0)  # m/s²
    gyro: float = eqx.field(static=True, default=0.0)  # rad/s
    temperature: float = eqx.field(static=True, default=0.0)  # °C


EXACT_READOUT = Readout()


def simulate_dwells(
    key: PRNGKeyArray | None,
    plan: Plan,
    device: Device,
    *,
    noise: Noise = NAVIGATION_NOISE,
    sample_rate: float = 10.0,
) -> tuple[Dwells, Truth]:
    """Dwell means of every position of every experiment, with what was really there.

    Output and temperature are both those of mid-dwell (what the curvature of a path adds to a mean
    is left out), plus white noise of standard deviation density / √duration; the covariances say
    the same. Without a `key` no noise is drawn, and the covariances stay.

    Rows run through the experiments, and within one through the positions in the order visited;
    `position` is the programme's number of the position. A plan's turns follow as rows with
    `position` −1: their means over whole revolutions. References are those of the plan; the truth
    has the plan's random positioning errors in it.

    **Arguments:** `sample_rate` (Hz) sets `count` and how much of the probe's noise averages out.
    """
    n = plan.num_experiments
    middle, duration = plan.dwells()
    probe, element = (x.reshape(-1) for x in _dwell_temperatures(plan, device, middle))
    draws = _draws(key, (n, len(middle), 9))  # accelerometers, gyros, probe, table angles
    errors = jnp.asarray(plan.position_error) * draws[:, : plan.programme.num_positions, 7:]
    planned = _felt(plan, jnp.zeros_like(errors))
    force, rate = _felt(plan, errors)
    accel, gyro = _outputs(plan, device, element, force, rate)
    number = np.concatenate([np.asarray(plan.programme.numbers), np.full(len(plan.turns), -1)])
    duration = jnp.asarray(np.tile(duration, n))
    count = jnp.maximum(1.0, jnp.round(duration * sample_rate))
    variances = noise.accel**2 / duration, noise.gyro**2 / duration
    draws = draws.reshape(-1, 9)
    dwells = Dwells(
        time=jnp.asarray((plan.start_times()[:, None] + middle).reshape(-1)),
        duration=duration,
        count=count,
        temperature=probe + noise.probe / jnp.sqrt(count) * draws[:, 6],
        experiment=jnp.asarray(np.repeat(np.arange(n), len(number))),
        position=jnp.asarray(np.tile(number, n)),
        valid=jnp.ones(duration.shape, bool),
        accel=None if accel is None else accel + jnp.sqrt(variances[0])[:, None] * draws[:, :3],
        accel_covariance=None if accel is None else _isotropic(variances[0]),
        gyro=None if gyro is None else gyro + jnp.sqrt(variances[1])[:, None] * draws[:, 3:6],
        gyro_covariance=None if gyro is None else _isotropic(variances[1]),
        reference_accel=planned[0],
        reference_gyro=planned[1],
    )
    return dwells, Truth(element, force, rate)


def simulate_recordings(
    key: PRNGKeyArray | None,
    plan: Plan,
    device: Device,
    *,
    noise: Noise = NAVIGATION_NOISE,
    readout: Readout = EXACT_READOUT,
    sample_rate: float = 10.0,
    effects: Sequence[Callable[[Recording, Truth], Recording]] = (),
    serial: str = "",
) -> tuple[tuple[Recording, ...], tuple[Truth, ...]]:
    """The device's logs, one recording per experiment, with what was really there.

    Samples are instantaneous values at `sample_rate` (Hz), half a period after 0 the first, plus
    white noise of standard deviation density · √sample_rate; the case turns about its own sensors,
    so slews bring no centripetal force. Time runs on through the soaks. Without a `key` no noise
    is drawn.

    `effects` is the place for physics beyond equation (1): each function takes and returns a
    recording (beside what was really there) after the error model and before noise and rounding.
    """
    # In the middle of each sampling period, so that a dwell's mean time is its middle.
    time = (np.arange(int(plan.experiment_time * sample_rate + 1e-9)) + 0.5) / sample_rate
    motion = move(plan.segments(), time)
    planned = tuple(np.asarray(x) for x in _moving(plan, motion))
    keys = [None, None] if key is None else list(jax.random.split(key))
    shape = (plan.num_experiments, plan.programme.num_positions, 2)
    errors = np.asarray(jnp.asarray(plan.position_error) * _draws(keys[1], shape))
    recordings, truths = [], []
    for experiment, start in enumerate(plan.start_times()):
        probe, element = _temperatures(plan, device, jnp.asarray(experiment), jnp.asarray(time))
        force, rate = _moving(plan, move(plan.segments(errors[experiment]), time))
        accel, gyro = _outputs(plan, device, element, force, rate)
        truth = Truth(np.asarray(element), np.asarray(force), np.asarray(rate))
        recording = Recording(
            time=start + time,
            accel=None if accel is None else np.asarray(accel),
            gyro=None if gyro is None else np.asarray(gyro),
            temperature=np.asarray(probe)[:, None],
            experiment=np.full(len(time), experiment),
            position=np.asarray(motion.position),
            reference_accel=planned[0],
            reference_gyro=planned[1],
            device=serial,
            name=f"experiment {experiment}",
        )
        for effect in effects:
            recording = effect(recording, truth)
        own = None if keys[0] is None else jax.random.fold_in(keys[0], experiment)
        recordings.append(_read_out(own, recording, noise, readout, sample_rate))
        truths.append(truth)
    return tuple(recordings), tuple(truths)


# The functions below are compiled whole: one by one, their operations take seconds to compile.
@eqx.filter_jit
def _temperatures(
    plan: Plan, device: Device, experiment: Int[Array, ""], time: Float[Array, " row"]
) -> tuple[Float[Array, " row"], Float[Array, " row"]]:
    """Temperature (°C) of the probe and of the sensing elements, which agree at the first time."""
    u = time / plan.experiment_time
    probe = jax.vmap(lambda fraction: plan.chamber.temperature(experiment, fraction))(u)
    return probe, first_order_lag(time, probe, device.lag)


@eqx.filter_jit
def _dwell_temperatures(
    plan: Plan, device: Device, middle: Float[AnyArray, " dwell"]
) -> tuple[Float[Array, "experiment dwell"], Float[Array, "experiment dwell"]]:
    time = jnp.concatenate([jnp.zeros(1), jnp.asarray(middle)])
    one = lambda experiment: _temperatures(plan, device, experiment, time)
    probe, element = jax.vmap(one)(jnp.arange(plan.num_experiments))
    return probe[:, 1:], element[:, 1:]


@eqx.filter_jit
def _felt(
    plan: Plan, errors: Float[Array, "experiment position 2"]
) -> tuple[Float[Array, "row 3"], Float[Array, "row 3"]]:
    """Specific force and absolute rate in the case frame at each rest, whose angles are off by
    `errors` (rad), and over each turn, of every experiment."""

    def rest(pair: Float[Array, "2"]) -> tuple[Array, Array]:
        attitude = plan.table.attitude(pair[0], pair[1])
        return earth.rest_readings(attitude, plan.gravity, plan.latitude)

    angles = jnp.asarray(plan.programme.angles)
    turns = [_turn_means(plan, turn) for turn in plan.turns]

    def one(own: Float[Array, "position 2"]) -> tuple[Array, Array]:
        force, rate = jax.vmap(rest)(angles + own)
        return (
            jnp.concatenate([force, *(t[0][None] for t in turns)]),
            jnp.concatenate([rate, *(t[1][None] for t in turns)]),
        )

    force, rate = jax.vmap(one)(errors)
    return force.reshape(-1, 3), rate.reshape(-1, 3)


def _turn_means(plan: Plan, turn: Turn) -> tuple[Float[Array, "3"], Float[Array, "3"]]:
    """Mean force and rate over whole revolutions: of a vector fixed in the room, only the part
    along the turning axis is left."""
    outer, inner = turn.start
    attitude = plan.table.attitude(outer, inner)
    force, earth_rate = earth.rest_readings(attitude, plan.gravity, plan.latitude)
    spin = np.eye(2)[turn.index] * turn.rate
    turning = plan.table.turning(inner, spin[0], spin[1])
    axis = turning / turn.rate
    return axis * jnp.vdot(axis, force), axis * jnp.vdot(axis, earth_rate) + turning


@eqx.filter_jit
def _moving(plan: Plan, motion: Motion) -> tuple[Float[Array, "row 3"], Float[Array, "row 3"]]:
    """Specific force and absolute rate in the case frame along a motion."""

    def one(pair: Float[Array, "2"], speed: Float[Array, "2"]) -> tuple[Array, Array]:
        attitude = plan.table.attitude(pair[0], pair[1])
        force, rate = earth.rest_readings(attitude, plan.gravity, plan.latitude)
        return force, rate + plan.table.turning(pair[1], speed[0], speed[1])

    return jax.vmap(one)(jnp.asarray(motion.angles), jnp.asarray(motion.rates))


@eqx.filter_jit
def _outputs(
    plan: Plan,
    device: Device,
    temperature: Float[Array, " row"],
    force: Float[Array, "row 3"],
    rate: Float[Array, "row 3"],
) -> tuple[Float[Array, "row 3"] | None, Float[Array, "row 3"] | None]:
    """Equation (1) with the device's parameters at each row's temperature."""
    accel = gyro = None
    if (triad := device.accel) is not None:
        accel = jax.vmap(lambda t, a: distort_accel(triad.errors(t), a))(temperature, force)
    if (gyros := device.gyro) is not None:
        gyro = jax.vmap(lambda t, w, a: distort_gyro(gyros.errors(t), w, a, plan.gravity))(
            temperature, rate, force
        )
    return accel, gyro


def _read_out(
    key: PRNGKeyArray | None, ideal: Recording, noise: Noise, readout: Readout, sample_rate: float
) -> Recording:
    """Noise, then rounding, on the columns that a device sends."""
    root = float(np.sqrt(sample_rate))
    draws = np.asarray(_draws(key, (ideal.num_samples, 7)))  # accelerometers, gyros, probe

    def sent(values: np.ndarray | None, std: float, own: np.ndarray, step: float):
        if values is None:
            return None
        values = values + std * own
        return np.round(values / step) * step if step > 0 else values

    columns = (
        sent(ideal.accel, noise.accel * root, draws[:, :3], readout.accel),
        sent(ideal.gyro, noise.gyro * root, draws[:, 3:6], readout.gyro),
        sent(ideal.temperature, noise.probe, draws[:, 6:], readout.temperature),
    )
    where = lambda r: (r.accel, r.gyro, r.temperature)
    return eqx.tree_at(where, ideal, columns, is_leaf=lambda x: x is None)


def _draws(key: PRNGKeyArray | None, shape: tuple[int, ...]) -> Array:
    """Standard normal numbers; zeros without a key."""
    if key is None:
        return jnp.zeros(shape)
    # Drawn flat: XLA on CPU takes seconds to compile the generator in more dimensions.
    return jax.random.normal(key, (math.prod(shape),)).reshape(shape)


def _isotropic(variance: Float[Array, " row"]) -> Float[Array, "row 3 3"]:
    return variance[:, None, None] * jnp.eye(3, dtype=variance.dtype)[None]
