"""Scale-factor asymmetry: different scale factors for positive and negative input."""

from jaxtyping import Float

from .._typing import AnyArray
from . import arrays as xp
from .effect import Effect, fixed, MICRO_G
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
        "accel": {
            "navigation": (5 * MICRO_G, 100 * MICRO_G),
            "tactical": (50 * MICRO_G, 1000 * MICRO_G),
            "consumer": (200 * MICRO_G, 3000 * MICRO_G),
        },
        "gyro": {
            "navigation": (1e-06, 5e-05),
            "tactical": (1e-05, 0.0005),
            "consumer": (0.0001, 0.003),
        },
    },
    shape=shape,
    in_numpy=True,
    variants=fixed(("", {})),
    needs="both signs of the input at several levels",
    driver="input",
    sentence="The scale factor of {channels} differs between positive and negative input.",
    separating="fine steps of input near zero; rate table in both directions",
    instant=True,
    seen_in_means=True,
)
