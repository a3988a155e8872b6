"""First-order thermal lag from the probe to the sensing element."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Float

from .._typing import AnyArray, Scalar
from . import arrays as xp
from .effect import any_grade, change_at, Effect, lag, lag_step, over
from .moment import Moment, Online
from .signal import Signal


SHORTEST = 6.0  # s; sensors lag by more, and what is shorter looks like a disturbance


def shape(
    signal: Signal, *, time_constant: Scalar | float
) -> Float[AnyArray, "time channels columns"]:
    """Difference of the model's outputs at the element's and at the probe's temperature.

    What a pause between recordings, or within one, did to the element decays as it does.
    """
    probe, outputs = signal.temperature, signal.at_temperature
    assert probe is not None and outputs is not None  # `requires` names both
    element = lag(signal.time, probe, time_constant)
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


def _follow(
    state: tuple[AnyArray, AnyArray], moment: Moment, settings: Mapping[str, Any]
) -> tuple[tuple[AnyArray, AnyArray], Float[AnyArray, "channels columns"]]:
    probe = xp.asarray(moment.temperature)
    state = lag_step(state, probe, moment.step, settings["time_constant"])
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
