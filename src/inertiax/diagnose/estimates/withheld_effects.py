r"""Named effects that the written calibration is without, since other names that are left would calibrate otherwise.

A name with rivals is the likeliest of several, and may be less likely than all others together. With the odds $p_k$ of
the names and the shift $d_k$ of the calibration by each, over its standard deviations, the calibration is expected to
be off by $\sum p_k |d_k - d_0|^2$ with the first one applied and by $\sum p_k |d_k|^2$ without any. The smaller one
is written; below one standard deviation in all, it does not matter and the name is applied.
"""

from dataclasses import replace

import numpy as np

from ...calibration.calibration import Calibration, TriadCalibration
from ..selection.verdict import Named
from .augmented_calibration import Beside, shift_by


# Square of standard deviations, of all coefficients together, below which names calibrate alike.
ALIKE = 1.0


def with_likely_applied(one: Beside, plain: Calibration) -> Beside:
    """The effects of a triad, of which those that are expected to leave more than they take are withheld; `plain` is
    the calibration before any of them."""
    triad = getattr(plain, one.prepared.form.triad)
    if triad is None or np.shape(triad.covariance)[0] != one.prepared.system.base.coefficients.size:
        return one  # of one pose: the effects are all that is told of the accelerometers
    likely = [_likely(one, named, triad) for named in one.named[: len(one.terms)]]
    if all(likely):
        return one
    kept = [k for k, told in enumerate(likely) if told]
    return replace(
        one,
        terms=tuple(one.terms[k] for k in kept),
        stored=tuple(one.stored[k] for k in kept),
        named=(*(one.named[k] for k in kept), *one.named[len(one.terms) :]),
        withheld=tuple(one.named[k] for k, told in enumerate(likely) if not told),
        unknown=one.unknown if kept else None,
    )


def _likely(one: Beside, named: Named, triad: TriadCalibration) -> bool:
    if len(named.odds) == 1:
        return True
    known = np.sqrt(np.diagonal(np.asarray(triad.covariance, float)))
    known = np.where(known > 0.0, known, np.inf)  # what is held moves by nothing
    lead = shift_by(one.prepared, named.candidate, triad) / known
    applied, without = 0.0, float(named.odds[0]) * float(lead @ lead)
    for part, rival in zip(named.odds[1:], named.rivals, strict=True):
        # One that is kept for what it predicts has no size of its own, by which it could differ.
        sized = rival.score.term is rival.term
        moved = shift_by(one.prepared, rival, triad) / known if sized else lead
        applied += float(part) * float((moved - lead) @ (moved - lead))
        without += float(part) * float(moved @ moved)
    return applied <= max(without, ALIKE)


def withheld_sentence(named: Named) -> str:
    """That the written calibration is without an effect, and what is as likely."""
    rivals = list(dict.fromkeys(r.term.name for r in named.rivals))
    term, count = named.candidate.term, len(rivals)
    return (
        f"{term.name} on {', '.join(term.channel_names)} is found and not applied in calibration.json: its odds are "
        f"{100.0 * named.odds[0]:.0f} %, and {count} {'alternative' if count == 1 else 'alternatives'} "
        f"({', '.join(rivals)}) would move the calibration otherwise; the uncertainties hold what each of them would "
        "move."
    )
