"""What is said of each named effect: size, odds, gain on data left out, and the sentence."""

from collections.abc import Sequence

import numpy as np

from ...effects import Effect
from ..candidates.signatures import Term
from ..estimates.cross_validation import held_out_rms
from ..estimates.parameters import parameters
from ..noise.observation_series import NoiseFit
from ..problem import Prepared
from ..problem_of_motions import PARTED_BY
from ..result import Evidence, Explanation, Parameter
from ..selection.evidence import Candidate
from ..selection.verdict import Answer, Named
from .sentences import sentence


def explain(
    prepared: Prepared,
    answer: Answer,
    tuned: Sequence[tuple[Named, Term, float | None]],
    stated: NoiseFit,
) -> list[Explanation]:
    """One entry for each named effect of a triad; `tuned` holds each with its refined term and the setting's
    standard deviation, and `stated` is the noise that standard deviations are stated with."""
    made = []
    terms = [t for _, t, _ in tuned]
    for k, (named, term, std) in enumerate(tuned):
        others = terms[:k] + terms[k + 1 :]
        candidate, effect = named.candidate, term.known
        members = (term.name, *(r.term.name for r in named.rivals))
        odds = tuple((n, float(w)) for n, w in zip(members, named.odds))
        rows = prepared.system.num_rows / len(prepared.system.chains) * len(term.chains)
        bic = delta_bic(candidate.ratio, candidate.score.size, effect, rows)
        values = parameters(prepared, stated, term, others, std)
        said = sentence(effect, term.variant.settings, term.channel_names, values, odds)
        made.append(
            Explanation(
                name=term.name,
                channels=term.channel_names,
                form=term.variant.label,
                alternatives=tuple(r.term.name for r in named.rivals),
                odds=odds,
                parameters=values,
                evidence=Evidence(bic, named.p_value, gain_of_channels(prepared, terms, term.name)),
                statement=f"{said} It shows in the motions between rests."
                if prepared.motions
                else said,
                separating_experiment=(
                    PARTED_BY if prepared.motions else experiment(effect, alone=not named.rivals)
                ),
            )
        )
    return _merge(made)


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


def _merge(explanations: list[Explanation]) -> list[Explanation]:
    """One entry for an effect found on several channels in one form."""
    groups: dict[str, list[Explanation]] = {}
    for e in explanations:
        groups.setdefault(e.name, []).append(e)
    made = []
    for members in groups.values():
        lead = max(members, key=lambda e: e.evidence.delta_bic)
        if len(members) == 1:
            made.append(lead)
            continue
        channels = tuple(dict.fromkeys(c for e in members for c in e.channels))
        values: dict[str, Parameter] = {}
        for e in members:
            for name, value in e.parameters:
                label = f"{name} ({', '.join(e.channels)})"
                again = sum(key.startswith(label) for key in values)
                values[label if not again else f"{label}, {again + 1}"] = value
        made.append(
            Explanation(
                name=lead.name,
                channels=channels,
                form=lead.form,
                alternatives=lead.alternatives,
                odds=lead.odds,
                parameters=tuple(values.items()),
                evidence=lead.evidence,
                statement=" ".join(e.statement for e in members),
                separating_experiment=lead.separating_experiment,
            )
        )
    return made


def formula(candidate: Candidate) -> str:
    """The best-found dependence with its coefficients, in SI units."""
    numbers = " , ".join(
        f"{v:.3g} ± {s:.1g}"
        for v, s in zip(
            candidate.score.coefficients[:3], np.sqrt(np.diag(candidate.score.covariance))
        )
    )
    unit = "m/s^2" if candidate.term.triad == "accel" else "rad/s"
    return f"{', '.join(candidate.term.channel_names)} += ({numbers}) {unit} · {candidate.term.variant.label}"
