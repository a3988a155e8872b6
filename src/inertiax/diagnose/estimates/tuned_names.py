"""Named effects with their settings refined under the noise of their intervals."""

from dataclasses import replace

from ..candidates.signatures import Term
from ..noise.observation_series import NoiseFit
from ..problem import Prepared
from ..selection.evidence import Candidate
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
            named = replace(named, candidate=candidate, near=())
        made.append((named, term, std))
    return about, made
