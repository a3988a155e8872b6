"""Thermal hysteresis: depends on the branch, and stays in a soak."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from .._typing import Scalar
from .effect import DEG_PER_HOUR, Effect, inputs, MICRO_G, play, Variant
from .signal import Signal


def shape(
    signal: Signal, *, radius: Scalar | float, loop: str, on: str
) -> Float[Array, "time channels columns"]:
    """Play operator of half-width `radius` (part of the temperature range) less the temperature
    itself, scaled to ±1; or Rayleigh's parabolic loop, whose branch turns after `radius`."""
    t = jnp.asarray(signal.temperature)
    half = 0.5 * (jnp.max(t) - jnp.min(t))
    width = 2.0 * radius * half
    lead = (play(t, width) - t) / width
    if loop == "Rayleigh":
        x = (t - 0.5 * (jnp.max(t) + jnp.min(t))) / half
        lead = lead * (1.0 - x**2)
    if on == "bias":
        return lead[:, None, None]
    return inputs(signal)[:, :, None] * lead[:, None, None]


def variants(signal: Signal) -> tuple[Variant, ...]:
    """Several widths of play, and Rayleigh's loop; on the bias and on the scale factor."""
    forms = [("play", r) for r in (0.02, 0.05, 0.1, 0.16, 0.24, 0.33, 0.45)] + [("Rayleigh", 0.02)]
    return tuple(
        Variant(f"{on}, {loop} {r:g}", {"radius": r, "loop": loop, "on": on})
        for on in ("bias", "scale")
        for loop, r in forms
    )


EFFECT = Effect(
    name="thermal_hysteresis",
    title="thermal hysteresis",
    equation="h L(T, branch); L of the play operator or s (1 - ((T - T_m)/A)^2)",
    units={"accel": "m/s^2", "gyro": "rad/s"},
    prior={
        "accel": {
            "navigation": (10 * MICRO_G, 60 * MICRO_G),
            "tactical": (50 * MICRO_G, 1000 * MICRO_G),
            "consumer": (300 * MICRO_G, 5000 * MICRO_G),
        },
        "gyro": {
            "navigation": (0.005 * DEG_PER_HOUR, 0.1 * DEG_PER_HOUR),
            "tactical": (1 * DEG_PER_HOUR, 20 * DEG_PER_HOUR),
            "consumer": (5 * DEG_PER_HOUR, 100 * DEG_PER_HOUR),
        },
    },
    shape=shape,
    variants=variants,
    needs="heating and cooling branches with soaks on both",
    driver="temperature_branch",
    sentence=(
        "The output of {channels} depends on whether the temperature was reached from below or from above, "
        "and keeps the difference in a soak."
    ),
    separating="soaks at the same temperature on both branches, two cycles, two amplitudes",
    requires=("temperature",),
)
