"""A claim that something acts throughout predicts data left out; a jump of the bias shows in rests on both sides."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Int

from ..candidates.signatures import Term
from ..problem import Prepared
from .cross_validation import gain_over_stretches, held_out_rms
from .single_rests import searched


SIDE = 2  # dwells on either side of a jump; one rest that is off is a rest that is off, and no jump (convention)
CARRIERS = 1.5  # dwells that carry a gain, as an effective number: more than one (convention)
INSIDE = 0.25  # of a dwell's blocks on each side: a jump nearer to an end may be how the rest begins (convention)
MANY = 10  # dwells, from which a campaign has rests on both sides of any moment that is meant


def persists(prepared: Prepared, term: Term, others: Sequence[Term]) -> bool:
    """Whether a named jump of the bias is one; of other effects nothing is asked here.

    **Arguments:** `others` are the effects named beside it. The jump must leave `SIDE` dwells on both sides, in a
    campaign of `MANY` or more, or where rests were searched and it is between two of them; and predict data left out.
    """
    if term.effect is None or not term.effect.jump:
        return True
    moment = float(term.variant.settings["time"])
    dwell, time = prepared.blocks.dwell, np.asarray(prepared.coarse.time)
    before, after = (len(np.unique(dwell[side])) for side in (time < moment, time >= moment))
    if before + after >= MANY and min(before, after) < SIDE:
        return False
    if searched(prepared) and not _on_both_sides(dwell, time < moment):
        return False
    return held_out_rms(prepared, [*others, term]) < held_out_rms(prepared, list(others))


def _on_both_sides(dwell: Int[np.ndarray, " block"], before: Bool[np.ndarray, " block"]) -> bool:
    """Whether several dwells lie on both sides, or the jump is well inside one, where nothing is moved.

    A lone rest on one side may be one in which the device moves.
    """
    shares = np.array([before[dwell == d].mean() for d in np.unique(dwell)])
    if np.any((shares >= INSIDE) & (shares <= 1.0 - INSIDE)):
        return True
    return bool(min(np.sum(shares > 0.5), np.sum(shares <= 0.5)) >= SIDE)


def predicts(prepared: Prepared, term: Term, others: Sequence[Term]) -> bool:
    """Whether a term beside the others lowers the squares of what is left out, and of more than one dwell of it."""
    return carried(gain_over_stretches(prepared, term, others))


def lowers_rms(prepared: Prepared, term: Term, others: Sequence[Term]) -> bool:
    """Whether a term beside the others lowers the rms of what is left out, each error as it is.

    That is what a result states. Several coefficients that few rests tell may predict most rests by their own variance,
    and miss those that matter.
    """
    without = held_out_rms(prepared, list(others), term.chains)
    return held_out_rms(prepared, [*others, term], term.chains) < without


def carried(gain: Float[np.ndarray, " stretch"]) -> bool:
    r"""Whether more than one stretch carries a gain.

    With $g_d$ by how much the squares of stretch d fall, $G = \sum g_d > 0$ and $G^2 / \sum g_d^2 > 1.5$: that is 1
    where a single one gains, and n where n gain alike.
    """
    total = float(gain.sum())
    return total > 0.0 and total**2 > CARRIERS * float(gain @ gain)
