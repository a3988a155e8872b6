"""What is said of each named effect: size, odds, gain on data left out, and the sentence."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ...effects import Effect
from ...effects.form_units import acts_on
from ...effects.over_temperature import said_of_coefficients
from ..candidates.empirical import LEAST_SPAN
from ..candidates.signatures import Term
from ..estimates.cross_validation import held_out_rms
from ..estimates.parameters import parameters
from ..noise.observation_series import NoiseFit
from ..problem import Prepared
from ..problem_of_motions import PARTED_BY
from ..result import Evidence, Explanation, Parameter
from ..selection.evidence import Candidate
from ..selection.verdict import Answer, Named
from .earth_beside import earth_beside, NAME as EARTH_RATE, PARTED_BY as EARTH_PARTED_BY
from .sentences import Said, sentence
from .untold_channels import channel_odds, PARTED_BY as CHANNELS_PARTED_BY
from .untold_earth import earth_explains, SAID


IN_SHORT = 3  # numbers that a summary says of an effect; more are in the list of its parameters
NEAR = 0.02  # of a log's span of temperature, by which a probe may go back and forth (convention)


def explain(
    prepared: Prepared,
    answer: Answer,
    tuned: Sequence[tuple[Named, Term, float | None]],
    stated: NoiseFit,
) -> list[Explanation]:
    """One entry for each named effect of a triad; `tuned` holds each with its refined term and the setting's
    standard deviation, and `stated` is the noise that standard deviations are stated with."""
    made: dict[str, list[_Entry]] = {}
    terms = [t for _, t, _ in tuned]
    for k, (named, term, std) in enumerate(tuned):
        others = terms[:k] + terms[k + 1 :]
        candidate, effect = named.candidate, term.known
        members = (term.name, *(r.term.name for r in named.rivals))
        odds = tuple((n, float(w)) for n, w in zip(members, named.odds))
        rows = prepared.system.num_rows / len(prepared.system.chains) * len(term.chains)
        bic = delta_bic(candidate.ratio, candidate.score.size, effect, rows)
        values = parameters(prepared, stated, term, others, std)
        gain = gain_of_channels(prepared, terms, term.name)
        entry = _Entry(
            term,
            Said(
                term.channel_names,
                values,
                odds,
                float(prepared.clock[0]),
                on_channels=channel_odds(named, term),
            ),
            Evidence(bic, named.p_value, gain),
            tuple(r.term.name for r in named.rivals),
        )
        made.setdefault(term.name, []).append(entry)
    return [_together(prepared, entries) for entries in made.values()]


class _Entry(NamedTuple):
    """One named term with what is said of it."""

    term: Term
    said: Said
    evidence: Evidence
    rivals: tuple[str, ...]


def _together(prepared: Prepared, entries: list[_Entry]) -> Explanation:
    """One entry for an effect on all its channels; the evidence and the alternatives are those of the clearest."""
    entries = [_told_apart(e, entries) for e in entries]
    lead = max(entries, key=lambda e: e.evidence.delta_bic)
    effect = lead.term.known
    where = " It shows in the motions between rests." if prepared.motions else ""
    where += _passed_once(prepared, lead.term) if effect.jump else ""
    of_the_station = effect.common and "rad" in effect.units.values()  # angles
    where += share_of_axes(prepared.axes) if of_the_station else ""
    values, taken = _parameters(entries), ""
    if not prepared.motions:
        taken = earth_beside(prepared.log, [(e.term, e.said.values) for e in entries])
    earth = taken
    if not earth and EARTH_RATE not in lead.rivals:
        earth = SAID * earth_explains(prepared, lead.term.name, dict(values))
    where += earth
    alternatives = (*lead.rivals, *[EARTH_RATE] * (earth != "" and EARTH_RATE not in lead.rivals))
    alone = not lead.rivals  # no run parts what a driver did to the outputs
    untold = tuple(next((e.said.on_channels for e in entries if e.said.on_channels), ()))
    return Explanation(
        name=lead.term.name,
        channels=tuple(dict.fromkeys(c for e in entries for c in e.said.channels)),
        form=lead.term.variant.label,
        alternatives=alternatives,
        odds=tuple(lead.said.odds),
        parameters=values,
        evidence=lead.evidence,
        statement=_sentences(effect, entries, math.inf) + where,
        separating_experiment=(CHANNELS_PARTED_BY if untold else "")
        + (EARTH_PARTED_BY if taken else "")
        + (PARTED_BY if prepared.motions else experiment(effect, alone=alone)),
        in_short=_sentences(effect, entries, IN_SHORT) + where,
        channel_odds=untold,
    )


def _told_apart(entry: _Entry, entries: list[_Entry]) -> _Entry:
    """The entry with its form in the names of its numbers, where another form acts on the same channels."""
    forms = {e.term.variant.label for e in entries if e.term.channels == entry.term.channels}
    if len(forms) == 1:
        return entry
    form = entry.term.variant.label
    values = tuple((f"{name} {form}", value) for name, value in entry.said.values)
    return entry._replace(said=entry.said._replace(values=values, form=form))


def _passed_once(prepared: Prepared, jump: Term) -> str:
    """That a temperature is as likely a cause of a jump as a moment, where it was passed then and never again."""
    signal = prepared.coarse
    if signal.temperature is None:
        return ""
    time, temperature = np.asarray(signal.time), np.asarray(signal.temperature)
    moment, span = float(jump.variant.settings["time"]), float(np.ptp(temperature))
    before, after = temperature[time < moment], temperature[time >= moment]
    if span < LEAST_SPAN or not len(before) or not len(after):
        return ""
    at, near = float(np.interp(moment, time, temperature)), NEAR * span
    rises = before.max() < at + near and after.min() > at - near
    falls = before.min() > at - near and after.max() < at + near
    if not rises and not falls:
        return ""
    return (
        f" The temperature passed {at:.1f} °C then and at no other time, so that a step at that temperature explains "
        "it as well; a run that passes it again tells."
    )


def _sentences(effect: Effect, entries: list[_Entry], most: float | int) -> str:
    """A sentence for each thing that the effect acts on."""
    groups: dict[tuple[str | None, str], list[_Entry]] = {}
    for e in entries:
        settings = e.term.variant.settings
        groups.setdefault((acts_on(settings), said_of_coefficients(settings)), []).append(e)
    return " ".join(
        sentence(
            effect,
            g[0].term.variant.settings,
            [e.said for e in g],
            most=most,
            moments=len({e.term.variant.settings.get("time") for e in g}),
        )
        for g in groups.values()
    )


def _parameters(entries: list[_Entry]) -> tuple[tuple[str, Parameter], ...]:
    """All numbers by name, with the channels where there are several entries."""
    if len(entries) == 1:
        return tuple(entries[0].said.values)
    values: dict[str, Parameter] = {}
    for e in entries:
        for name, value in e.said.values:
            label = f"{name} ({', '.join(e.said.channels)})"
            again = sum(key.startswith(label) for key in values)
            values[label if not again else f"{label}, {again + 1}"] = value
    return tuple(values.items())


def share_of_axes(axes: tuple[float, float] | None) -> str:
    """What the axes of a table are taken to err by, rad, and where more is stated; "" where none stands.

    An axis that stands turns all rests of its standing alike, as errors of the station turn all rests.
    """
    if axes is None or not any(axes):
        return ""
    outer, inner = np.rad2deg(axes) * 3600.0
    return (
        f" The table's outer axis is taken to err by {outer:.3g} arcsec and the inner one by {inner:.3g}; where one "
        "errs by more, state [rig] axis_uncertainty = [outer, inner] and diagnose again."
    )


def gain_of_channels(prepared: Prepared, terms: Sequence[Term], name: str) -> float:
    """1 - rms with the terms of a name / rms without them, on data left out, of the chains that they touch.

    Beside chains whose rms they leave as it is they would seem to do less.
    """
    others = [t for t in terms if t.name != name]
    chains = sorted({c for t in terms if t.name == name for c in t.chains})
    return 1.0 - held_out_rms(prepared, terms, chains) / held_out_rms(prepared, others, chains)


def experiment(effect: Effect, *, alone: bool) -> str:
    """What would tell more: of a lone effect what confirms it, of a set also the command that plans the run."""
    if alone:
        return effect.separating
    return (
        f"{effect.separating}; `inertiax design --separate` with this diagnosis gives the run that parts these names "
        "in the least time, its checklist and the odds to expect"
    )


def delta_bic(ratio: float, size: int, effect: Effect, rows: float) -> float:
    """Drop of the Bayesian information criterion by an effect: $\\Lambda - p \\ln n$.

    **Arguments:** `ratio` is the likelihood ratio $\\Lambda$, `size` the number of coefficients and `rows` n. A setting
    that is fitted, such as the moment of a jump, is one more parameter in p, unless it stands for the coefficient.
    """
    fitted = size + (effect.nuisance != "" and not effect.unit_amplitude)
    return float(ratio - fitted * np.log(rows))


def formula(candidate: Candidate) -> str:
    """The best-found dependence in SI units: its coefficients, or of more than three the first and the rms of all."""
    term, values = candidate.term, candidate.score.coefficients
    sigmas = np.sqrt(np.diag(candidate.score.covariance))
    # What the rows do not tell beside the others, as a wave's second part in one pose, is zero without a sigma.
    told = np.flatnonzero(sigmas > 0.0) if np.any(sigmas > 0.0) else np.arange(len(values))
    numbers = " , ".join(f"{values[k]:.3g} ± {sigmas[k]:.1g}" for k in told[:3])
    unit = "m/s^2" if term.triad == "accel" else "rad/s"
    more = rms = ""
    if len(told) > 3:
        course = np.concatenate([x @ values for x in term.columns])
        more, rms = " , …", f", {np.sqrt(np.mean(course**2)):.2g} {unit} rms"
    return (
        f"{', '.join(term.channel_names)} += ({numbers}{more}) {unit} · {term.variant.label}{rms}"
    )
