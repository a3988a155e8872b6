"""How rare the best of a whole family of candidates is by noise alone.

The chance of a false alarm is shared out evenly: each catalogued effect on each channel has an equal part, and all
its forms share that part; the unlisted dependences stand together beside them. An effect of one form need not pay
for the hundred moments at which another could have jumped.

Where forms lie densely along a setting, as time constants and frequencies do, the best of them counts as more tests
the rarer it is: the chance that a smooth path of unit vectors somewhere sees a ratio above $u$ is

$$P(\\chi^2_s > u)\\,\\bigl(1 + \\kappa \\sqrt{u}\\bigr)$$

to leading order, with $\\kappa$ its length up to a constant. The moment of a jump is no smooth setting: neighbours
differ by the noise of a block, and the number grows with $u$ itself, as for the largest of a Brownian path. It is
counted where draws of noise are many and carried to the tail in this way, up to the number of forms.

**Reference:** Genovese, Roeder & Wasserman, *False discovery control with p-value weighting*, Biometrika 93 (2006)
509, for weights in multiple testing; Davies, *Hypothesis testing when a nuisance parameter is present only under the
alternative*, Biometrika 74 (1987) 33, for a setting that is sought; Siegmund, *Sequential Analysis*, Springer 1985,
for a moment.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.special

from ..candidates.empirical import PREFIX
from ..candidates.signatures import Term
from .evidence import Candidate
from .score_test import Score


Key = tuple[str, tuple[int, ...]]
SMOOTH, JUMPING = (
    0.5,
    1.0,
)  # growth of the number of tests with the ratio, by the setting that is sought


@dataclass(frozen=True)
class Count:
    """Effective number of independent tests of one effect's forms."""

    number: float  # of those with the same smallest p-values under noise
    level: float = np.inf  # likelihood ratio at which it was counted; infinite: it does not grow
    forms: float = np.inf  # which it cannot exceed
    growth: float = SMOOTH  # power of the likelihood ratio

    def at(self, ratio: float) -> float:
        """The number at a likelihood ratio."""
        grown = 1.0 + (self.number - 1.0) * max(ratio / self.level, 1.0) ** self.growth
        return min(grown, max(self.forms, self.number))


ONE = Count(1.0)


@dataclass(frozen=True)
class Family:
    """Effective numbers of independent tests."""

    groups: Mapping[Key, Count]  # within each catalogued effect on its channels
    unlisted: float  # of all unlisted dependences together

    @property
    def total(self) -> float:
        """Over everything, if the parts were independent."""
        return sum(t.number for t in self.groups.values()) + self.unlisted

    def tests(self, term: Term, ratio: float = 0.0) -> float:
        """What one term's p-value is to be multiplied by at a likelihood ratio, for small ones."""
        if term.name.startswith(PREFIX):
            return self.unlisted
        own = self.groups.get((term.name, term.channels), ONE).at(ratio)
        return own * max(len(self.groups), 1)

    def recounted(self, key: Key, tests: Count) -> "Family":
        """The same family with another number of tests of one effect."""
        return replace(self, groups={**self.groups, key: tests})

    def p_value(self, candidate: Candidate) -> float:
        """Chance that the candidate's part of the family reaches its likelihood ratio by noise alone."""
        single = scipy.special.chdtrc(candidate.score.size, max(candidate.ratio, 0.0))
        tests = self.tests(candidate.term, candidate.ratio)
        return float(-np.expm1(tests * np.log1p(-min(single, 1 - 1e-12))))


def family(scores: Sequence[Score], lengths: Sequence[int], draws: int = 160) -> Family:
    """Numbers of independent tests with the same smallest p-value as the correlated ones.

    White residuals are drawn, and the distribution 1 − (1 − p)^N is fitted to their smallest p-values.
    """
    rng = np.random.default_rng(20240229)
    noise = [rng.standard_normal((n, draws)) for n in lengths]
    # Of forms with as many coefficients the one that gains most is the rarest.
    largest: dict[tuple[Key, int], np.ndarray] = {}
    forms: dict[Key, list[Score]] = {}
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
            gain = np.square(s.turn.T @ part).sum(axis=0)
            key = unlisted if s.term.name.startswith(PREFIX) else (s.term.name, s.term.channels)
            largest[key, s.size] = np.maximum(largest.get((key, s.size), 0.0), gain)
            forms.setdefault(key, []).append(s)
    smallest: dict[Key, np.ndarray] = {}
    for (key, size), gain in largest.items():
        chance = scipy.special.chdtrc(size, gain)
        smallest[key] = np.minimum(smallest.get(key, 1.0), chance)
    together = smallest.pop(unlisted, None)
    groups = {key: counted(least, forms[key]) for key, least in smallest.items()}
    return Family(groups, 0.0 if together is None else number_of_tests(together))


def _by_chain(scores: Sequence[Score]) -> dict[int, list[Score]]:
    """Scores of one chain each; those of several chains under −1."""
    made: dict[int, list[Score]] = {}
    for score in scores:
        chains = score.chains
        made.setdefault(chains[0] if len(chains) == 1 else -1, []).append(score)
    return made


def counted(smallest: np.ndarray, forms: Sequence[Score]) -> Count:
    """Tests of one effect's forms with these smallest p-values on draws of noise.

    Counted on the rarer half of the draws, by maximum likelihood of N with the other half censored. Where nearly every
    draw has a form that reaches a ratio, how often it does says little of the tail.
    """
    rare = np.sort(smallest)[: max(len(smallest) // 2, 1)]
    logs = -np.log1p(-np.clip(rare, 1e-15, 1 - 1e-12))
    number = len(rare) / (logs.sum() + (len(smallest) - len(rare)) * logs[-1])
    level = scipy.special.chdtri(np.mean([s.size for s in forms]), np.mean(rare))
    effect = forms[0].term.effect
    jumping = effect is not None and effect.nuisance == "time"
    growth = JUMPING if jumping else SMOOTH
    return Count(max(float(number), 1.0), float(level), float(len(forms)), growth)


def number_of_tests(smallest: np.ndarray) -> float:
    """Maximum likelihood of N for smallest p-values with the distribution 1 − (1 − p)^N; at least 1."""
    logs = np.log1p(-np.clip(smallest, 1e-15, 1 - 1e-12))
    return max(float(len(smallest) / -logs.sum()), 1.0)
