"""Two components of one effect on the same channels: both are told, or one stands.

A form on a grid of settings leaves a remainder, and a second form of the same effect takes it up: two exponentials near
each other stand for one between them, with coefficients that nearly cancel. Each was rare beside the other at fixed
settings. What counts is its size with the uncertainty of its own setting, beside the other.
"""

from collections.abc import Sequence
from dataclasses import replace

import scipy.special

from ..candidates.signatures import Term
from ..noise.observation_series import NoiseFit
from ..noise.reml import fit_noise, interval_noise
from ..problem import Prepared
from ..selection.evidence import Candidate
from ..selection.forward import STILL
from ..selection.score_test import whiten_system
from ..selection.verdict import Answer, Named
from .parameters import parameters
from .separable import refined


def one_of_like_components(prepared: Prepared, answer: Answer) -> Answer:
    """The answer without components beside a like one that are not told, the weaker first; what stays is refined."""
    if answer.verdict != "missing-physics":
        return answer
    while (weaker := _untold(prepared, answer)) is not None:
        left = [n for k, n in enumerate(answer.named) if k != weaker]
        key = answer.named[weaker].candidate.key
        noise = fit_noise(prepared.system, [n.candidate.term for n in left], answer.noise)
        left = [
            _refined_alone(prepared, noise, n, left) if n.candidate.key == key else n for n in left
        ]
        noise = fit_noise(prepared.system, [n.candidate.term for n in left], noise)
        answer = replace(answer, named=tuple(left), noise=noise)
    return answer


def _untold(prepared: Prepared, answer: Answer) -> int | None:
    """The weaker one of two like components of which either is no more than noise makes; `None` without such."""
    keys = [n.candidate.key for n in answer.named]
    alike = [k for k, key in enumerate(keys) if keys.count(key) > 1]
    if not alike:
        return None
    first = [n.candidate.term for n in answer.named]
    stated = interval_noise(prepared.system, answer.noise, first)
    about, terms, spread = refined(prepared, stated, first)
    asked = {keys[k] for k in alike if not _is_told(about, stated, terms, k, spread[k])}
    among = [k for k in alike if keys[k] in asked]
    return min(among, key=lambda k: answer.named[k].candidate.evidence, default=None)


def _is_told(
    prepared: Prepared, noise: NoiseFit, terms: Sequence[Term], k: int, spread: float | None
) -> bool:
    """Whether a component beside all others has a size that is rarer by noise than what is dropped at the end."""
    effect = terms[k].known
    if effect.nuisance not in ("", "time") and spread is None:
        return False  # any setting does as well; a moment that is sharp between two rows has no spread, too
    others = [*terms[:k], *terms[k + 1 :]]
    sizes = [
        p for n, p in parameters(prepared, noise, terms[k], others, spread) if n != effect.nuisance
    ]
    chances = [scipy.special.chdtrc(1, (p.value / p.std) ** 2) for p in sizes if p.std]
    return bool(chances) and min(chances) * len(sizes) < STILL


def _refined_alone(
    prepared: Prepared, noise: NoiseFit, named: Named, all_named: Sequence[Named]
) -> Named:
    """The name with its setting sought anew, without the component beside which it was found."""
    others = [n.candidate.term for n in all_named if n is not named]
    _, terms, _ = refined(prepared, noise, [named.candidate.term, *others])
    scores = whiten_system(prepared.system, noise, terms[:1], others).scores
    if not scores:
        return named
    known = named.candidate
    return replace(named, candidate=Candidate(terms[0], scores[0], known.ratio, known.evidence))
