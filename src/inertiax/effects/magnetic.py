"""Sensitivity to the magnetic field, which is fixed to the room."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from .effect import DEG_PER_HOUR, Effect, MICRO_G, Variant
from .signal import Signal


DIP = 1.13  # rad, 65°: of the field below the horizontal, at middle latitudes


def shape(signal: Signal, *, form: str) -> Float[Array, "time channels columns"]:
    """The field, of unit size, along the input axis or all three; any direction where the room's axes are not known."""
    room = jnp.asarray(signal.room)
    if not signal.oriented:
        return room if form == "own" else room[:, :, int(form)][:, None, :]
    field = room[:, :, 0] * jnp.cos(DIP) - room[:, :, 2] * jnp.sin(DIP)
    if form == "own":
        return field[:, :, None]
    if form == "horizontal":
        return room[:, :, 0][:, None, :]
    return field[:, None, :]


def variants(signal: Signal) -> tuple[Variant, ...]:
    """Along the input axis, and through all three; the horizontal field by itself if something shields."""
    if not signal.oriented:
        return (Variant("own axis", {"form": "own"}),)
    return tuple(Variant(f"{form} axis", {"form": form}) for form in ("own", "any", "horizontal"))


EFFECT = Effect(
    name="magnetic",
    title="magnetic sensitivity (IEEE 952)",
    equation="M B, B fixed to the room",
    units={"accel": "m/s^2", "gyro": "rad/s"},
    prior={
        "accel": {
            "navigation": (0.5 * MICRO_G, 20 * MICRO_G),
            "tactical": (5 * MICRO_G, 100 * MICRO_G),
            "consumer": (10 * MICRO_G, 500 * MICRO_G),
        },
        "gyro": {
            "navigation": (0.005 * DEG_PER_HOUR, 1 * DEG_PER_HOUR),
            "tactical": (0.1 * DEG_PER_HOUR, 5 * DEG_PER_HOUR),
            "consumer": (1 * DEG_PER_HOUR, 100 * DEG_PER_HOUR),
        },
    },
    shape=shape,
    variants=variants,
    needs="rests with different headings at known attitude",
    driver="attitude",
    sentence="The output of {channels} depends on the direction in the room, as a magnetic field would make it.",
    separating="Helmholtz coil; turn the heading at the same specific force",
    requires=("room",),
)
