"""Periodic interference."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Float

from .._typing import AnyArray, Scalar
from . import arrays as xp
from .effect import by_grade, DEG_PER_HOUR, Effect, MICRO_G, over
from .moment import Moment, of_the_moment
from .signal import Signal


FASTEST = 0.04  # Hz: some blocks of a few seconds to a period
SAMPLED = 0.45  # of the blocks' rate: half of it is what they can tell at all


def shape(signal: Signal, *, frequency: Scalar | float) -> Float[AnyArray, "time channels columns"]:
    """Sine and cosine of one frequency, Hz."""
    phase = 2.0 * xp.pi * frequency * xp.asarray(signal.time)
    return xp.stack([xp.sin(phase), xp.cos(phase)], axis=-1)[:, None, :]


def highest_of_blocks(step: float) -> float:
    """Hz, up to which means over blocks of `step` s show a line; the samples of rests tell what is faster."""
    return min(FASTEST, SAMPLED / step)


def _grid(signal: Signal):
    step = float(np.median(np.diff(np.asarray(signal.time))))
    highest = highest_of_blocks(step)
    lowest = 4.0 / signal.duration
    return np.linspace(lowest, highest, int(min(450, max(2, (highest - lowest) * signal.duration))))


variants = over("frequency", _grid)


def _now(moment: Moment, settings: Mapping[str, Any]) -> Float[AnyArray, "channels columns"]:
    phase = 2.0 * xp.pi * settings["frequency"] * xp.asarray(moment.time)
    return xp.stack([xp.sin(phase), xp.cos(phase)])[None, :]


EFFECT = Effect(
    name="interference",
    title="sinusoidal noise (IEEE 952)",
    equation="a sin(2 pi f t) + b cos(2 pi f t)",
    units={"accel": "m/s^2", "gyro": "rad/s"},
    prior={
        "accel": by_grade((1, 100), (5, 500), (20, 2000), unit=MICRO_G),
        "gyro": by_grade((0.001, 1), (0.5, 20), (5, 200), unit=DEG_PER_HOUR),
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
    online=of_the_moment(_now),
    lost="its phase is known in the diagnosed recordings only",
)
