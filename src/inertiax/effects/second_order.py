"""Second-order coefficient K2."""

from jaxtyping import Float

from .._typing import AnyArray
from . import arrays as xp
from .effect import by_grade, Effect, MICRO_G
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
    prior={"accel": by_grade((5, 40), (20, 300), (50, 1000), unit=MICRO_G)},
    shape=shape,
    in_numpy=True,
    needs="at least three levels of specific force along the axis",
    driver="specific_force",
    sentence="The output of {channels} has a second-order term in specific force.",
    separating="centrifuge, or vibration; positions every 30 degrees",
    instant=True,
    seen_in_means=True,
)
