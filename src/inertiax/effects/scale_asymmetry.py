"""Scale-factor asymmetry: different scale factors for positive and negative input."""

from jaxtyping import Float

from .._typing import AnyArray
from . import arrays as xp
from .effect import BEYOND_EARTH, by_grade, Effect, MICRO_G
from .signal import Signal


def shape(signal: Signal) -> Float[AnyArray, "time channels columns"]:
    """|f| (g) or |ω| (rad/s)."""
    return xp.abs(xp.asarray(signal.input))[:, :, None]


EFFECT = Effect(
    name="scale_asymmetry",
    title="scale-factor asymmetry, half of K1' or K' (IEEE 1293, 952)",
    equation="c |f| or c |w|; c = (K+ - K-)/2, half the difference of the two signs",
    units={"accel": "m/s^2/g", "gyro": "(rad/s)/(rad/s)"},
    prior={
        "accel": by_grade((5, 100), (50, 1000), (200, 3000), unit=MICRO_G),
        "gyro": by_grade((1e-06, 5e-05), (1e-05, 0.0005), (0.0001, 0.003)),
    },
    shape=shape,
    in_numpy=True,
    needs="both signs of the input at several levels",
    driver="input",
    least_rate=BEYOND_EARTH,
    sentence="The scale factor of {channels} differs between positive and negative input.",
    separating="fine steps of input near zero; rate table in both directions",
    instant=True,
    seen_in_means=True,
)
