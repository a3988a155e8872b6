"""Names that rests left out do not exclude, in logs whose rests were searched.

The evidence of a name holds for noise of the form that was fitted. In a log by hand the levels of the rests have a
few large ones among them, which no Gaussian has, and of twenty rests these decide: a drift that fits two of them
better than a step is then "certain" by the evidence. How well each name predicts rests that it was not fitted to,
and how much that differs from rest to rest, asks nothing of the noise's form.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy.special
from jaxtyping import Float

from ..candidates.signatures import Term
from ..problem import Prepared
from ..selection.evidence import Candidate
from ..selection.verdict import Named, SAME
from .cross_validation import gain_over_stretches
from .persistence import carried


ALIKE = 2.0  # standard errors of the difference between two names' predictions, within which both stay (convention)
MOST = 4  # rivals that are listed


def with_predicted_rivals(prepared: Prepared, named: Named, others: Sequence[Term]) -> Named:
    r"""A name with every further one that predicts rests left out as well as it, within what differs between rests.

    With $d_r$ the squares of rest r under the rival less those under the name, beside the `others`:
    $t = \sum d_r / \sqrt{\sum d_r^2} < 2$ keeps the rival. Its odds against the name are
    $\Phi(-t) / \Phi(t)$, at most 1.

    First asked are those that fit these rows as well as the name and stand behind it for the number of their forms
    alone, as a jump does for its moments: names that predict as well because they hardly act must not take their place.
    """
    gain = gain_over_stretches(prepared, named.candidate.term, others)
    kept = list(named.rivals)
    for rival in sorted(named.near, key=lambda c: not _fits_as_well(c, named.candidate)):
        if len(kept) >= MOST:
            break
        t = _behind(gain, gain_over_stretches(prepared, rival.term, others))
        if t < ALIKE:
            kept.append(_as_likely(rival, named.candidate, max(t, 0.0)))
    left = tuple(c for c in named.near if not any(c.term is k.term for k in kept))
    return replace(named, rivals=tuple(kept), near=left)


def named_instead(
    prepared: Prepared, unlisted: Candidate, listed: Sequence[Named], others: Sequence[Term]
) -> Named | None:
    """The first name of the catalogue that predicts rests left out, and no worse than an unlisted dependence.

    What follows it in `listed` is `near` it. `None` where the unlisted dependence is better than all.
    """
    gain = gain_over_stretches(prepared, unlisted.term, others)
    for k, named in enumerate(listed):
        own = gain_over_stretches(prepared, named.candidate.term, others)
        if carried(own) and _behind(gain, own) < ALIKE:
            name = named.candidate.term.name
            after = [n.candidate for n in listed[k + 1 :] if n.candidate.term.name != name]
            first = {c.term.name: c for c in reversed(after)}
            return replace(named, near=tuple(c for c in after if first[c.term.name] is c))
    return None


def led_by(rival: Candidate, named: Named, p_value: float) -> Named:
    """The name with one of its rivals at its head, and what was there before among the rivals: at most as likely."""
    others = (named.candidate, *(r for r in named.rivals if r is not rival))
    least = lambda c: replace(c, evidence=min(c.evidence, rival.evidence))
    return replace(
        named,
        candidate=rival,
        p_value=p_value,
        rivals=tuple(map(least, others)),
        near=tuple(map(least, named.near)),
    )


def _fits_as_well(rival: Candidate, lead: Candidate) -> bool:
    """Whether a rival with no more coefficients is within the set's bound by its likelihood alone."""
    return rival.score.size <= lead.score.size and lead.ratio - rival.ratio < SAME


def _behind(lead: Float[np.ndarray, " stretch"], rival: Float[np.ndarray, " stretch"]) -> float:
    """By how many standard errors a rival's predictions are worse."""
    difference = lead - rival
    return float(difference.sum() / max(np.sqrt(difference @ difference), 1e-300))


def _as_likely(rival: Candidate, lead: Candidate, t: float) -> Candidate:
    """The rival with the evidence that its odds against the lead stand for."""
    odds = scipy.special.log_ndtr(-t) - scipy.special.log_ndtr(t)
    return replace(rival, evidence=lead.evidence + float(odds))
