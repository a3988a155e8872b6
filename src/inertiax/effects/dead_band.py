"""Dead band or lock-in: the output is flat near zero rate."""

import numpy as np
from jaxtyping import Float

from .._typing import AnyArray, Scalar
from . import arrays as xp
from .effect import any_grade, Effect, Variant
from .signal import Signal


def shape(
    signal: Signal, *, width: Scalar | float, form: str
) -> Float[AnyArray, "time channels columns"]:
    """What lock-in (sqrt(w² - w_L²) above w_L, nothing below) or a dead zone takes away."""
    w = xp.asarray(signal.input)
    if form == "zone":
        return -xp.where(xp.abs(w) < width, w, 0.0)[:, :, None]
    if form == "offset":
        return -xp.clip(w, -width, width)[:, :, None]
    locked = xp.sign(w) * xp.sqrt(xp.maximum(w**2 - width**2, 0.0))
    return (locked - w)[:, :, None]


def variants(signal: Signal) -> tuple[Variant, ...]:
    """Widths from below the smallest to half of the largest rate."""
    rates = np.abs(np.asarray(signal.input))
    largest = float(rates.max())
    if largest <= 0.0:
        return ()
    grid = np.geomspace(max(2e-6, 1e-5 * largest), 0.5 * largest, 14)
    return tuple(
        Variant(f"width={v:.4g}, {f}", {"width": float(v), "form": f})
        for f in ("lock-in", "zone", "offset")
        for v in grid
    )


EFFECT = Effect(
    name="dead_band",
    title="dead band, lock-in (IEEE 647)",
    equation="w_out = sign(w) sqrt(w^2 - w_L^2), 0 below w_L",
    units={"gyro": "1"},
    prior={"gyro": any_grade(0.3, 1.5)},
    shape=shape,
    in_numpy=True,
    variants=variants,
    needs="rates near zero, fractions of the Earth rate included",
    driver="rate",
    sentence="The output of {channels} is flat near zero rate.",
    separating="slow rates through zero",
    nuisance="width",
    nuisance_unit="rad/s",
    unit_amplitude=True,
    once=True,
    flat_at_zero=True,
    instant=True,
)
