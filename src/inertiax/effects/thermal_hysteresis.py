"""Thermal hysteresis: depends on the branch, and stays in a soak."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Float

from .._typing import AnyArray, Scalar
from . import arrays as xp
from .effect import by_grade, DEG_PER_HOUR, Effect, inputs, inputs_at, MICRO_G, play, Variant
from .form_units import by_what_it_acts_on
from .moment import Moment, Online
from .signal import Signal


SPREAD = (0.25, 0.5, 1.0, 1.5, 2.0)  # half-widths of the plays side by side, in radii
PAIR = (1.0, 5.0)
WIDEST = 0.45  # of the plays: a loop that is nearly as wide as the range has one turn in it
LEAST = 2.0  # °C, a range of temperature that can hold a loop
# Part of the range: what is less than this hardly counts as a turn, though a probe without noise showed it. Convention.
FINEST = 1e-4
# Half a turn in standard deviations of the probe's noise: 1e5 readings of one temperature spread over 8.8 of them.
APART = 4.5
AT_TURN = 1e-6  # weight by which the branch that was decides where both branches are as near: in a soak at the turn


def shape(
    signal: Signal, *, radius: Scalar | float, loop: str, on: str
) -> Float[AnyArray, "time channels columns"]:
    """Play operator of half-width `radius` (part of the temperature range) less the temperature
    itself, scaled to ±1; Rayleigh's parabolic loop, whose branch turns after `radius`; plays side by
    side (Prandtl and Ishlinskii): in equal parts, or a narrow and a wide one with a coefficient each; or the branch
    alone, −1 while it warms and 1 while it cools, turned where the temperature turns by more than `2 radius`."""
    t = xp.asarray(signal.temperature)
    low, high = xp.min(t), xp.max(t)
    radius = xp.asarray(radius)
    if loop == "branch":
        branch = _branch(t, radius * (high - low))[:, None, None]
        return branch if on == "bias" else inputs(signal)[:, :, None] * branch
    leads = [_lead(t, part * radius * (high - low)) for part in _parts(loop)]
    lead = _loop(xp.stack(leads, axis=-1), t, low, high, loop)
    if on == "bias":
        return lead[:, None, :]
    return inputs(signal)[:, :, None] * lead[:, None, :]


def _parts(loop: str) -> tuple[float, ...]:
    """Half-widths of the plays side by side, in radii."""
    return {"spread": SPREAD, "pair": PAIR}.get(loop, (1.0,))


def _loop(
    lead: Float[AnyArray, "*time plays"],
    t: Float[AnyArray, "*time"],
    low: Scalar | float,
    high: Scalar | float,
    loop: str,
) -> Float[AnyArray, "*time columns"]:
    """The loop's columns from what each play lags behind the temperature."""
    if loop == "spread":
        return xp.mean(lead, axis=-1, keepdims=True)
    if loop == "Rayleigh":
        x = (2.0 * t - (high + low)) / (high - low)
        return lead * (1.0 - x**2)[..., None]
    return lead


def _lead(temperature: Float[AnyArray, " time"], width: Scalar | float) -> Float[AnyArray, " time"]:
    return (play(temperature, width) - temperature) / width


def _branch(
    temperature: Float[AnyArray, " time"], width: Scalar | float
) -> Float[AnyArray, " time"]:
    """−1 while it warms and 1 while it cools.

    Plays that follow the temperature forwards and backwards have it between them, and change sides at its turns: at
    the moment itself, while one of them alone turns a whole play later.
    """
    forwards, backwards = play(temperature, width), play(temperature[::-1], width)[::-1]
    return xp.sign(forwards - backwards + AT_TURN * (forwards - temperature))


def _least_turn(temperature: Float[np.ndarray, " time"]) -> float:
    """Half-width of a play, as a part of the range, that the probe's noise does not cross.

    Second differences of white noise have √6 of its standard deviation, of a course next to nothing. Those that are
    zero say nothing: readings in steps repeat, and what remains are the steps.
    """
    second = np.abs(np.diff(temperature, n=2))
    second = second[second > 0.0]
    noise = float(np.median(second)) / (0.6745 * math.sqrt(6.0)) if len(second) else 0.0
    return max(FINEST, APART * noise / float(np.ptp(temperature)))


def variants(signal: Signal) -> tuple[Variant, ...]:
    """Several widths of play, Rayleigh's loop, plays side by side and the branch; on the bias and on the scale factor.

    None where the temperature hardly changes: a loop has the size of its turn of temperature, and within `LEAST`
    it would be a name for whatever is slow.
    """
    temperature = np.asarray(signal.temperature)
    if np.ptp(temperature) < LEAST:
        return ()
    forms = [("play", r) for r in (0.02, 0.05, 0.1, 0.16, 0.24, 0.33, WIDEST)]
    forms += [("Rayleigh", 0.02), ("spread", 0.1), ("spread", 0.16), ("pair", 0.05)]
    turn = _least_turn(temperature)
    forms += [("branch", turn)] * (turn < WIDEST)
    return tuple(
        Variant(f"{on}, {loop} {r:g}", {"radius": r, "loop": loop, "on": on})
        for on in ("bias", "scale")
        for loop, r in forms
    )


def _begin(settings: Mapping[str, Any], temperature: AnyArray) -> AnyArray:
    if settings["loop"] == "branch":
        return _both(temperature, 0.0)
    return xp.full(len(_parts(settings["loop"])), temperature)


def _follow(
    state: AnyArray, moment: Moment, settings: Mapping[str, Any]
) -> tuple[AnyArray, Float[AnyArray, "channels columns"]]:
    low, high = xp.asarray(moment.coldest), xp.asarray(moment.warmest)
    t = xp.clip(xp.asarray(moment.temperature), low, high)
    if settings["loop"] == "branch":
        state, lead = _follow_branch(state, t, moment, settings["radius"] * (high - low))
        return state, lead if settings["on"] == "bias" else _times_inputs(moment, lead)
    widths = xp.asarray(_parts(settings["loop"])) * settings["radius"] * (high - low)
    # The play begins in the middle, at the temperature within the range.
    state = xp.where(moment.first, t, state)
    state = xp.clip(state, t - widths, t + widths)
    lead = _loop((state - t) / widths, t, low, high, settings["loop"])
    if settings["on"] == "bias":
        return state, lead[None, :]
    return state, _times_inputs(moment, lead[None, :])


def _both(play_now: Scalar | float, branch: Scalar | float) -> AnyArray:
    return xp.where(np.array([True, False]), play_now, branch)


def _follow_branch(
    state: AnyArray, t: Scalar | float, moment: Moment, width: Scalar | float
) -> tuple[AnyArray, Float[AnyArray, "1 1"]]:
    """The play and the branch, which is another one from the end of the play on: a turn shows when it is over."""
    before = xp.where(moment.first, t, state[0])
    now = xp.clip(before, t - width, t + width)
    branch = xp.where(now == before, xp.where(moment.first, 0.0, state[1]), xp.sign(before - now))
    state = _both(now, branch)
    return state, state[None, 1:]


def _times_inputs(
    moment: Moment, lead: Float[AnyArray, "1 columns"]
) -> Float[AnyArray, "channels columns"]:
    return inputs_at(moment.triad, moment.input)[:, None] * lead


EFFECT = Effect(
    name="thermal_hysteresis",
    title="thermal hysteresis",
    equation=(
        "h L(T, branch); L of the play operator, -1 after warming and 1 after cooling, or s (1 - ((T - T_m)/A)^2)"
    ),
    units={"accel": "m/s^2", "gyro": "rad/s"},
    prior={
        "accel": by_grade((10, 60), (50, 1000), (300, 5000), unit=MICRO_G),
        "gyro": by_grade((0.005, 0.1), (1, 20), (5, 100), unit=DEG_PER_HOUR),
    },
    shape=shape,
    unit_of_form=by_what_it_acts_on,
    in_numpy=True,
    variants=variants,
    needs="heating and cooling branches with soaks on both",
    driver="temperature_branch",
    sentence=(
        "The output of {channels} depends on whether the temperature was reached from below or from above, "
        "and keeps the difference in a soak."
    ),
    separating="soaks at the same temperature on both branches, two cycles, two amplitudes",
    requires=("temperature",),
    online=Online(_begin, _follow),
    seen_in_means=True,
    branched=True,
)
