"""Saturation: clipping near the ends of the range."""

import numpy as np
from jaxtyping import Float

from .._typing import AnyArray, Scalar
from . import arrays as xp
from .effect import any_grade, BEYOND_EARTH, Effect, inputs, Variant
from .signal import Signal


def shape(
    signal: Signal, *, depth: Scalar | float, side: int
) -> Float[AnyArray, "time channels columns"]:
    """What a clip takes away that leaves `depth`, a part of the largest input, off at both ends or at one."""
    u = inputs(signal)
    limit = (1.0 - depth) * xp.max(xp.abs(u))
    high = xp.maximum(u - limit, 0.0) if side >= 0 else xp.zeros_like(u)
    low = xp.maximum(-u - limit, 0.0) if side <= 0 else xp.zeros_like(u)
    return (low - high)[:, :, None]


def variants(signal: Signal) -> tuple[Variant, ...]:
    """Depths of the clip by factors of two, at both ends or at one; one below the step of the inputs is its size.

    A rate table is driven to the end of a gyro's range on purpose, so that the last rate may be cut by a
    ten-thousandth; that an accelerometer's range ends within a hundredth of gravity would be a coincidence.
    """
    least = 6e-5 if signal.triad == "gyro" else 0.01
    return tuple(
        Variant(f"depth={d:.3g}, side {s:+d}", {"depth": float(d), "side": s})
        for s in (0, 1, -1)
        for d in np.geomspace(least, 0.45, 14 if signal.triad == "gyro" else 8)
    )


EFFECT = Effect(
    name="saturation",
    title="saturation",
    equation="clip(f, -L, L) - f",
    units={"accel": "1", "gyro": "1"},
    prior={"accel": any_grade(0.0001, 1), "gyro": any_grade(0.0001, 1)},
    shape=shape,
    in_numpy=True,
    variants=variants,
    needs="several levels of input near the end of the range",
    driver="input",
    least_rate=BEYOND_EARTH,
    sentence="The output of {channels} saturates near the end of its range.",
    separating="change the range",
    nuisance="depth",
    nuisance_unit="1",
    unit_amplitude=True,
    once=True,
    instant=True,
)
