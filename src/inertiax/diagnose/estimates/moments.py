"""When something happened: the moment of a step by its profile likelihood, and one moment for one event."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float
from scipy.special import chdtri

from ..candidates.signatures import Term
from ..noise.observation_series import NoiseFit
from ..problem import Prepared, retuned
from ..selection.score_test import whiten_system
from .single_rests import searched


INSIDE = 0.01  # chance at which noise passes for a jump within some rest that nobody vouches for
EDGE = 18  # a jump within this part of the campaign at either end is not told from a disturbed stay


@dataclass(frozen=True, eq=False)
class Moments:
    """Profile of the moments of one term, or of several that share it: a staircase over the times between blocks."""

    low: Float[np.ndarray, " step"]  # s
    high: Float[np.ndarray, " step"]  # s
    gain: Float[np.ndarray, " step"]  # drop of the sum of squares
    between: Bool[np.ndarray, " step"]  # whether it is a time between two rests or plateaus
    members: tuple[list[Term], ...]  # of each term, one a step

    @property
    def best(self) -> int:
        """The step with the greatest likelihood."""
        return int(np.argmax(self.gain))

    def spread(self) -> float:
        """Root mean square distance from the middle of the best step, s.

        Moments between the same two blocks look alike: each step weighs with its likelihood and its duration, so that
        it is never below the best one's $1/\\sqrt{12}$, and gaps that fit as well add their distance.
        """
        middle = 0.5 * (self.low + self.high)
        weight = np.exp(0.5 * (self.gain - self.gain.max())) * (self.high - self.low)
        square = np.square(middle - middle[self.best]) + np.square(self.high - self.low) / 12.0
        return float(np.sqrt(weight @ square / weight.sum()))


def tuned_moments(
    prepared: Prepared, noise: NoiseFit, terms: Sequence[Term], others: Sequence[Term]
) -> list[tuple[Term, float]]:
    """Each term at its moment, with the moment's standard deviation.

    Jumps on several channels are one event, with one moment by all of them, unless moments of their own raise the
    likelihood by more than a further parameter each must, $\\ln n$ of n rows (BIC).

    **Reference:** G. Schwarz, Ann. Statist. 6 (1978) 461; for a moment by its likelihood, D. V. Hinkley, Biometrika 57
    (1970) 1.
    """
    alone = [
        _profile(prepared, noise, t, [*others, *_without(terms, k)]) for k, t in enumerate(terms)
    ]
    if len(terms) > 1:
        shared = replace(
            alone[0],
            gain=np.sum([p.gain for p in alone], axis=0),
            members=tuple(p.members[0] for p in alone),
        )
        lost = sum(p.gain.max() for p in alone) - shared.gain.max()
        rows = prepared.system.num_rows / len(prepared.system.chains)
        if lost <= (len(terms) - 1) * np.log(rows):
            alone = [shared]
    if searched(prepared):
        alone = [_outside_rests(p) for p in alone]
    return [(m[p.best], p.spread()) for p in alone for m in p.members]


def _outside_rests(profile: Moments) -> Moments:
    """The profile of the moments between rests, unless one within a rest stands out by more than chance makes likely.

    Hands jolt a device while they turn it. Rests that were found in the data tremble, and of a thousand moments within
    them one fits the trembling: it must be better than the best moment between rests by what chance reaches with
    `INSIDE`.
    """
    outside = np.where(profile.between, profile.gain, -np.inf)
    chance = float(chdtri(1, INSIDE / len(profile.gain)))
    return (
        replace(profile, gain=outside) if outside.max() + chance >= profile.gain.max() else profile
    )


def _without(terms: Sequence[Term], k: int) -> list[Term]:
    return [t for j, t in enumerate(terms) if j != k]


def _profile(prepared: Prepared, noise: NoiseFit, term: Term, others: Sequence[Term]) -> Moments:
    """Every time between two blocks, without the ends of the campaign."""
    edges = prepared.coarse.time
    margin = max(len(edges) // EDGE, 1)
    places = np.arange(margin, len(edges) - margin + 1)
    low, high = np.asarray(edges)[places - 1], np.asarray(edges)[places]
    members = retuned(prepared, term, (0.5 * (low + high)).tolist())
    scores = {id(s.term): s for s in whiten_system(prepared.system, noise, members, others).scores}
    gains = np.array([scores[id(m)].gain if id(m) in scores else -np.inf for m in members])
    dwell = prepared.blocks.dwell
    return Moments(low, high, gains, dwell[places] != dwell[places - 1], (members,))
