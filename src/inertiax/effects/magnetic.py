"""Sensitivity to the magnetic field, which is fixed to the room."""

import numpy as np
from jaxtyping import Float

from .._typing import AnyArray, Scalar
from . import arrays as xp
from .effect import by_grade, DEG_PER_HOUR, Effect, MICRO_G, Variant
from .signal import Signal


DIP = 1.13  # rad, 65°: of the field below the horizontal, at middle latitudes


AZIMUTHS = 12  # horizontal directions that the field may have where north is not known


def shape(
    signal: Signal, *, form: str, azimuth: Scalar | float = 0.0
) -> Float[AnyArray, "time channels columns"]:
    """The field, of unit size, along the input axis or all three; any direction where up is not known.

    `azimuth`, rad, turns the field's horizontal part from the room's first axis.
    """
    room = xp.asarray(signal.room)
    if form == "own" and not signal.oriented:
        return room
    level = room[:, :, 0] * xp.cos(azimuth) + room[:, :, 1] * xp.sin(azimuth)
    field = level * xp.cos(DIP) - room[:, :, 2] * xp.sin(DIP)
    if form == "own":
        return field[:, :, None]
    if form == "horizontal":
        return level[:, None, :]
    return field[:, None, :]


def variants(signal: Signal) -> tuple[Variant, ...]:
    """Along the input axis, and through all three; the horizontal field by itself if something shields."""
    if signal.oriented:
        return tuple(
            Variant(f"{form} axis", {"form": form}) for form in ("own", "any", "horizontal")
        )
    own = Variant("own axis", {"form": "own"})
    if not signal.upright:
        return (own,)
    grid = 2.0 * np.pi / AZIMUTHS * np.arange(AZIMUTHS)
    return (
        own,
        *(
            Variant(
                f"any axis, azimuth {np.rad2deg(a):.0f} deg", {"form": "any", "azimuth": float(a)}
            )
            for a in grid
        ),
    )


EFFECT = Effect(
    name="magnetic",
    title="magnetic sensitivity (IEEE 952)",
    equation="c b; b of unit size, along a field fixed to the room",
    units={"accel": "m/s^2", "gyro": "rad/s"},
    prior={
        "accel": by_grade((0.5, 20), (5, 100), (10, 500), unit=MICRO_G),
        "gyro": by_grade((0.005, 1), (0.1, 5), (1, 100), unit=DEG_PER_HOUR),
    },
    shape=shape,
    in_numpy=True,
    variants=variants,
    needs="rests with different headings at known attitude",
    driver="attitude",
    sentence="The output of {channels} depends on the direction in the room, as a magnetic field would make it.",
    separating="Helmholtz coil; turn the heading at the same specific force",
    requires=("room",),
    once=True,
)
