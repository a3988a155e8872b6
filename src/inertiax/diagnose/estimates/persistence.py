"""A change of the bias must persist: it shows in the rests on both sides of it, and predicts data left out."""

from collections.abc import Sequence

import numpy as np

from ..candidates.signatures import Term
from ..problem import Prepared
from .cross_validation import held_out_rms


SIDE = 2  # dwells on either side of a jump; one rest that is off is a rest that is off, and no jump (convention)
MANY = 10  # dwells, from which a campaign has rests on both sides of any moment that is meant


def persists(prepared: Prepared, term: Term, others: Sequence[Term]) -> bool:
    """Whether a named jump of the bias is one; of other effects nothing is asked here.

    **Arguments:** `others` are the effects named beside it. The jump must leave `SIDE` dwells on both sides, in a
    campaign of `MANY` or more, and the rms of data left out must be lower with it than without.
    """
    if term.effect is None or not term.effect.jump:
        return True
    moment = float(term.variant.settings["time"])
    dwell, time = prepared.blocks.dwell, np.asarray(prepared.coarse.time)
    before, after = (len(np.unique(dwell[side])) for side in (time < moment, time >= moment))
    if before + after >= MANY and min(before, after) < SIDE:
        return False
    return held_out_rms(prepared, [*others, term]) < held_out_rms(prepared, list(others))
