"""Second-order coefficient K2."""

from jaxtyping import Float

from .._typing import AnyArray
from . import arrays as xp
from .effect import Effect, fixed, MICRO_G
from .signal import Signal


def shape(signal: Signal) -> Float[AnyArray, "time channels columns"]:
    """f², g²."""
    f = xp.asarray(signal.input)
    return xp.square(f)[:, :, None]


EFFECT = Effect(
    name="second_order",
    title="K2, second-order coefficient (IEEE 1293)",
    equation="K2 f^2",
    units={"accel": "m/s^2/g^2"},
    prior={
        "accel": {
            "navigation": (5 * MICRO_G, 40 * MICRO_G),
            "tactical": (20 * MICRO_G, 300 * MICRO_G),
            "consumer": (50 * MICRO_G, 1000 * MICRO_G),
        }
    },
    shape=shape,
    in_numpy=True,
    variants=fixed(("", {})),
    needs="at least three levels of specific force along the axis",
    driver="specific_force",
    sentence="The output of {channels} has a second-order term in specific force.",
    separating="centrifuge, or vibration; positions every 30 degrees",
    instant=True,
    seen_in_means=True,
)
