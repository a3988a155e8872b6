"""Settling: a transient after each re-positioning."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Float

from .._typing import AnyArray, Scalar
from . import arrays as xp
from .effect import by_grade, DEG_PER_HOUR, Effect, MICRO_G, Variant
from .form_units import per_input, Settings
from .moment import Moment, Online
from .signal import Signal


def shape(
    signal: Signal, *, time_constant: Scalar | float, size: str
) -> Float[AnyArray, "time channels columns"]:
    """exp(-t_s / tau) after each move, of equal size or in proportion to the change of the input along the axis."""
    decay = xp.exp(-xp.asarray(signal.since_move) / time_constant)[:, None, None]
    if size == "equal":
        return decay
    move = xp.asarray(signal.move)
    if size == "signed":
        return decay * move[:, :, None]
    return decay * xp.norm(move, axis=1)[:, None, None]


def variants(signal: Signal) -> tuple[Variant, ...]:
    """Time constants from 0.7 s to the length of the longest rest; none where the device never moves."""
    if not np.any(np.diff(np.asarray(signal.since_move)) < 0.0):
        return ()
    longest = float(np.max(np.asarray(signal.since_move)))
    grid = np.geomspace(0.7, max(2.0, min(600.0, longest)), 12)
    if not np.any(np.asarray(signal.move)):
        sizes = ("equal",)
    else:
        sizes = ("equal", "signed", "distance")
    return tuple(
        Variant(f"time_constant={v:.4g}, {s}", {"time_constant": float(v), "size": s})
        for s in sizes
        for v in grid
    )


def _begin(settings: Mapping[str, Any], temperature: AnyArray) -> tuple[AnyArray, ...]:
    del settings
    zero = xp.zeros_like(temperature)
    vector, no = xp.zeros(3, zero.dtype), xp.zeros((), bool)
    return zero, vector, vector, no, no


def _follow(
    state: tuple[AnyArray, ...], moment: Moment, settings: Mapping[str, Any]
) -> tuple[tuple[AnyArray, ...], Float[AnyArray, "channels columns"]]:
    """The input of the last rest is known when a new one begins; the first rest has no move."""
    since, last, move, resting, rested = state
    now = xp.asarray(moment.input)
    begins = moment.at_rest & ~resting
    since = xp.where(begins, 0.0, since + xp.asarray(moment.step))
    move = xp.where(begins, xp.where(rested, now - last, 0.0), move)
    last = xp.where(moment.at_rest, now, last)
    state = since, last, move, moment.at_rest, rested | moment.at_rest
    decay = xp.exp(-since / settings["time_constant"])
    if settings["size"] == "equal":
        return state, decay[None, None]
    own = xp.where(moment.at_rest, move, 0.0)
    if settings["size"] == "signed":
        return state, (decay * own)[:, None]
    return state, (decay * xp.norm(own))[None, None]


def _unit(unit: str, triad: str, settings: Settings, column: int) -> str:
    """In proportion to a change of the input: per input."""
    del column
    return unit if settings["size"] == "equal" else per_input(triad)


EFFECT = Effect(
    name="settling",
    title="settling after re-positioning (creep, eddy currents, fluid)",
    equation="c s exp(-t_s / tau); t_s since the move, s = 1 or the change of the input",
    units={"accel": "m/s^2", "gyro": "rad/s"},
    prior={
        "accel": by_grade((1, 50), (5, 200), (10, 500), unit=MICRO_G),
        "gyro": by_grade((0.001, 0.1), (1, 20), (5, 100), unit=DEG_PER_HOUR),
    },
    shape=shape,
    unit_of_form=_unit,
    in_numpy=True,
    variants=variants,
    needs="several blocks within each rest",
    driver="time_since_move",
    sentence="The output of {channels} settles after each re-positioning.",
    separating="longer rests, and the same position reached from two sides",
    nuisance="time_constant",
    once=True,
    online=Online(_begin, _follow),
    wants_rests=True,
)
