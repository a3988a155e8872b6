"""Delay of the outputs against the reference."""

from collections.abc import Mapping
from typing import Any

from jaxtyping import Float

from .._typing import AnyArray
from . import arrays as xp
from .effect import by_grade, Effect, gradient, inputs, inputs_at
from .moment import Moment, Online
from .signal import Signal


def shape(signal: Signal) -> Float[AnyArray, "time channels columns"]:
    """Minus the derivative of the input, m/s² or rad/s per s."""
    u = inputs(signal)
    slope = gradient(u, signal.time)
    moving = xp.logical_not(xp.asarray(signal.at_rest))
    return xp.where(moving[:, None], -slope, 0.0)[:, :, None]


def _begin(settings: Mapping[str, Any], temperature: AnyArray) -> AnyArray:
    del settings
    return xp.zeros(3, temperature.dtype)


def _follow(
    state: AnyArray, moment: Moment, settings: Mapping[str, Any]
) -> tuple[AnyArray, Float[AnyArray, "channels columns"]]:
    """With the difference to the sample before for the slope."""
    del settings
    now = inputs_at(moment.triad, moment.input)
    slope = (now - state) / moment.step
    still = moment.first | moment.at_rest
    return now, -xp.where(still, xp.zeros_like(now), slope)[:, None]


EFFECT = Effect(
    name="time_delay",
    title="group delay, time synchronisation",
    equation="f(t - d) = f - d df/dt",
    units={"accel": "s", "gyro": "s"},
    prior={
        "accel": by_grade((0.0001, 0.005), (0.0001, 0.01), (0.001, 0.02)),
        "gyro": by_grade((0.0001, 0.005), (0.0001, 0.01), (0.001, 0.02)),
    },
    shape=shape,
    in_numpy=True,
    needs="a reference and ramps of the input, in rows at most 50 ms apart or ten a ramp",
    driver="rate_of_change",
    sentence="The output of {channels} lags the reference.",
    separating="reverse the direction of rotation: the error changes sign",
    online=Online(_begin, _follow),
    wants_rests=True,
    stream_delay=True,
)
