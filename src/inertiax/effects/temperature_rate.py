"""Output proportional to the rate of temperature (Shupe effect and its mechanical kin)."""

from collections.abc import Mapping
from typing import Any

from jaxtyping import Float

from .._typing import AnyArray, Scalar
from . import arrays as xp
from .effect import (
    by_grade,
    DEG_PER_HOUR,
    Effect,
    inputs,
    inputs_at,
    lag,
    lag_step,
    MICRO_G,
    Variant,
)
from .form_units import by_what_it_acts_on, Settings
from .moment import Moment, Online
from .signal import Signal


def shape(
    signal: Signal, *, time_constant: Scalar | float, on: str
) -> Float[AnyArray, "time channels columns"]:
    """dT/dt in °C/min, by the probe or behind it by a lag; on the bias, times the input, or with d²T/dt² beside it."""
    rate = xp.asarray(signal.temperature_rate) * 60.0
    if time_constant > 0.0:
        rate = lag(signal.time, rate, time_constant)
    if on == "bias":
        return rate[:, None, None]
    if on == "scale":
        return inputs(signal)[:, :, None] * rate[:, None, None]
    change = (rate - lag(signal.time, rate, 60.0)) / 60.0
    return xp.stack([rate, change], axis=-1)[:, None, :]


def variants(signal: Signal) -> tuple[Variant, ...]:
    """On the bias, on the scale factor, and with the second derivative."""
    forms = [(0.0, "bias"), (30.0, "bias"), (0.0, "scale"), (0.0, "gradient")]
    return tuple(Variant(f"{on}, {tau:g} s", {"time_constant": tau, "on": on}) for tau, on in forms)


def _begin(settings: Mapping[str, Any], temperature: AnyArray) -> tuple[AnyArray, ...]:
    del settings
    zero = xp.zeros_like(temperature)
    return temperature, zero, zero, zero, zero, xp.zeros((), bool)


def _follow(
    state: tuple[AnyArray, ...], moment: Moment, settings: Mapping[str, Any]
) -> tuple[tuple[AnyArray, ...], Float[AnyArray, "channels columns"]]:
    """With the difference to the sample before for dT/dt."""
    now, step = xp.asarray(moment.temperature), moment.step
    slope = (now - state[0]) / step * 60.0
    # Like `lag`, in equilibrium with the first slope that is known.
    start = ~state[5]
    lagged, last = (xp.where(start, slope, x) for x in state[1:3])
    tau = settings["time_constant"]
    lagged, last = lag_step((lagged, last), slope, step, xp.maximum(tau, 1e-9))
    rate = xp.where(tau > 0.0, lagged, slope)
    slow, before = (xp.where(start, rate, x) for x in state[3:5])
    slow, before = lag_step((slow, before), rate, step, 60.0)
    state = (now, lagged, last, slow, before, ~moment.first)
    if settings["on"] == "bias":
        return state, rate[None, None]
    if settings["on"] == "scale":
        return state, (inputs_at(moment.triad, moment.input) * rate)[:, None]
    return state, xp.stack([rate, (rate - slow) / 60.0])[None, :]


def _unit(unit: str, triad: str, settings: Settings, column: int) -> str:
    """The second column of `gradient` is the rate's own rate, (°C/min)/s."""
    unit = by_what_it_acts_on(unit, triad, settings, column)
    return unit.replace("(degC/min)", "(degC/min/s)") if column else unit


EFFECT = Effect(
    name="temperature_rate",
    title="temperature-rate sensitivity D_Tdot (IEEE 952), Shupe effect",
    equation="c dT/dt (+ c2 d2T/dt2)",
    units={"accel": "m/s^2/(degC/min)", "gyro": "rad/s/(degC/min)"},
    prior={
        "accel": by_grade((5, 100), (20, 500), (100, 1000), unit=MICRO_G),
        "gyro": by_grade((0.01, 0.5), (1, 20), (5, 50), unit=DEG_PER_HOUR),
    },
    shape=shape,
    unit_of_form=_unit,
    in_numpy=True,
    variants=variants,
    needs="ramps of temperature of different rates and signs",
    driver="temperature_rate",
    sentence="The output of {channels} is proportional to the rate of temperature.",
    separating="constant-rate ramps of both signs at several rates with soaks between them",
    requires=("temperature", "temperature_rate"),
    online=Online(_begin, _follow),
    seen_in_means=True,
)
