"""What a flexible dependence still finds beside the named effects."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.special

from ..candidates.signatures import Term
from ..candidates.smooth import on_input
from ..noise.observation_series import NoiseFit, System
from .evidence import bank, Candidate, judge, refine


LEFT = 1e-4  # chance below which a flexible dependence beside the named effects counts
UNSEEN = 1e-6  # the same where nothing was named
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

    Where nothing was named, dependences on the inputs alone: a smooth course in time is what slow noise is.

    **Arguments:** `noise` is the fit beside the chosen effects, or that of the null where there are none.
    """
    terms = [c.term for c in chosen]
    chains = {c for t in terms for c in t.chains}
    asked = [t for t in flexible if chains.issuperset(t.chains) or (not terms and on_input(t))]
    start = bank(system, [noise], terms)
    ranked = sorted(judge(system, start, asked, terms, {}, grade), key=_rareness)
    if not terms and (not ranked or _rareness(ranked[0]) > np.log(UNSEEN)):
        return None
    fuller = refine(system, start, ranked[:6], terms, most=3)
    ranked = judge(system, fuller, [c.term for c in ranked[:6]], terms, {}, grade)
    if not ranked:
        return None
    worst = min(ranked, key=_rareness)
    p = float(np.exp(min(_rareness(worst) + np.log(len(asked)), 0.0)))
    mine = sum(c.ratio for c in chosen if set(c.term.chains) & set(worst.term.chains))
    share = (worst.ratio - worst.score.size) / max(mine, 1e-300)
    say(f"left over: {share:.2f} of the explained, p {p:.1e} ({worst.term.variant.label})")
    return LeftOver(worst, p) if p < (LEFT if terms else UNSEEN) and share > SHARE else None


def _rareness(candidate: Candidate) -> float:
    """Logarithm of the chance of such a likelihood ratio by noise alone."""
    with np.errstate(divide="ignore"):  # no chance at all
        return float(np.log(scipy.special.chdtrc(candidate.score.size, max(candidate.ratio, 0.0))))
