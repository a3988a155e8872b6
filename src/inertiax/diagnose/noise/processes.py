"""The processes that a chain's noise is the sum of, as `grouped_filter` and `many_variances` step through them.

Processes that decay alike and are seen alike are one state, to which the variances of each are added: a walk, the level
of a power cycle and the error of a dwell, where the log has one cycle and one dwell; and the errors of dwells and of
positionings, where each dwell is set anew.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from .state_space import Chain, NUM_VARIANCES, TIME_CONSTANTS, WANDER


WHITE, FLICKER, WALK, DWELL, CYCLE, PROBE, RIG = range(NUM_VARIANCES)


class Process(NamedTuple):
    """One process of the state: how it decays, what each variance adds to it, and how it is seen."""

    decay: Float[np.ndarray, " row"]
    added: dict[int, Float[np.ndarray, " row"]]  # by the place of a variance, for a unit of it
    seen: Float[np.ndarray, "row state"]  # one state for each column


def processes(chain: Chain, num: int) -> list[Process]:
    """The processes of the first `num` rows of a chain."""
    gap, cycle, dwell, set_anew, rig = (
        np.asarray(x, float)[:num]
        for x in (chain.gap, chain.new_cycle, chain.new_dwell, chain.new_positioning, chain.rig)
    )
    loads, heated = (np.asarray(x, float)[:num] for x in (chain.loads, chain.heated))
    later = np.ones(num)
    later[0] = 0.0
    relaxing = lambda tau: np.exp(-gap / tau) * later
    made = [
        Process(relaxing(tau), {FLICKER: 1.0 - relaxing(tau) ** 2}, loads) for tau in TIME_CONSTANTS
    ]
    made.append(Process(later, {WALK: gap}, loads))
    made.append(Process(1.0 - cycle, {CYCLE: cycle}, loads))
    if heated.shape[1]:
        made.append(Process(relaxing(WANDER), {PROBE: 1.0 - relaxing(WANDER) ** 2}, heated))
        made.append(Process(1.0 - cycle, {PROBE: cycle}, heated))
    own = np.asarray(chain.rig_of_dwell, float)[:num]
    made.append(Process(1.0 - dwell, {DWELL: dwell, RIG: dwell * own}, np.ones((num, 1))))
    made.append(Process(1.0 - set_anew, {RIG: set_anew * rig}, np.ones((num, 1))))
    return _joined(made)


def _joined(made: list[Process]) -> list[Process]:
    """One process for those that decay alike and are seen alike."""
    kept: dict[tuple[bytes, bytes], Process] = {}
    for one in made:
        key = one.decay.tobytes(), one.seen.tobytes()
        if key in kept:
            added = dict(kept[key].added)
            for variance, unit in one.added.items():
                added[variance] = added.get(variance, 0.0) + unit
            one = one._replace(added=added)
        kept[key] = one
    return list(kept.values())
