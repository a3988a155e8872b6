"""Named effects with their settings refined, and without those that a refined one has taken the place of."""

from collections.abc import Sequence
from dataclasses import replace

from ..candidates.signatures import Term
from ..noise.observation_series import NoiseFit
from ..noise.reml import fit_noise, interval_noise
from ..problem import Prepared
from ..selection.evidence import Candidate
from ..selection.forward import STILL
from ..selection.score_test import whiten_system
from ..selection.verdict import Answer, Named
from .separable import refined


def tuned(
    prepared: Prepared, answer: Answer, noise: NoiseFit
) -> tuple[Prepared, list[tuple[Named, Term, float | None]]]:
    """Named terms with their nuisance settings refined under the noise of the intervals, and the triad about them."""
    about, terms, spread = refined(prepared, noise, [n.candidate.term for n in answer.named])
    made = []
    for k, (named, term, std) in enumerate(zip(answer.named, terms, spread)):
        others = terms[:k] + terms[k + 1 :]
        found = whiten_system(about.system, answer.noise, [term], others).scores
        if found:
            candidate = Candidate(term, found[0], named.candidate.ratio, named.candidate.evidence)
            named = Named(candidate, named.p_value, named.rivals)
        made.append((named, term, std))
    return about, made


def without_faint_twins(prepared: Prepared, answer: Answer) -> Answer:
    """The answer without a second form of an effect on a channel that is not rare beside the first one's own setting.

    Settings are chosen on a grid. What the nearest point leaves of a strong line is another line beside it, until the
    frequency is that of the data.
    """
    while True:
        pairs = _twins(answer.named)
        if not pairs or answer.verdict != "missing-physics":
            return answer
        noise = interval_noise(prepared.system, answer.noise, _terms(answer.named))
        about, names, _ = _tuned_names(prepared, answer, noise)
        # Settings are those beside all; each twin is asked under the noise that there is without it.
        rare = {k: _rare(about, answer, names, k) for pair in pairs for k in pair}
        faint = [k for pair in pairs for k in pair if not rare[k]]
        if not faint:
            return answer
        least = min(faint, key=lambda k: names[k].candidate.score.gain)
        kept = tuple(n for k, n in enumerate(answer.named) if k != least)
        beside = fit_noise(prepared.system, _terms(kept))
        answer = replace(answer, named=kept, noise=beside)


def _terms(named: Sequence[Named]) -> list[Term]:
    return [n.candidate.term for n in named]


def _twins(named: Sequence[Named]) -> list[tuple[int, int]]:
    """Pairs of names of one effect on the same channels, whose settings are sought."""
    terms = _terms(named)
    return [
        (j, k)
        for k, term in enumerate(terms)
        for j in range(k)
        if (terms[j].name, terms[j].channels) == (term.name, term.channels) and term.known.nuisance
    ]


def _tuned_names(
    prepared: Prepared, answer: Answer, noise: NoiseFit
) -> tuple[Prepared, list[Named], list[Term]]:
    about, made = tuned(prepared, answer, noise)
    return about, [n for n, _, _ in made], [t for _, t, _ in made]


def _rare(about: Prepared, answer: Answer, names: Sequence[Named], mine: int) -> bool:
    """Whether a name with its refined setting is no chance beside the others."""
    terms = _terms(names)
    others = terms[:mine] + terms[mine + 1 :]
    noise = fit_noise(about.system, others)
    found = whiten_system(about.system, noise, [terms[mine]], others).scores
    if not found:
        return False
    again = Candidate(terms[mine], found[0], found[0].gain, names[mine].candidate.evidence)
    return answer.tests.p_value(again) < STILL
