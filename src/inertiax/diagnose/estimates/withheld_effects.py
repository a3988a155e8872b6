"""Named effects that the written calibration is without, since other names that are left would calibrate otherwise.

A name with rivals is the likeliest of several, and may be less likely than all others together. Taken away all the
same, it would more often than not leave a calibration that is wrong by its whole difference from the right one. Rivals
that move the calibration alike, within what it is known to, do not matter: under each of them it is the same.
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from ...calibration.calibration import Calibration, TriadCalibration
from ..selection.verdict import Named
from .augmented_calibration import Beside, shift_by


# The chance of the name and of rivals that calibrate alike, from which on it is applied: more likely right than wrong.
LEAST = 0.5


def with_likely_applied(one: Beside, plain: Calibration) -> Beside:
    """The effects of a triad, of which those less likely than `LEAST` are withheld; `plain` is the calibration before
    any of them."""
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
    odds = named.odds
    if len(odds) == 1:
        return True
    known = np.sqrt(np.diagonal(np.asarray(triad.covariance, float)))
    lead = shift_by(one.prepared, named.candidate, triad)
    chance = float(odds[0])
    for part, rival in zip(odds[1:], named.rivals, strict=True):
        # One that is kept for what it predicts has no size of its own, by which it could differ.
        sized = rival.score.term is rival.term
        if not sized or _alike(shift_by(one.prepared, rival, triad) - lead, known):
            chance += float(part)
    return chance >= LEAST


def _alike(apart: Float[np.ndarray, " unknown"], known: Float[np.ndarray, " unknown"]) -> bool:
    """Whether two calibrations differ in no coefficient by more than its standard deviation."""
    return bool(np.all(np.abs(apart) <= known))


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
