"""Two slow effects at once, where neither shows alone.

A random walk follows the sum of two slow courses, and beside either of them alone it follows the other. Only with both
in the mean do the variances fall to what they are, and both stand out.
"""

from collections import Counter
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, replace

import scipy.special

from ..candidates.signatures import Term
from ..noise.observation_series import System
from ..noise.reml import fit_noise
from .evidence import Bank, bank, Candidate, judge, refine
from .multiple_testing import Family, Key, ONE


LEADING = 2  # effects of a channel that others are tried beside
BESIDE = 2  # of those, how many the variances are fitted anew beside


@dataclass(frozen=True, eq=False)
class Pair:
    """Two effects on one channel with what they gain together."""

    first: Candidate
    second: Candidate  # beside the first
    p_value: float

    @property
    def evidence(self) -> float:
        """Log odds of both together."""
        return self.first.evidence + self.second.evidence


def chance(first: Candidate, second: Candidate, tests: Family, slow: Collection[Key]) -> float:
    """Chance that the pair's part of all pairs of slow effects of one channel gains as much by noise alone."""
    size = first.score.size + second.score.size
    single = scipy.special.chdtrc(size, max(first.ratio, 0.0) + max(second.ratio, 0.0))
    per_channel = Counter(on for _, on in slow)
    pairs = sum(n * (n - 1) // 2 for n in per_channel.values())
    forms = [tests.groups.get(c.key, ONE).at(c.ratio) for c in (first, second)]
    return float(min(single * forms[0] * forms[1] * max(pairs, 1), 1.0))


def best_pair(
    system: System,
    start: Bank,
    ranked: Sequence[Candidate],
    short: Sequence[Term],
    chosen: Sequence[Term],
    forms: dict,
    grade: str | None,
    tests: Family,
) -> Pair | None:
    """The rarest pair of slow catalogued effects of one channel beside the chosen terms; `None` where there is none."""
    slow = [t for t in short if _slow(t) and len(t.chains) == 1]
    keys = {(t.name, t.channels) for t in slow}
    leading = _firsts(c for c in ranked if c.key in keys)
    made = []
    for chain in range(len(system.chains)):
        here = [t for t in slow if t.chains == (chain,)]
        for first in [c for c in leading if c.term.chains == (chain,)][:LEADING]:
            beside = [*chosen, first.term]
            noise = fit_noise(system, beside, start.leader, (chain,))
            own = judge(system, bank(system, [noise], chosen), [first.term], chosen, forms, grade)
            # Counted from the chosen terms' own best variances, so that the gains of the two add up.
            gain = 2.0 * (start.best[chain] - noise.value[chain])
            others = [t for t in here if (t.name, t.channels) != first.key]
            near = bank(system, [noise], beside)
            found = _firsts(judge(system, near, others, beside, forms, grade))[:BESIDE]
            fuller = refine(system, near, found, beside, most=BESIDE)
            found = judge(system, fuller, [c.term for c in found], beside, forms, grade)
            for a, b in zip(own[:1], found[:1]):
                a = replace(a, ratio=gain, evidence=a.evidence + 0.5 * (gain - a.ratio))
                made.append(Pair(a, b, chance(a, b, tests, keys)))
    return min(made, key=lambda p: (p.p_value, -p.evidence), default=None)


def _slow(term: Term) -> bool:
    return term.effect is not None and (term.effect.slow or "temperature" in term.effect.requires)


def _firsts(ranked: Iterable[Candidate]) -> list[Candidate]:
    """The best of each effect and channel."""
    seen: dict[tuple, Candidate] = {}
    for c in ranked:
        seen.setdefault(c.key, c)
    return list(seen.values())
