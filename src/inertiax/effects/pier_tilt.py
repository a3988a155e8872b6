"""Slow tilt of the pier or foundation."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from .._typing import Scalar
from .effect import Effect, inputs, Variant
from .signal import Signal


def shape(signal: Signal, *, period: Scalar | float) -> Float[Array, "time channels columns"]:
    """Small rotations about the room's axes, in sine and cosine of a period (s) or growing linearly (period 0)."""
    u = inputs(signal)
    time = jnp.asarray(signal.time)
    phase = 2.0 * jnp.pi * time / period if period else time / (time[-1] - time[0])
    courses = [jnp.sin(phase), jnp.cos(phase)] if period else [phase]
    room = jnp.asarray(signal.room)
    turned = [jnp.cross(room[:, :, k], u) for k in range(3)]
    return jnp.stack([c[:, None] * t for t in turned for c in courses], axis=-1)


def variants(signal: Signal) -> tuple[Variant, ...]:
    """A day's period where a good part of it was recorded, and a linear tilt."""
    day = (Variant("24 h", {"period": 86400.0}),) if signal.duration > 2e4 else ()
    return (*day, Variant("linear", {"period": 0.0}))


EFFECT = Effect(
    name="pier_tilt",
    title="pier tilt (IEEE 1554)",
    equation="theta(t) x f, theta fixed to the room",
    units={"accel": "rad", "gyro": "rad"},
    prior={
        "accel": {
            "navigation": (1e-06, 2e-05),
            "tactical": (1e-06, 5e-05),
            "consumer": (1e-06, 0.0001),
        },
        "gyro": {
            "navigation": (1e-06, 2e-05),
            "tactical": (1e-06, 5e-05),
            "consumer": (1e-06, 0.0001),
        },
    },
    shape=shape,
    variants=variants,
    needs="hours of recording with known attitude",
    driver="time",
    sentence="The pier tilts slowly.",
    separating="a level or tiltmeter on the pier; repeat at another hour",
    requires=("room",),
    common=True,
)
