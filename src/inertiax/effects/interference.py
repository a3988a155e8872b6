"""Periodic interference."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Float

from .._typing import AnyArray, Scalar
from . import arrays as xp
from .effect import DEG_PER_HOUR, Effect, MICRO_G, over
from .moment import Moment, Online
from .signal import Signal


def shape(signal: Signal, *, frequency: Scalar | float) -> Float[AnyArray, "time channels columns"]:
    """Sine and cosine of one frequency, Hz."""
    phase = 2.0 * xp.pi * frequency * xp.asarray(signal.time)
    return xp.stack([xp.sin(phase), xp.cos(phase)], axis=-1)[:, None, :]


def _grid(signal: Signal):
    step = float(np.median(np.diff(np.asarray(signal.time))))
    highest = min(0.04, 0.45 / step)
    lowest = 4.0 / signal.duration
    return np.linspace(lowest, highest, int(min(450, max(2, (highest - lowest) * signal.duration))))


variants = over("frequency", _grid)


def _begin(settings: Mapping[str, Any], temperature: AnyArray) -> tuple:
    del settings, temperature
    return ()


def _follow(
    state: tuple, moment: Moment, settings: Mapping[str, Any]
) -> tuple[tuple, Float[AnyArray, "channels columns"]]:
    phase = 2.0 * xp.pi * settings["frequency"] * xp.asarray(moment.time)
    return state, xp.stack([xp.sin(phase), xp.cos(phase)])[None, :]


EFFECT = Effect(
    name="interference",
    title="sinusoidal noise (IEEE 952)",
    equation="a sin(2 pi f t) + b cos(2 pi f t)",
    units={"accel": "m/s^2", "gyro": "rad/s"},
    prior={
        "accel": {
            "navigation": (1 * MICRO_G, 100 * MICRO_G),
            "tactical": (5 * MICRO_G, 500 * MICRO_G),
            "consumer": (20 * MICRO_G, 2000 * MICRO_G),
        },
        "gyro": {
            "navigation": (0.001 * DEG_PER_HOUR, 1 * DEG_PER_HOUR),
            "tactical": (0.5 * DEG_PER_HOUR, 20 * DEG_PER_HOUR),
            "consumer": (5 * DEG_PER_HOUR, 200 * DEG_PER_HOUR),
        },
    },
    shape=shape,
    in_numpy=True,
    variants=variants,
    needs="a recording of many periods",
    driver="time",
    sentence="The output of {channels} carries a periodic disturbance.",
    separating="change the sampling rate or the power supply; log the suspected source",
    nuisance="frequency",
    nuisance_unit="Hz",
    slow=True,
    online=Online(_begin, _follow),
    lost="its phase is known in the diagnosed recordings only",
)
