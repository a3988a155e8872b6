"""First-order thermal lag from the probe to the sensing element."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from .._typing import AnyArray, Scalar
from . import arrays as xp
from .effect import any_grade, change_at, Effect, lag, lag_step, over
from .moment import Moment, Online
from .signal import Signal


PAUSE = 30.0  # s between rows, from which on the power may have been off (convention)
JOINT = 5.0  # °C from one row to the next, which no device does
# s, in which a chamber at a slow 0.5 °C/min goes by `JOINT` and may come back: its course is then untold whatever the
# ends say.
AWAY = 600.0
SHORTEST = 6.0  # s; sensors lag by more, and what is shorter looks like a disturbance


def element_behind(signal: Signal, time_constant: Scalar | float) -> Float[AnyArray, " time"]:
    """Temperature of elements that follow the probe (°C), in equilibrium at the start and where `since_anew` is zero.

    From a moment on both courses differ by what they differed there, and by $e^{-t/\\tau}$ of it after t s.
    """
    time, probe = xp.asarray(signal.time), xp.asarray(signal.temperature)
    element = lag(time, probe, time_constant)
    if signal.since_anew is None:
        return element
    since = xp.asarray(signal.since_anew)
    # Half of the finest step, 100 kHz, before it: the difference of two times is rounded.
    first = xp.searchsorted(time, time - since - 5e-6)
    return element + (probe - element)[first] * xp.exp(-since / time_constant)


def shape(
    signal: Signal, *, time_constant: Scalar | float
) -> Float[AnyArray, "time channels columns"]:
    """Difference of the model's outputs at the element's and at the probe's temperature.

    What a pause between recordings, or within one, did to the element decays as it does.
    """
    probe, outputs = signal.temperature, signal.at_temperature
    assert probe is not None and outputs is not None  # `requires` names both
    element = element_behind(signal, time_constant)
    if signal.ahead is not None:
        left = xp.exp(-xp.asarray(signal.rows_for) / time_constant)
        element = element + xp.asarray(signal.ahead) * left
    return change_at(outputs, element, probe)[:, :, None]


def _grid(signal: Signal):
    return np.geomspace(SHORTEST, min(2000.0, signal.duration / 4), 18)


variants = over("time_constant", _grid)


def _begin(settings: Mapping[str, Any], temperature: AnyArray) -> tuple[AnyArray, AnyArray]:
    del settings
    return temperature, temperature


def is_anew(
    pause: AnyArray | Scalar | float, change: AnyArray | Scalar | float
) -> Bool[AnyArray, "..."] | bool | np.bool:
    """Whether elements begin in equilibrium after a pause of so many s at whose ends the probe differs by `change`, °C.

    A chamber that is led to another temperature while nobody records goes there soon and is waited for: a straight line
    over the pause, which is good for small changes, has late elements behind at its end.
    """
    return (pause > PAUSE) & ((abs(change) > JOINT) | (pause > AWAY))


def _follow(
    state: tuple[AnyArray, AnyArray], moment: Moment, settings: Mapping[str, Any]
) -> tuple[tuple[AnyArray, AnyArray], Float[AnyArray, "channels columns"]]:
    probe = xp.asarray(moment.temperature)
    anew = is_anew(xp.asarray(moment.step), probe - state[1])
    state = lag_step(state, probe, moment.step, settings["time_constant"])
    state = (xp.where(anew, probe, state[0]), state[1])
    return state, (moment.at_temperature(state[0]) - moment.at_temperature(probe))[:, None]


EFFECT = Effect(
    name="thermal_lag",
    title="thermal lag between probe and element",
    equation="tau dT_s/dt = T_p - T_s; output at T_s instead of T_p",
    units={"accel": "1", "gyro": "1"},
    prior={"accel": any_grade(0.5, 1.5), "gyro": any_grade(0.5, 1.5)},
    shape=shape,
    in_numpy=True,
    variants=variants,
    needs="ramps of temperature where the parameters depend on it",
    driver="temperature_rate",
    sentence="The sensing element of {channels} follows the probe with a first-order lag.",
    separating="two ramp rates with a soak between: a lag scales with the parameter's slope, a rate effect does not",
    requires=("temperature", "at_temperature"),
    nuisance="time_constant",
    unit_amplitude=True,
    once=True,
    opposite="probe_lag",
    package=True,  # one probe serves the three elements
    online=Online(_begin, _follow),
)
