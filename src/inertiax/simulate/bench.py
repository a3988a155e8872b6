"""The station run with a device on it: from a plan to measurements with known truth.

`simulate_dwells` goes straight to dwell means: quick, pure JAX, for Monte Carlo under `vmap` over
keys.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, PRNGKeyArray

from .. import earth
from .._typing import AnyArray
from ..dwells import Dwells
from ..model import distort_accel, distort_gyro
from .chamber import first_order_lag
from .plan import Plan
from .triad import Device, Noise


class Truth(eqx.Module):
    """What was really there, row by row of the measurements it comes with."""

    temperature: Float[AnyArray, " row"]  # °C, of the sensing elements
    force: Float[AnyArray, "row 3"]  # m/s², specific force in the case frame
    rate: Float[AnyArray, "row 3"]  # rad/s, absolute angular rate in the case frame


def simulate_dwells(
    key: PRNGKeyArray | None,
    plan: Plan,
    device: Device,
    *,
    noise: Noise = Noise(),
    sample_rate: float = 10.0,
) -> tuple[Dwells, Truth]:
    """Dwell means of every position of every experiment, with what was really there.

    Output and temperature are both those of mid-dwell (what the curvature of a path adds to a mean
    is left out), plus white noise of standard deviation density / √duration; the covariances say
    the same. Without a `key` no noise is drawn, and the covariances stay.

    Rows run through the experiments, and within one through the positions in the order visited;
    `position` is the programme's number of the position. References are those of the plan.

    **Arguments:** `sample_rate` (Hz) only sets `count`.
    """
    n, m = plan.num_experiments, plan.programme.num_positions
    experiment = np.repeat(np.arange(n), m)
    probe, element = (x.reshape(-1) for x in _dwell_temperatures(plan, device))
    force, rate = _at_rest(plan, np.tile(np.asarray(plan.programme.angles), (n, 1)))
    keys = [None] * 3 if key is None else list(jax.random.split(key, 3))
    accel, gyro = _outputs(plan, device, element, force, rate)
    shape = (n * m,)
    dwells = Dwells(
        time=jnp.asarray((plan.start_times()[:, None] + plan.dwell_times()).reshape(-1)),
        duration=jnp.full(shape, plan.dwell_time),
        count=jnp.full(shape, max(1.0, float(round(plan.dwell_time * sample_rate)))),
        temperature=_noisy(keys[0], probe, noise.probe / np.sqrt(plan.dwell_time * sample_rate)),
        experiment=jnp.asarray(experiment),
        position=jnp.asarray(np.tile(np.asarray(plan.programme.numbers), n)),
        valid=jnp.ones(shape, bool),
        accel=None if accel is None else _noisy(keys[1], accel, _std(noise.accel, plan)),
        accel_covariance=None if accel is None else _covariance(noise.accel, plan),
        gyro=None if gyro is None else _noisy(keys[2], gyro, _std(noise.gyro, plan)),
        gyro_covariance=None if gyro is None else _covariance(noise.gyro, plan),
        reference_accel=force,
        reference_gyro=rate,
    )
    return dwells, Truth(element, force, rate)


def _dwell_temperatures(
    plan: Plan, device: Device
) -> tuple[Float[Array, "experiment position"], Float[Array, "experiment position"]]:
    """Temperature (°C) of the probe and of the sensing elements at mid-dwell."""
    # From the start of the experiment, where probe and elements agree.
    times = np.concatenate([[0.0], plan.dwell_times()])

    def one(experiment: Int[Array, ""]) -> tuple[Array, Array]:
        fractions = jnp.asarray(times / plan.experiment_time)
        probe = jax.vmap(lambda u: plan.chamber.temperature(experiment, u))(fractions)
        return probe[1:], first_order_lag(times, probe, device.lag)[1:]

    return jax.vmap(one)(jnp.arange(plan.num_experiments))


def _at_rest(
    plan: Plan, angles: Float[AnyArray, "row 2"]
) -> tuple[Float[Array, "row 3"], Float[Array, "row 3"]]:
    """Specific force and absolute rate in the case frame at each pair of table angles."""

    def one(pair: Float[Array, "2"]) -> tuple[Array, Array]:
        attitude = plan.table.attitude(pair[0], pair[1])
        return earth.rest_readings(attitude, plan.gravity, plan.latitude)

    return jax.vmap(one)(jnp.asarray(angles))


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


def _std(density: float, plan: Plan) -> float:
    return density / float(np.sqrt(plan.dwell_time))


def _noisy(key: PRNGKeyArray | None, mean: Array, std: float) -> Array:
    if key is None:
        return mean
    return mean + std * jax.random.normal(key, mean.shape, mean.dtype)


def _covariance(density: float, plan: Plan) -> Float[Array, "row 3 3"]:
    rows = plan.num_experiments * plan.programme.num_positions
    return jnp.broadcast_to(_std(density, plan) ** 2 * jnp.eye(3), (rows, 3, 3))
