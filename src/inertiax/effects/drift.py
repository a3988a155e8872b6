"""Drift: linear in running time."""

from collections.abc import Mapping
from typing import Any

from jaxtyping import Float

from .._typing import AnyArray
from . import arrays as xp
from .effect import by_grade, DEG_PER_HOUR, Effect, fixed, inputs, inputs_at, MICRO_G
from .form_units import by_what_it_acts_on
from .moment import Moment, of_the_moment
from .signal import Signal


def shape(signal: Signal, *, on: str) -> Float[AnyArray, "time channels columns"]:
    """Time since the middle of the campaign, s; on the bias or times the input."""
    time = xp.asarray(signal.time)
    time = time - 0.5 * (time[0] + time[-1])
    if on == "bias":
        return time[:, None, None]
    return inputs(signal)[:, :, None] * time[:, None, None]


def _now(moment: Moment, settings: Mapping[str, Any]) -> Float[AnyArray, "channels columns"]:
    """From the beginning of the data that it was fitted on, held at their end."""
    time = xp.minimum(moment.time, moment.duration) - 0.5 * xp.asarray(moment.duration)
    if settings["on"] == "bias":
        return time[None, None]
    return (inputs_at(moment.triad, moment.input) * time)[:, None]


EFFECT = Effect(
    name="drift",
    title="bias drift, ramp R (IEEE 952)",
    equation="c (t - t_m), t_m the middle of the recordings",
    units={"accel": "m/s^2/s", "gyro": "rad/s/s"},
    prior={
        "accel": by_grade((1e-10, 1e-07), (1e-09, 1e-06), (1e-08, 1e-05)),
        "gyro": by_grade((1e-13, 1e-09), (1e-11, 1e-08), (1e-10, 1e-07)),
    },
    # In minutes a warm-up is a straight line, and its slope is far above that of months.
    change={
        "accel": by_grade((10, 300), (50, 1000), (100, 3000), unit=MICRO_G),
        "gyro": by_grade((0.01, 0.5), (2, 50), (10, 200), unit=DEG_PER_HOUR),
    },
    shape=shape,
    unit_of_form=by_what_it_acts_on,
    in_numpy=True,
    variants=fixed(("bias", {"on": "bias"}), ("scale", {"on": "scale"})),
    needs="running time not tied to temperature or position",
    driver="time",
    sentence="The output of {channels} drifts linearly with time.",
    separating="return to the first temperature and position; temperatures in random order",
    slow=True,
    online=of_the_moment(_now),
    seen_in_means=True,
    clocked=True,
)
