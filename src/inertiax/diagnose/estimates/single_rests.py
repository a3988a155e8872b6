"""Single rests that carry a finding alone, in logs whose rests were searched.

Nobody vouches for a rest that was found in the data: the device may have crept, been held, or been turned slowly about
the vertical. What shows in one such rest and nowhere else is taken for handling: the rest is left out, counted and
said. A dependence must show in the others too. What no hand can do is not taken for handling: a constant acceleration
over a whole rest would carry the device away.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy.special
from jaxtyping import Bool

from ...reduction.handling import Disturbance
from ..candidates.columns import lengthen
from ..candidates.signatures import Term
from ..noise.grouped_filter import know
from ..noise.observation_series import NoiseFit, System
from ..problem import Prepared
from ..selection.score_test import whiten_system
from .cross_validation import effect_columns, predict_rest
from .transients import Burst


SEEN = 0.01  # chance of the rest of the evidence by noise, above which one rest is all there is (convention)
MOST = 0.15  # of the blocks that may be left out so; more is no exception (convention)
FEWEST = 6  # rests, from which one is an exception (convention)
REACH = 0.5  # m that a hand moves a device within what is found as a rest (convention)
_IGNORED = 1e8  # times the variance: such rows tell nothing


def alone_in_one_rest(
    prepared: Prepared, noise: NoiseFit, terms: Sequence[Term]
) -> Bool[np.ndarray, " block"]:
    """Blocks of rests without any one of which some term, beside the others, is not seen at all.

    **Arguments:** `terms` are what was named, and the unlisted dependence where there is one.
    """
    marked = np.zeros(prepared.blocks.num_blocks, bool)
    if len(np.unique(prepared.blocks.dwell)) < FEWEST:
        return marked
    for k, term in enumerate(terms):
        decisive = _decisive_rest(prepared, noise, term, [*terms[:k], *terms[k + 1 :]])
        if decisive is not None and _by_hand(prepared, decisive, [*terms[:k], *terms[k + 1 :]]):
            marked |= prepared.blocks.dwell == decisive
    return marked


def disturbed(prepared: Prepared, bursts: Sequence[Burst]) -> Bool[np.ndarray, " block"]:
    """Blocks of short disturbances and their neighbours, which hold their edges."""
    marked = np.zeros(prepared.blocks.num_blocks, bool)
    for burst in bursts:
        marked[max(burst.first - 1, 0) : burst.last + 2] = True
    return marked


def few(marked: Bool[np.ndarray, " block"]) -> bool:
    """Whether so few blocks are marked that they are exceptions."""
    return bool(0 < marked.sum() <= MOST * len(marked))


def left_out(prepared: Prepared, marked: Bool[np.ndarray, " block"]) -> tuple[Disturbance, ...]:
    """The marked stretches, as a result lists what was left out of rests."""
    log, blocks, made = prepared.log, prepared.blocks, []
    if log is None:
        return ()
    edges = np.flatnonzero(np.diff(np.r_[0, marked.astype(int), 0]))
    for first, last in zip(edges[::2], edges[1::2] - 1, strict=True):
        for dwell in np.unique(blocks.dwell[first : last + 1]):
            mine = first + np.flatnonzero(blocks.dwell[first : last + 1] == dwell)
            begin, end = int(blocks.start[mine[0]]), int(blocks.stop[mine[-1]]) - 1
            made.append(
                Disturbance(
                    recording=log.names[log.recording[begin]],
                    start=float(log.clock[begin]),
                    end=float(log.clock[end]),
                    kind="alone",
                    position=int(blocks.position[mine[0]]),
                )
            )
    return tuple(made)


def within(prepared: Prepared, stretches: Sequence[Disturbance]) -> Bool[np.ndarray, " block"]:
    """Blocks that lie, in part, in stretches of their recording."""
    marked = np.zeros(prepared.blocks.num_blocks, bool)
    log, blocks = prepared.log, prepared.blocks
    if log is None or not stretches:
        return marked
    names = np.array(log.names)[log.recording[blocks.start]]
    begin, end = log.clock[blocks.start], log.clock[blocks.stop - 1]
    for stretch in stretches:
        marked |= (names == stretch.recording) & (begin <= stretch.end) & (end >= stretch.start)
    return marked


def searched(prepared: Prepared) -> bool:
    """Whether rests were found in the data, so that handling is what disturbs them."""
    return prepared.log is not None and prepared.log.searched


def _decisive_rest(
    prepared: Prepared, noise: NoiseFit, term: Term, others: Sequence[Term]
) -> int | None:
    """The rest without which a term's gain could be noise; `None` where every rest can be spared."""
    worst, decisive = SEEN, None
    for dwell in np.unique(prepared.blocks.dwell):
        scores = whiten_system(
            _without(prepared.system, prepared.blocks.dwell == dwell), noise, [term], others
        ).scores
        chance = float(scipy.special.chdtrc(scores[0].size, scores[0].gain)) if scores else 1.0
        if chance > worst:
            worst, decisive = chance, int(dwell)
    return decisive


def _by_hand(prepared: Prepared, dwell: int, others: Sequence[Term]) -> bool:
    """Whether a hand can have done what a rest shows beyond the other rests' prediction.

    A turn about the vertical is all that gyros need. Where |a| is compared with gravity, an error e over the rest's
    duration T is an acceleration that moves the device by e T²/2.
    """
    blocks = prepared.blocks
    if not prepared.form.by_magnitude or prepared.log is None:
        return True
    known = blocks.dwell != dwell
    y, white = prepared.system.base.observed[0], prepared.system.chains[0].white
    effects = effect_columns(others, 0, len(y))
    error = y[~known] - predict_rest(prepared.system.frames[0], effects, y, white, known)
    clock, mine = prepared.log.clock, np.flatnonzero(~known)
    duration = float(clock[blocks.stop[mine[-1]] - 1] - clock[blocks.start[mine[0]]])
    return 0.5 * abs(float(np.mean(error))) * duration**2 <= REACH


def _without(system: System, rows: Bool[np.ndarray, " block"]) -> System:
    """The system with some rows of every chain as good as unknown."""
    factor = np.where(rows, _IGNORED, 1.0)
    chains = tuple(replace(chain, white=chain.white * factor) for chain in system.chains)
    for chain, own in zip(chains, system.chains, strict=True):
        know(chain, own)
    longer = tuple(
        replace(chain, white=lengthen(own.white))
        for own, chain in zip(chains, system.longer, strict=True)
    )
    return replace(system, chains=chains, longer=longer)
