"""Sensitivity to the supply voltage."""

import numpy as np
from jaxtyping import Float

from .._typing import AnyArray, Scalar
from . import arrays as xp
from .effect import by_grade, DEG_PER_HOUR, Effect, MICRO_G, Variant
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
        "accel": by_grade((1, 20), (10, 200), (100, 2000), unit=MICRO_G),
        "gyro": by_grade((0.001, 0.1), (0.1, 5), (1, 100), unit=DEG_PER_HOUR),
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
