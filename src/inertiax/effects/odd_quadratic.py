"""Odd quadratic coefficient Koq."""

from jaxtyping import Float

from .._typing import AnyArray
from . import arrays as xp
from .effect import by_grade, Effect, MICRO_G
from .signal import Signal


def shape(signal: Signal) -> Float[AnyArray, "time channels columns"]:
    """f |f|, g²."""
    f = xp.asarray(signal.input)
    return (f * xp.abs(f))[:, :, None]


EFFECT = Effect(
    name="odd_quadratic",
    title="Koq, odd quadratic coefficient (IEEE 1293)",
    equation="Koq f |f|",
    units={"accel": "m/s^2/g^2"},
    prior={"accel": by_grade((1, 20), (10, 100), (20, 300), unit=MICRO_G)},
    shape=shape,
    in_numpy=True,
    needs="at least three levels of |f| along the axis",
    driver="specific_force",
    sentence="The output of {channels} has an odd quadratic term in specific force.",
    separating="centrifuge with three or more levels",
    instant=True,
    seen_in_means=True,
)
