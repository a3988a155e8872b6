"""Warm-up: exponential from power-on."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Float

from .._typing import AnyArray, Scalar
from . import arrays as xp
from .effect import by_grade, DEG_PER_HOUR, Effect, MICRO_G, Variant
from .moment import Moment, of_the_moment
from .signal import Signal


def shape(
    signal: Signal, *, time_constant: Scalar | float, start: str
) -> Float[AnyArray, "time channels columns"]:
    """exp(-t / tau) from each power-on, or from the first only."""
    since = xp.asarray(signal.since_power if start == "each" else signal.since_start)
    return xp.exp(-since / time_constant)[:, None, None]


def variants(signal: Signal) -> tuple[Variant, ...]:
    """Time constants from 30 s to the length of the campaign; from each power-on, and from the first if there are more.

    One as long as the campaign still bends the course by more than a straight drift allows. Of a campaign of minutes
    the shortest is a tenth, in which there are rests enough to show its course: a form that is too slow leaves a
    remainder, which would be taken for a second effect.
    """
    shortest = min(30.0, 0.1 * signal.duration)
    grid = np.geomspace(shortest, max(60.0, min(4000.0, signal.duration)), 16)
    again = bool(np.any(np.asarray(signal.since_power) != np.asarray(signal.since_start)))
    starts = ("each", "first") if again else ("each",)
    return tuple(
        Variant(f"time_constant={v:.4g}, {s}", {"time_constant": float(v), "start": s})
        for s in starts
        for v in grid
    )


def _now(moment: Moment, settings: Mapping[str, Any]) -> Float[AnyArray, "channels columns"]:
    return xp.exp(-xp.asarray(moment.time) / settings["time_constant"])[None, None]


EFFECT = Effect(
    name="warm_up",
    title="warm-up (turn-on transient)",
    equation="c exp(-t / tau), t since power-on",
    units={"accel": "m/s^2", "gyro": "rad/s"},
    prior={
        "accel": by_grade((10, 300), (50, 1000), (100, 3000), unit=MICRO_G),
        "gyro": by_grade((0.01, 0.5), (2, 50), (10, 200), unit=DEG_PER_HOUR),
    },
    shape=shape,
    in_numpy=True,
    variants=variants,
    needs="the recording begins near power-on",
    driver="time_since_power_on",
    sentence="The output of {channels} settles exponentially after power-on.",
    separating="a power cycle at constant temperature, and a start after a long wait",
    nuisance="time_constant",
    slow=True,
    once=True,
    online=of_the_moment(_now),
)
