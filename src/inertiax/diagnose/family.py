"""How rare the best of a whole family of candidates is by noise alone.

The chance of a false alarm is shared out evenly: each catalogued effect on each channel has an equal part, and all
its forms share that part; the unlisted dependences stand together beside them. An effect of one form need not pay
for the hundred moments at which another could have jumped.

**Reference:** Genovese, Roeder & Wasserman, *False discovery control with p-value weighting*, Biometrika 93 (2006)
509, for weights in multiple testing.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.special

from .alternatives import PREFIX
from .scores import Score
from .search import Candidate
from .terms import Term


Key = tuple[str, tuple[int, ...]]


@dataclass(frozen=True)
class Family:
    """Effective numbers of independent tests."""

    groups: Mapping[Key, float]  # within each catalogued effect on its channels
    unlisted: float  # of all unlisted dependences together

    @property
    def total(self) -> float:
        """Over everything, if the parts were independent."""
        return sum(self.groups.values()) + self.unlisted

    def tests(self, term: Term) -> float:
        """What one term's p-value is to be multiplied by, for small ones."""
        if term.name.startswith(PREFIX):
            return self.unlisted
        own = self.groups.get((term.name, term.channels), 1.0)
        return own * max(len(self.groups), 1)

    def recounted(self, key: Key, number: float) -> "Family":
        """The same family with another number of tests of one effect."""
        return replace(self, groups={**self.groups, key: number})

    def p_value(self, candidate: Candidate) -> float:
        """Chance that the candidate's part of the family reaches its likelihood ratio by noise alone."""
        single = scipy.special.chdtrc(candidate.score.size, max(candidate.ratio, 0.0))
        return float(-np.expm1(self.tests(candidate.term) * np.log1p(-min(single, 1 - 1e-12))))


def family(scores: Sequence[Score], lengths: Sequence[int], draws: int = 160) -> Family:
    """Numbers of independent tests with the same smallest p-value as the correlated ones.

    White residuals are drawn, and the distribution 1 − (1 − p)^N is fitted to their smallest p-values.
    """
    rng = np.random.default_rng(20240229)
    noise = [rng.standard_normal((n, draws)) for n in lengths]
    smallest: dict[Key, np.ndarray] = {}
    unlisted: Key = (PREFIX, ())
    for chain, members in _by_chain(scores).items():
        product = np.empty((0, draws))
        if chain >= 0:
            product = np.concatenate([s.white[0] for s in members], axis=1).T @ noise[chain]
        at = 0
        for s in members:
            if chain >= 0:
                part = product[at : at + s.white[0].shape[1]]
                at += s.white[0].shape[1]
            else:
                part = sum(w.T @ noise[k] for w, k in zip(s.white, s.chains))
            chance = scipy.special.chdtrc(s.size, np.square(s.turn.T @ part).sum(axis=0))
            key = unlisted if s.term.name.startswith(PREFIX) else (s.term.name, s.term.channels)
            smallest[key] = np.minimum(smallest.get(key, 1.0), chance)
    numbers = {key: number_of_tests(least) for key, least in smallest.items()}
    together = numbers.pop(unlisted, 0.0)
    return Family(numbers, together)


def _by_chain(scores: Sequence[Score]) -> dict[int, list[Score]]:
    """Scores of one chain each; those of several chains under −1."""
    made: dict[int, list[Score]] = {}
    for score in scores:
        chains = score.chains
        made.setdefault(chains[0] if len(chains) == 1 else -1, []).append(score)
    return made


def number_of_tests(smallest: np.ndarray) -> float:
    """Maximum likelihood of N for smallest p-values with the distribution 1 − (1 − p)^N; at least 1."""
    logs = np.log1p(-np.clip(smallest, 1e-15, 1 - 1e-12))
    return max(float(len(smallest) / -logs.sum()), 1.0)
