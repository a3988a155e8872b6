"""Third-order coefficient K3."""

from jaxtyping import Float

from .._typing import AnyArray
from . import arrays as xp
from .effect import by_grade, Effect, MICRO_G
from .signal import Signal


def shape(signal: Signal) -> Float[AnyArray, "time channels columns"]:
    """f³, g³."""
    f = xp.asarray(signal.input)
    return (f * f * f)[:, :, None]  # a power takes fifty times as long


EFFECT = Effect(
    name="third_order",
    title="K3, third-order coefficient (IEEE 1293)",
    equation="K3 f^3",
    units={"accel": "m/s^2/g^3"},
    prior={"accel": by_grade((0.1, 5), (2, 50), (5, 100), unit=MICRO_G)},
    shape=shape,
    in_numpy=True,
    needs="at least three levels of |f| along the axis",
    driver="specific_force",
    sentence="The output of {channels} has a third-order term in specific force.",
    separating="centrifuge with three or more levels",
    instant=True,
    seen_in_means=True,
)
