"""What a diagnosis says of a delay that the ramps between plateaus show."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy.special

from ...calibration.fitted_effects import FittedEffect
from ...effects.time_delay import EFFECT
from ..observations.blocks import Log
from ..observations.delay_ramps import Delay, LEVEL
from ..observations.model_rows import ModelForm
from ..plan.limits import Audit, Detectable, POWER
from ..result import Evidence, Explanation, Parameter, Where
from .sentences import Said, sentence


NAME = EFFECT.name


def with_delays(audit: Audit, delays: Sequence[Delay]) -> Audit:
    """The audit with the delays that the ramps would have shown with a chance of 0.9."""
    sizes: list[Detectable] = []
    for delay in delays:
        least = scipy.special.ndtri(POWER) - scipy.special.stdtrit(delay.freedom, LEVEL / 6.0)
        for c, size in enumerate(least * np.asarray(delay.std)):
            if np.isfinite(size):
                sizes.append(Detectable(NAME, (f"{delay.triad}_{'xyz'[c]}",), float(size), "s"))
    if not sizes:
        return audit
    lacking = tuple(pair for pair in audit.not_testable if pair[0] != NAME)
    others = tuple(d for d in audit.detectable if d.name != NAME)
    return replace(audit, not_testable=lacking, detectable=(*others, *sizes))


def explain_delay(delay: Delay) -> Explanation:
    """The entry of the diagnosis."""
    names = tuple(f"{delay.triad}_{'xyz'[c]}" for c in delay.found)
    values = tuple(
        (
            "delay" if len(names) == 1 else f"delay ({n})",
            Parameter(float(delay.value[c]), float(delay.std[c]), "s"),
        )
        for n, c in zip(names, delay.found)
    )
    best = min(delay.found, key=lambda c: float(delay.p_value[c]))
    freedom = float(delay.freedom[best])
    t = float(delay.value[best] / delay.std[best])
    bic = (freedom + 1.0) * np.log1p(t**2 / freedom) - np.log(freedom + 1.0)
    p_value, gain = float(delay.p_value[best]), float(delay.gain[best])
    odds = ((NAME, 1.0),)
    said = sentence(EFFECT, {}, [Said(names, values, odds)])
    said += " It shows in the ramps between plateaus."
    return Explanation(
        NAME, names, "", (), odds, values, Evidence(float(bic), p_value, gain), said,
        EFFECT.separating,
    )  # fmt: skip


def ramp_places(delay: Delay, log: Log) -> list[Where]:
    """The ramps of each experiment, channel by channel."""
    made = []
    for c in delay.found:
        for number in np.unique(log.experiment):
            mine = [r for r in delay.ramps if log.experiment[r.start] == number]
            if mine:
                start, end = log.clock[mine[0].start], log.clock[mine[-1].stop - 1]
                made.append(
                    Where(
                        f"{delay.triad}_{'xyz'[c]}", int(number), float(start), float(end),
                        "rate_of_change", float(delay.size[c]), float(delay.p_value[c]),
                    )
                )  # fmt: skip
    return made


def stored(delay: Delay, log: Log, form: ModelForm) -> tuple[FittedEffect, ...]:
    """The delays as `calibration.json` keeps them, channel by channel."""
    given = getattr(log, f"reference_{delay.triad}")
    scale = form.gravity if delay.triad == "accel" else 1.0
    temperature = None
    if log.temperature is not None:
        temperature = (float(log.temperature.min()), float(log.temperature.max()))
    return tuple(
        FittedEffect(
            NAME, delay.triad, (c,), (), np.array([delay.value[c]]),
            np.array([[delay.std[c] ** 2]]), "s", None, temperature,
            float(np.abs(given).max() / scale), form.degree, (form.low, form.high),
        )
        for c in delay.found
    )  # fmt: skip
