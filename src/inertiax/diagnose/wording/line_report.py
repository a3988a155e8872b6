"""What a diagnosis says of lines in the samples of rests: those that move means, and those that do not."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...calibration.effect_units import customary
from ...calibration.fitted_effects import FittedEffect
from ...effects.interference import EFFECT
from ..observations.blocks import Log
from ..observations.model_rows import ModelForm
from ..observations.rest_lines import Line, Sought
from ..plan.limits import Audit, Detectable
from ..result import Evidence, Explanation, Parameter, Where
from .sentences import Said, sentence


NAME = EFFECT.name
SHOWS = " It shows in the samples within rests and moves their means."


def with_lines(audit: Audit, sought: Sequence[Sought]) -> Audit:
    """The audit with the lines that the rests' samples would have shown wherever they are in the band."""
    sizes = tuple(
        Detectable(NAME, (f"{one.triad}_{'xyz'[c]}",), size, EFFECT.units[one.triad], one.band)
        for one in sought
        for c, size in enumerate(one.sizes)
        if np.isfinite(size)
    )
    lacking = tuple(pair for pair in audit.not_testable if pair[0] != NAME or not sizes)
    return replace(audit, not_testable=lacking, detectable=(*audit.detectable, *sizes))


def explain_lines(lines: Sequence[Line], first: float) -> Explanation:
    """The entry of the diagnosis for the lines of a triad; `first` is the recordings' clock at its first row, s."""
    lines = sorted(lines, key=lambda x: -x.ratio)
    best = lines[0]
    odds = ((NAME, 1.0),)
    said = [Said((x.name,), _sizes(x), odds, first) for x in lines]
    text = sentence(EFFECT, {}, said) + SHOWS
    # Frequency, sine and cosine.
    bic = best.ratio - 3.0 * np.log(best.rows)
    return Explanation(
        name=NAME,
        channels=tuple(dict.fromkeys(x.name for x in lines)),
        form=f"frequency={best.frequency:.4g}",
        alternatives=(),
        odds=odds,
        parameters=tuple((_told(name, x, lines), p) for x in lines for name, p in _numbers(x)),
        evidence=Evidence(float(bic), float(best.p_value), float(best.gain)),
        statement=text,
        separating_experiment=EFFECT.separating,
    )


def _sizes(line: Line) -> tuple[tuple[str, Parameter], ...]:
    """What says all of a line but its phase."""
    unit = EFFECT.units[line.triad]
    return (
        ("frequency", Parameter(line.frequency, line.frequency_std, EFFECT.nuisance_unit)),
        ("peak", Parameter(line.amplitude, line.amplitude_std, unit)),
    )


def _numbers(line: Line) -> tuple[tuple[str, Parameter], ...]:
    unit, std = EFFECT.units[line.triad], np.sqrt(np.diag(line.covariance))
    both = zip(line.value, std, strict=True)
    parts = (
        (f"coefficient[{k}]", Parameter(float(v), float(s), unit)) for k, (v, s) in enumerate(both)
    )
    return (*_sizes(line), *parts)


def _told(name: str, line: Line, lines: Sequence[Line]) -> str:
    """A number's name, with what tells its line from the others."""
    if len(lines) == 1:
        return name
    twice = sum(x.name == line.name for x in lines) > 1
    return (
        f"{name} frequency={line.frequency:.4g} ({line.name})" if twice else f"{name} ({line.name})"
    )


def line_places(lines: Sequence[Line], log: Log) -> list[Where]:
    """Each experiment as a whole, channel by channel: a line does not begin or end."""
    made = []
    for line in lines:
        for number in np.unique(log.experiment):
            clock = log.clock[log.experiment == number]
            made.append(
                Where(
                    line.name, int(number), float(clock[0]), float(clock[-1]), EFFECT.driver,
                    float(line.amplitude / np.sqrt(2.0)), line.p_value,
                )
            )  # fmt: skip
    return made


def stored_lines(lines: Sequence[Line], log: Log, form: ModelForm) -> tuple[FittedEffect, ...]:
    """The lines as `calibration.json` keeps them."""
    temperature = None
    if log.temperature is not None:
        temperature = (float(log.temperature.min()), float(log.temperature.max()))
    one_clock = bool(np.all(np.diff(log.clock) > 0))
    clock = (float(log.clock[0]), float(log.clock[-1])) if one_clock else None
    return tuple(
        FittedEffect(
            NAME, line.triad, (line.channel,), (("frequency", line.frequency),), line.value, line.covariance,
            EFFECT.units[line.triad], clock, temperature, 0.0, form.degree, (form.low, form.high),
        )
        for line in lines
    )  # fmt: skip


def untouched_sentences(sought: Sought | None) -> list[str]:
    """A note on each line that moves no mean of a rest."""
    made = []
    for line in () if sought is None else sought.lines:
        factor, unit = customary(line.amplitude, EFFECT.units[line.triad])
        made.append(
            f"{line.name}: a line of {line.frequency:.4g} Hz (as sampled) and {factor * line.amplitude:.3g} {unit} "
            "peak in the samples of rests; it averages out and moves no parameter by its standard deviation."
        )
    return made
