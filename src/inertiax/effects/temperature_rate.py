"""Output proportional to the rate of temperature (Shupe effect and its mechanical kin)."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from .._typing import Scalar
from .effect import DEG_PER_HOUR, Effect, inputs, lag, MICRO_G, Variant
from .signal import Signal


def shape(
    signal: Signal, *, time_constant: Scalar | float, on: str
) -> Float[Array, "time channels columns"]:
    """dT/dt in °C/min, by the probe or behind it by a lag; on the bias, times the input, or with d²T/dt² beside it."""
    rate = jnp.asarray(signal.temperature_rate) * 60.0
    if time_constant > 0.0:
        rate = lag(signal.time, rate, time_constant)
    if on == "bias":
        return rate[:, None, None]
    if on == "scale":
        return inputs(signal)[:, :, None] * rate[:, None, None]
    change = (rate - lag(signal.time, rate, 60.0)) / 60.0
    return jnp.stack([rate, change], axis=-1)[:, None, :]


def variants(signal: Signal) -> tuple[Variant, ...]:
    """On the bias, on the scale factor, and with the second derivative."""
    forms = [(0.0, "bias"), (30.0, "bias"), (0.0, "scale"), (0.0, "gradient")]
    return tuple(Variant(f"{on}, {tau:g} s", {"time_constant": tau, "on": on}) for tau, on in forms)


EFFECT = Effect(
    name="temperature_rate",
    title="temperature-rate sensitivity D_Tdot (IEEE 952), Shupe effect",
    equation="c dT/dt (+ c2 d2T/dt2)",
    units={"accel": "m/s^2/(degC/min)", "gyro": "rad/s/(degC/min)"},
    prior={
        "accel": {
            "navigation": (5 * MICRO_G, 100 * MICRO_G),
            "tactical": (20 * MICRO_G, 500 * MICRO_G),
            "consumer": (100 * MICRO_G, 1000 * MICRO_G),
        },
        "gyro": {
            "navigation": (0.01 * DEG_PER_HOUR, 0.5 * DEG_PER_HOUR),
            "tactical": (1 * DEG_PER_HOUR, 20 * DEG_PER_HOUR),
            "consumer": (5 * DEG_PER_HOUR, 50 * DEG_PER_HOUR),
        },
    },
    shape=shape,
    variants=variants,
    needs="ramps of temperature of different rates and signs",
    driver="temperature_rate",
    sentence="The output of {channels} is proportional to the rate of temperature.",
    separating="constant-rate ramps of both signs at several rates with soaks between them",
    requires=("temperature", "temperature_rate"),
)
