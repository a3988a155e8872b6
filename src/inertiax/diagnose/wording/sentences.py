"""A diagnosis in words that a test engineer understands."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ...calibration.effect_units import shown_parameter
from ...effects import Effect
from ...effects.form_units import acts_on, Settings
from ...effects.over_temperature import said_of_coefficients
from ..observations.blocks import Blocks
from ..observations.model_rows import ModelForm
from ..result import Explanation, Parameter, Where
from .untold_channels import channels_said


# Odds that are "not worth more than a bare mention": R. E. Kass, A. E. Raftery, Bayes factors, J. Am. Stat. Assoc. 90
# (1995).
_AS_LIKELY = 3.0


def _number(effect: Effect, name: str, parameter: Parameter, first: float) -> str:
    if parameter.std is None and parameter.value == 0.0:
        return "not determined by this data"
    value, std, unit = shown_parameter(effect.name, name, parameter, first)
    if parameter.std is None:
        return f"about {value} {unit} (not determined by this data)"
    return f"{value} ± {std} {unit}"


class Said(NamedTuple):
    """What is told of an effect on some channels in one form."""

    channels: tuple[str, ...]
    values: Sequence[tuple[str, Parameter]]
    odds: Sequence[tuple[str, float]]  # of this name and of those that the data do not exclude
    first: float = 0.0  # s, the recordings' clock at its first row
    form: str = ""  # where another form acts on the same channels
    # Of the channels that may have it, where the data do not tell which one has.
    on_channels: Sequence[tuple[str, float]] = ()


def sentence(
    effect: Effect,
    settings: Settings,
    members: Sequence[Said],
    *,
    most: float | int = math.inf,
    moments: int = 1,
) -> str:
    """What the effect is, on what it acts, how large, and which rivals remain.

    **Arguments:** `members` are all channels that have it in a form with these `settings`; of more than `most` numbers
    none is said. `moments` is how many there are of an effect that has one.
    """
    channels = list(dict.fromkeys(c for m in members for c in m.channels))
    on = acts_on(settings)
    acts = "" if on is None else f" It acts on {on}."
    text = effect.sentence.format(channels=", ".join(channels))
    if moments > 1:
        text = text.replace("at one moment", f"at {moments} moments")
    equal = _as_likely(members)
    if equal:
        text = (
            f"{', '.join(equal[:-1])} and {equal[-1]} explain {', '.join(channels)} about equally well. By the first "
            f"of them: {text[0].lower()}{text[1:]}"
        )
    text += f"{acts}{said_of_coefficients(settings)} Model: {effect.equation}"
    apart = len(members) > 1
    if sum(len(m.values) for m in members) <= most:
        sizes = []
        for m in members:
            numbers = ", ".join(
                f"{name} {_number(effect, name, value, m.first)}" for name, value in m.values
            )
            sizes.append(f"{', '.join(m.channels)}: {numbers}" if apart else numbers)
        text += "; " + "; ".join(sizes)
    text += "."
    for m in members:
        if len(m.odds) > 1:
            shares = ", ".join(f"{name} {100 * share:.0f} %" for name, share in m.odds)
            part = f" (form {m.form})" if m.form else ""
            where = f"On {', '.join(m.channels)}{part} this" if apart else "This"
            text += f" {where} data cannot decide between: {shares}."
    for m in members:
        text += channels_said(m.on_channels)
    return text


def _as_likely(members: Sequence[Said]) -> list[str]:
    """The names that are as likely as the first one, that included; none where some channel tells it apart."""
    found: list[str] = []
    for m in members:
        most = max((share for _, share in m.odds), default=0.0)
        names = [name for name, share in m.odds if _AS_LIKELY * share >= most]
        if len(names) < 2 or names[0] != m.odds[0][0]:
            return []
        found += names
    return list(dict.fromkeys(found))


def gain_on_left_out(gain: float, what: str) -> str:
    """What an effect does to the rms of data left out: `gain` is 1 − rms with it / rms without."""
    percent = round(100.0 * gain)
    if percent == 0:
        return f"leaves {what} as it is within half a percent"
    return f"{'lowers' if percent > 0 else 'raises'} {what} by {abs(percent)} %"


def _channels(found: Explanation | Where) -> tuple[str, ...]:
    return found.channels if isinstance(found, Explanation) else (found.channel,)


def _models(forms: Sequence[ModelForm]) -> str:
    return " and ".join(
        f"the {f.estimator} model of the {'accelerometers' if f.triad == 'accel' else 'gyros'}"
        + (f" (degree {f.degree} in temperature)" if f.degree else "")
        for f in forms
    )


def untested_sentence(triads: Sequence[tuple[ModelForm, Blocks]]) -> str | None:
    """Of accelerometers by |a|, that no more rests are there than parameters, in a sentence; `None` where more are."""
    for form, blocks in triads:
        rests = len(np.unique(blocks.dwell[~blocks.moving]))
        if form.by_magnitude and form.degree == 0 and rests <= len(form.names):
            return (
                f"The accelerometers' {rests} rests tell {len(form.names)} parameters and leave none to test them by: "
                "what is constant in a rest is in the parameters."
            )
    return None


def agreement(forms: Sequence[ModelForm]) -> str:
    """That nothing stands out beside these models."""
    return (
        f"The recordings agree with {_models(forms)} within noise, the dwells' scatter and the rig's stated "
        "uncertainty; no catalogued effect and no structured remainder stands out. The list of detectable "
        "sizes says from which size on an effect would have been found nine times of ten, on the channel that "
        "shows it best."
    )


def summary(
    verdict: str,
    explanations: Sequence[Explanation],
    where: Sequence[Where],
    empirical: Sequence[str],
    forms: Sequence[ModelForm],
) -> str:
    """One paragraph."""
    pulled = {c.strip("|").partition("_")[0] for x in (*explanations, *where) for c in _channels(x)}
    apart = [f for f in forms if f.triad in pulled]
    models = _models(apart if verdict != "consistent" and apart else forms)
    if verdict == "consistent":
        return agreement(forms)
    if verdict == "missing-physics":
        parts = " ".join(e.in_short or e.statement for e in explanations)
        proof = "; ".join(
            f"{e.name} {gain_on_left_out(e.evidence.held_out_gain, 'the rms of ' + ', '.join(e.channels))}"
            for e in explanations
        )
        return f"The recordings do not agree with {models}. {parts} On data left out of the fit, {proof}."
    channels = ", ".join(sorted({w.channel for w in where}))
    return (
        f"The recordings do not agree with {models}: something acts on {channels} that no catalogued effect "
        f"explains. The best-found dependence is {'; '.join(empirical)}. It describes the data and "
        "is not the name of a cause."
    )
