"""First-order thermal lag from the probe to the sensing element."""

import numpy as np
from jaxtyping import Array, Float

from .._typing import Scalar
from .effect import Effect, lag, over
from .signal import Signal


def shape(
    signal: Signal, *, time_constant: Scalar | float
) -> Float[Array, "time channels columns"]:
    """Difference of the model's outputs at the element's and at the probe's temperature."""
    element = lag(signal.time, signal.temperature, time_constant)
    return (signal.at_temperature(element) - signal.at_temperature(signal.temperature))[:, :, None]


def _grid(signal: Signal):
    return np.geomspace(4.0, min(2000.0, signal.duration / 4), 18)


variants = over("time_constant", _grid)

EFFECT = Effect(
    name="thermal_lag",
    title="thermal lag between probe and element",
    equation="tau dT_s/dt = T_p - T_s; output at T_s instead of T_p",
    units={"accel": "1", "gyro": "1"},
    prior={
        "accel": {"navigation": (0.5, 1.5), "tactical": (0.5, 1.5), "consumer": (0.5, 1.5)},
        "gyro": {"navigation": (0.5, 1.5), "tactical": (0.5, 1.5), "consumer": (0.5, 1.5)},
    },
    shape=shape,
    variants=variants,
    needs="ramps of temperature where the parameters depend on it",
    driver="temperature_rate",
    sentence="The sensing element of {channels} follows the probe with a first-order lag.",
    separating="two ramp rates and a soak between them; a lag scales with the slope of the parameter, a rate effect does not",
    requires=("temperature", "at_temperature"),
    nuisance="time_constant",
    unit_amplitude=True,
)
