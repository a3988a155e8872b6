"""A step of the bias at some moment."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Float

from .._typing import AnyArray, Scalar
from . import arrays as xp
from .effect import by_grade, DEG_PER_HOUR, Effect, MICRO_G, over
from .moment import Moment, of_the_moment
from .signal import Signal


def shape(signal: Signal, *, time: Scalar | float) -> Float[AnyArray, "time channels columns"]:
    """Zero before the moment, one from then on."""
    return xp.where(xp.asarray(signal.time) >= time, 1.0, 0.0)[:, None, None]


MOMENTS = 72  # tried over a campaign
EVEN = 24  # of them at least evenly spread


def _grid(signal: Signal) -> Float[np.ndarray, " moment"]:
    """Moments to try: the beginnings of stays where they are few, and others evenly spread.

    A jump between two stays shows at no moment within one: with a dozen rests, the nearest moment of an even grid puts
    a whole rest on the wrong side.
    """
    t = np.asarray(signal.time)
    moves = 1 + np.flatnonzero(np.diff(np.asarray(signal.since_move)) < 0)
    few = len(moves) <= MOMENTS - EVEN
    count = min(len(t), MOMENTS - len(moves) if few else MOMENTS)
    even = np.linspace(0, len(t) - 1, count).astype(int)
    edge = 4 * len(t) // MOMENTS  # a jump so near to an end is not told from a disturbed stay
    among = np.concatenate([even, moves]) if few else even
    return np.unique(t[among[(among >= edge) & (among < len(t) - edge)]])


variants = over("time", _grid)


def _now(moment: Moment, settings: Mapping[str, Any]) -> Float[AnyArray, "channels columns"]:
    zero = xp.zeros_like(xp.asarray(moment.temperature))
    return xp.where(moment.time >= settings["time"], zero + 1.0, zero)[None, None]


EFFECT = Effect(
    name="bias_step",
    title="bias jump (popcorn, turn-on, shock)",
    equation="c H(t - t0)",
    units={"accel": "m/s^2", "gyro": "rad/s"},
    prior={
        "accel": by_grade((5, 100), (50, 2000), (100, 5000), unit=MICRO_G),
        "gyro": by_grade((0.003, 0.03), (1, 20), (5, 200), unit=DEG_PER_HOUR),
    },
    shape=shape,
    in_numpy=True,
    variants=variants,
    needs="recordings before and after the moment",
    driver="time",
    sentence="The bias of {channels} jumped at one moment.",
    separating="repeat at the same temperature and position; log shocks and power",
    slow=True,
    nuisance="time",
    online=of_the_moment(_now),
    clocked=True,
    jump=True,
)
