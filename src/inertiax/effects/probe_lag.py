"""First-order lag of the probe behind the sensing elements: on a ramp the elements are ahead of what is recorded."""

import numpy as np
from jaxtyping import Float

from .._typing import AnyArray, Scalar
from . import arrays as xp
from .effect import change_at, Effect, over
from .signal import Signal


SHORTEST = 1.5  # s; a probe in its own case lags by seconds at least


def shape(
    signal: Signal, *, time_constant: Scalar | float
) -> Float[AnyArray, "time channels columns"]:
    """Difference of the model's outputs at the elements' temperature, $T_p + \\tau \\dot T_p$, and at the probe's."""
    probe, slope, outputs = signal.temperature, signal.temperature_rate, signal.at_temperature
    assert probe is not None and slope is not None and outputs is not None  # `requires` names them
    element = xp.asarray(probe) + time_constant * xp.asarray(slope)
    return change_at(outputs, element, probe)[:, :, None]


variants = over(
    "time_constant", lambda signal: np.geomspace(SHORTEST, min(600.0, signal.duration / 8), 12)
)


EFFECT = Effect(
    name="probe_lag",
    title="thermal lag of the probe behind the elements",
    equation="tau dT_p/dt = T_s - T_p; output at T_s = T_p + tau dT_p/dt instead of T_p",
    units={"accel": "1", "gyro": "1"},
    prior={
        "accel": {"navigation": (0.5, 1.5), "tactical": (0.5, 1.5), "consumer": (0.5, 1.5)},
        "gyro": {"navigation": (0.5, 1.5), "tactical": (0.5, 1.5), "consumer": (0.5, 1.5)},
    },
    shape=shape,
    in_numpy=True,
    variants=variants,
    needs="ramps of temperature where the parameters depend on it",
    driver="temperature_rate",
    sentence="The probe follows the sensing elements of {channels} with a first-order lag.",
    separating="two ramp rates with a soak between: a lag scales with every parameter's slope, a rate effect does not",
    requires=("temperature", "temperature_rate", "at_temperature"),
    nuisance="time_constant",
    unit_amplitude=True,
    once=True,
    opposite="thermal_lag",
    package=True,
    singly=False,  # one probe that lags does so for all channels; one channel's is `temperature_rate`
)
