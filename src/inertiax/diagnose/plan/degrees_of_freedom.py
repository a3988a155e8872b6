"""How well the dwells of a campaign tell the scatter between them, against which an effect has to show.

The scatter between dwells is fitted to the dwells that an effect is looked for in, so that it can stand for the effect.
Ten rests leave three degrees of freedom beside six parameters and an effect: a likelihood ratio of 16, which hundreds
of dwells reach at four standard deviations, these reach at thirteen. What an effect does within dwells scatter cannot
stand for.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import cast, NamedTuple

import numpy as np
import scipy.special

from ..noise.observation_series import NoiseFit, System
from ..noise.state_space import FREEDOM
from ..selection.score_test import Score, whiten_system
from .limits import POWER


DWELL = 3  # place of the variance of each dwell among a chain's log variances (`noise.state_space.Variances`)
FREE = 12.0  # its logarithm where dwells tell nothing by their levels, the most that is fitted
SLIGHT = 0.01  # part of the information below which a tenfold size would be asked for (convention)
PLENTY = 500  # dwells from which their scatter is known to 3 %, and nothing is worked out


class Told(NamedTuple):
    """What a coefficient is judged by."""

    freedom: float = np.inf  # of the scatter between dwells, beside the model and the effect
    within: float = 1.0  # part of what is told of the coefficient that dwells tell within them

    @property
    def anything(self) -> bool:
        """Whether scatter between the dwells cannot stand for all of the effect."""
        return bool(self.freedom >= 1.0 or self.within > SLIGHT)


BY_ALL = Told()  # of dwells by the thousand


def told_by_dwells(system: System, noise: NoiseFit, scores: Sequence[Score]) -> list[Told]:
    r"""What each score is told by.

    Of n dwells the model takes p parameters and the term its k coefficients, which leaves $\nu = n - p - k$ (and 4 more
    where other channels tell what to expect). The part within dwells is that of the coefficient's information which
    is left where every dwell has a level of its own.
    """
    count = [np.count_nonzero(c.new_dwell) for c in system.chains]
    if not scores or min(count) > PLENTY:
        return [BY_ALL for _ in scores]
    others = [FREEDOM if k.precision[DWELL, DWELL] > 0.0 else 0.0 for k in system.known]
    left = [n - q.shape[1] + more for n, q, more in zip(count, system.frames, others, strict=True)]
    theta = tuple(np.where(np.arange(len(t)) == DWELL, FREE, t) for t in noise.theta)
    apart = whiten_system(system, replace(noise, theta=theta), [s.term for s in scores]).scores
    lengths = {id(s.term): best_length(s) for s in apart}

    def told(score: Score) -> Told:
        whole, alone = best_length(score), lengths.get(id(score.term), 0.0)
        within = min((alone / whole) ** 2, 1.0) if whole > 0.0 else 0.0
        return Told(max(sum(left[c] for c in score.term.chains) - score.size, 0.0), within)

    return list(map(told, scores))


def deviations_for(least: float, size: int, told: Told) -> float:
    r"""Standard deviations at which twice the log likelihood gains `least` with probability `POWER`.

    With the part g within dwells and k coefficients, t standard deviations gain
    $g t^2 + (\nu + k) \ln(1 + (1 - g) t^2 / \nu)$, the second without degrees of freedom nothing; noise adds
    $\Phi^{-1}(0.9) \sqrt{1 + (1 - g) t^2 / 2\nu}$. Infinite where nothing is told.

    **Reference:** Johnson and Welch, Biometrika 31 (1940) 362, for the quantiles of the noncentral t.
    """
    from scipy.optimize import brentq  # slow to import, and not always needed

    within, freedom = told.within, told.freedom
    quantile = float(scipy.special.ndtri(POWER))
    if np.isinf(freedom):
        return float(np.sqrt(least)) + quantile
    if not told.anything:
        return np.inf
    if freedom < 1.0:
        return float(np.sqrt(least / within)) + quantile / np.sqrt(within)
    share = (1.0 - within) / freedom
    gain = lambda t: within * t * t + (freedom + size) * np.log1p(share * t * t)
    most = np.sqrt(freedom * np.expm1(least / (freedom + size)) / max(1.0 - within, 1e-9))
    if within > 0.0:
        most = min(most, np.sqrt(least / within))
    t = cast(float, brentq(lambda t: gain(t) - least, 0.0, 1.001 * most))
    return t + quantile * float(np.sqrt(1.0 + 0.5 * share * t * t))


def best_length(score: Score) -> float:
    """Standard deviations by which one unit of the best-seen coefficient moves the rows, the others at zero."""
    return float(np.sqrt(sum(np.square(w).sum(axis=0) for w in score.white)).max())
