"""What a flexible dependence still finds beside the named effects."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.special
from jaxtyping import Int

from ..candidates.repeated_inputs import NAME as LEVELS
from ..candidates.signatures import Term
from ..candidates.smooth import on_input
from ..noise.observation_series import NoiseFit, System
from .evidence import bank, Candidate, judge, refine


LEFT = 1e-4  # chance below which a flexible dependence beside the named effects counts
UNSEEN = 1e-6  # the same where nothing was named
WITHIN = (
    0.01  # of a term's squares that lie within dwells, up to which they alone tell it (convention)
)
SHARE = 0.25  # of what they explain, so that an effect's inexact form does not count


@dataclass(frozen=True, eq=False)
class LeftOver:
    """The flexible dependence that still finds something beside the named effects."""

    candidate: Candidate
    p_value: float


def left_over(
    system: System,
    chosen: Sequence[Candidate],
    noise: NoiseFit,
    flexible: Sequence[Term],
    *,
    grade: str | None,
    say: Callable[[str], None] = lambda text: None,
) -> LeftOver | None:
    """What the named effects leave for the flexible dependences, if it counts beside what they explain.

    On channels where nothing was named, dependences on the inputs alone, a smooth course in time being what slow noise
    is; beside names on other channels only a level of each input.

    **Arguments:** `noise` is the fit beside the chosen effects, or that of the null where there are none.
    """
    terms = [c.term for c in chosen]
    chains = {c for t in terms for c in t.chains}
    anywhere = lambda t: t.name == LEVELS or (not terms and on_input(t))
    asked = [t for t in flexible if chains.issuperset(t.chains) or anywhere(t)]
    if not asked:
        return None
    start = bank(system, [noise], terms)
    rareness = lambda c: _rareness(system, terms, c)
    levels = [t for t in asked if t.name == LEVELS]
    ranked = judge(system, start, [t for t in asked if t.name != LEVELS], terms, {}, grade)
    ranked.sort(key=rareness)
    if not terms and (not ranked or rareness(ranked[0]) > np.log(UNSEEN)):
        ranked = []  # nothing smooth
    if ranked:
        fuller = refine(system, start, ranked[:6], terms, most=3)
        ranked = judge(system, fuller, [c.term for c in ranked[:6]], terms, {}, grade)
    if levels:
        # Of up to half as many coefficients as dwells: under a noise that was fitted without them none is rare.
        beside = judge(system, start, levels, terms, {}, grade)
        ranked += judge(system, refine(system, start, beside, terms), levels, terms, {}, grade)
    if not ranked:
        return None
    worst = min(ranked, key=rareness)
    p = float(np.exp(min(rareness(worst) + np.log(len(asked)), 0.0)))
    mine = sum(c.ratio for c in chosen if set(c.term.chains) & set(worst.term.chains))
    share = (worst.ratio - worst.score.size) / max(mine, 1e-300)
    say(f"left over: {share:.2g} of the explained, p {p:.1e} ({worst.term.variant.label})")
    rare = LEFT if chains.issuperset(worst.term.chains) else UNSEEN
    return LeftOver(worst, p) if p < rare and share > SHARE else None


def _rareness(system: System, chosen: Sequence[Term], candidate: Candidate) -> float:
    """Logarithm of the chance of such a likelihood ratio by noise alone.

    Of what has one value a dwell, or a positioning of several, these alone tell, and their scatter is told by them as
    well.
    """
    size, ratio = candidate.score.size, max(candidate.ratio, 0.0)
    term, chains = candidate.term, [system.chains[c] for c in candidate.term.chains]
    for begins in ([c.new_positioning for c in chains], [c.new_dwell for c in chains]):
        first = [np.flatnonzero(b > 0.0) for b in begins]
        if _hardly_changes(term, first):
            return log_chance(ratio, size, _free(system, chosen, term, first))
    return log_chance(ratio, size)


def log_chance(ratio: float, size: int, free: float | int = np.inf) -> float:
    r"""Logarithm of the chance that q = `size` coefficients reach a likelihood ratio λ by noise alone.

    With n = `free` observations more than the coefficients before, whose variance is told by them alone,
    $F = (e^{\lambda / n} - 1) (n - q) / q$ is Fisher's with q and n − q degrees of freedom; for many, λ is $\chi^2_q$.
    """
    with np.errstate(divide="ignore"):  # no chance at all
        if np.isinf(free):
            return float(np.log(scipy.special.chdtrc(size, ratio)))
        if free <= size:
            return 0.0
        fisher = np.expm1(ratio / free) * (free - size) / size
        return float(np.log(scipy.special.fdtrc(size, free - size, fisher)))


def _hardly_changes(term: Term, first: Sequence[Int[np.ndarray, "_"]]) -> bool:
    """Whether a term's columns hardly change within dwells or positionings, whose `first` rows these are on each of its
    chains."""
    for begins, columns in zip(first, term.columns, strict=True):
        count = np.diff(np.append(begins, len(columns)))[:, None]
        means = np.add.reduceat(columns, begins, axis=0) / count
        within = columns - np.repeat(means, count[:, 0], axis=0)
        if np.sum(within**2) > WITHIN * np.sum((columns - columns.mean(axis=0)) ** 2):
            return False
    return True


def _free(
    system: System, chosen: Sequence[Term], term: Term, first: Sequence[Int[np.ndarray, "_"]]
) -> int:
    """Dwells or positionings on a term's chains, less the model's parameters and the coefficients of chosen terms
    there."""
    made = 0
    for c, begins in zip(term.chains, first, strict=True):
        mine = [t for t in chosen if c in t.chains]
        columns = sum(t.columns[t.chains.index(c)].shape[1] for t in mine)
        made += len(begins)
        made -= system.frames[c].shape[1] + columns
    return made
