"""Saturation: clipping near the ends of the range."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from .._typing import Scalar
from .effect import Effect, inputs, Variant
from .signal import Signal


def shape(
    signal: Signal, *, level: Scalar | float, side: int
) -> Float[Array, "time channels columns"]:
    """What a clip at `level` (part of the largest input) takes away, at both ends or at one."""
    u = inputs(signal)
    limit = level * jnp.max(jnp.abs(u))
    high = jnp.maximum(u - limit, 0.0) if side >= 0 else jnp.zeros_like(u)
    low = jnp.maximum(-u - limit, 0.0) if side <= 0 else jnp.zeros_like(u)
    return (low - high)[:, :, None]


def variants(signal: Signal) -> tuple[Variant, ...]:
    """Levels below the largest input that leave two levels of it above or below."""
    return tuple(
        Variant(f"level={v:g}, side {s:+d}", {"level": v, "side": s})
        for s in (0, 1, -1)
        for v in (0.6, 0.8, 0.9, 0.97)
    )


EFFECT = Effect(
    name="saturation",
    title="saturation",
    equation="clip(f, -L, L) - f",
    units={"accel": "1", "gyro": "1"},
    prior={
        "accel": {"navigation": (0.0001, 1), "tactical": (0.0001, 1), "consumer": (0.0001, 1)},
        "gyro": {"navigation": (0.0001, 1), "tactical": (0.0001, 1), "consumer": (0.0001, 1)},
    },
    shape=shape,
    variants=variants,
    needs="several levels of input near the end of the range",
    driver="input",
    sentence="The output of {channels} saturates near the end of its range.",
    separating="change the range",
)
