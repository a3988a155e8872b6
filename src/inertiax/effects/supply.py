"""Sensitivity to the supply voltage."""

import numpy as np
from jaxtyping import Float

from .._typing import AnyArray, Scalar
from . import arrays as xp
from .effect import DEG_PER_HOUR, Effect, MICRO_G, Variant
from .signal import Signal


def shape(signal: Signal, *, nominal: Scalar | float) -> Float[AnyArray, "time channels columns"]:
    """Supply voltage about the one at which the bias is stated, V."""
    return (xp.asarray(signal.supply) - nominal)[:, None, None]


def variants(signal: Signal) -> tuple[Variant, ...]:
    """About the campaign's mean voltage; none where it stays."""
    supply = np.asarray(signal.supply)
    if np.ptp(supply) == 0.0:
        return ()
    mean = float(np.round(supply.mean(), 3))
    return (Variant(f"about {mean:g} V", {"nominal": mean}),)


EFFECT = Effect(
    name="supply",
    title="supply-voltage sensitivity (IEEE 952, 1293)",
    equation="c dV",
    units={"accel": "m/s^2/V", "gyro": "rad/s/V"},
    prior={
        "accel": {
            "navigation": (1 * MICRO_G, 20 * MICRO_G),
            "tactical": (10 * MICRO_G, 200 * MICRO_G),
            "consumer": (100 * MICRO_G, 2000 * MICRO_G),
        },
        "gyro": {
            "navigation": (0.001 * DEG_PER_HOUR, 0.1 * DEG_PER_HOUR),
            "tactical": (0.1 * DEG_PER_HOUR, 5 * DEG_PER_HOUR),
            "consumer": (1 * DEG_PER_HOUR, 100 * DEG_PER_HOUR),
        },
    },
    shape=shape,
    in_numpy=True,
    variants=variants,
    needs="a recorded supply voltage that changes",
    driver="supply",
    sentence="The output of {channels} depends on the supply voltage.",
    separating="log the voltage; change it by 5 % at rest",
    requires=("supply",),
    slow=True,
)
