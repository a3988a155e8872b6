"""Thermal memory: one thermal effect of one form on the channels of a triad, chosen by prediction.

The likelihood lets a random walk follow whatever is slow and judges effects by what is quick in them. A
thermal loop as large as the whole misfit can lose there to a jump near the loop's corner, or to a start-up
transient. But the channels of one package go through the same temperatures: where a thermal effect shows
on two of them beyond the fitted noise, and predicts stretches of time that were left out better than
what the likelihood chose, it is the explanation.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.special
from jaxtyping import Float

from ..candidates.signatures import Term
from ..noise.observation_series import NoiseFit, System
from ..noise.reml import fit_noise, likelihood
from .blocked_cross_validation import columns_of, Foresight, foresights, skill, skills, STRETCHES
from .evidence import Candidate
from .score_test import whiten_system


SURE = 5e-3  # chance on each of two channels that the fitted noise looks like the effect
FORMS = 3  # of an effect that are tried against the fitted noise
BETTER = 6.0  # twice the log odds by which the thermal effect must predict better
LEAST = 0.2  # skill on one channel: errors a fifth smaller


@dataclass(frozen=True, eq=False)
class Remembered:
    """Thermal terms chosen by prediction, one per chain, with the rivals that predict as well."""

    chosen: tuple[Candidate, ...]
    rivals: tuple[tuple[Term, ...], ...]  # for each chosen one
    p_value: float  # of the effect beyond the fitted noise, channels together
    observed: tuple[Foresight, ...]  # by chain

    @property
    def chains(self) -> set[int]:
        """Chains that a thermal effect was chosen on."""
        return {c for one in self.chosen for c in one.term.chains}

    def pays(self, term: Term, beside: Sequence[Term]) -> bool:
        """Whether a further term predicts better beside others, where a thermal effect was chosen.

        A dependence outside the catalogue must gain more than the thermal effect did: only then is more
        unexplained than explained.
        """
        mine = self.chains & set(term.chains)
        if not mine:
            return True
        gain = sum(
            _skill(self.observed[c], [*beside, term], c) - _skill(self.observed[c], beside, c)
            for c in mine
        )
        own = 0.0
        if term.effect is None:
            own = sum(x.evidence for x in self.chosen if not mine.isdisjoint(x.term.chains))
        return STRETCHES * gain > max(0.5 * BETTER, own)


def _skill(one: Foresight, terms: Sequence[Term], chain: int) -> float:
    return skill(one, columns_of(terms, chain))


def remember(
    system: System,
    null: NoiseFit,
    catalogue: Sequence[Term],
    first: Sequence[Term],
    hint: str | None = None,
) -> Remembered | None:
    """The thermal effect that predicts better than the terms `first`, or `None`.

    `hint` is an effect that the device's other triad has shown in this way: it need not prove itself beyond the
    noise again.
    """
    groups = [g for g in _groups(catalogue) if hint in (None, next(iter(g.values())).name)]
    if len(system.chains) < 3 or not groups:
        return None
    observed = foresights(system)
    reached = [max(_skill(one, first, c), 0.0) for c, one in enumerate(observed)]
    found = [_skills_of(groups, one, c) for c, one in enumerate(observed)]
    skills_of = [[float(s[k]) for s in found] for k in range(len(groups))]
    near, least = 0.5 * BETTER / STRETCHES, LEAST if hint is None else 0.0
    # What no group could reach on any choice of channels needs no comparison with other effects.
    hope = [
        sum(max(s - r, 0.0) for s, r in zip(mine, reached) if s > max(least, r - near))
        for mine in skills_of
    ]
    if 2.0 * STRETCHES * max(hope) <= BETTER:
        return None
    # A channel takes part where no other effect predicts it much better.
    others = [_best_other(one, catalogue, c, groups) for c, one in enumerate(observed)]
    taken = [
        [s > max(least, r - near, o - near) for s, r, o in zip(mine, reached, others)]
        for mine in skills_of
    ]
    gains = [
        sum(s - r for s, r, k in zip(mine, reached, which) if k)
        for mine, which in zip(skills_of, taken)
    ]
    best = int(np.argmax(gains))
    if 2.0 * STRETCHES * gains[best] <= BETTER:
        return None
    p = _beyond_noise(system, null, catalogue, groups[best], taken[best])
    if hint is None and p >= SURE**2:
        return None
    return _remembered(system, null, groups, skills_of, taken[best], best, first, observed, p)


def _best_other(
    one: Foresight, catalogue: Sequence[Term], chain: int, groups: Sequence[dict[int, Term]]
) -> float:
    """Greatest skill of an effect of the moment on one chain: of those that `groups` does not hold."""
    thermal = {next(iter(g.values())).name for g in groups}
    slow = [
        t for t in catalogue
        if t.effect is not None and t.effect.slow and t.chains == (chain,) and t.name not in thermal
    ]  # fmt: skip
    return float(skills(one, slow, chain).max(initial=0.0)) if slow else 0.0


def _skills_of(
    groups: Sequence[dict[int, Term]], one: Foresight, chain: int
) -> Float[np.ndarray, " group"]:
    """Skill of each group's term on one chain; 0 where it has none."""
    made = np.zeros(len(groups))
    having = [k for k, g in enumerate(groups) if chain in g]
    if having:
        made[having] = skills(one, [groups[k][chain] for k in having], chain)
    return made


def _beyond_noise(
    system: System,
    null: NoiseFit,
    catalogue: Sequence[Term],
    group: dict[int, Term],
    taken: Sequence[bool],
) -> float:
    """Product of the two smallest chances that a channel's fitted noise looks like the effect, in any form.

    What goes with the input is seen beside the errors of the rig that channels and dwells share: those of a fixture,
    which is mounted anew at each temperature, look like a misalignment that follows it.
    """
    name, chances = next(iter(group.values())).name, []
    for c, used in enumerate(taken):
        if not used:
            continue
        forms = [t for t in catalogue if t.name == name and t.chains == (c,)]
        scores = sorted(whiten_system(system, null, forms).scores, key=lambda s: -s.gain)
        different = len({round(s.gain, 6) for s in scores})
        before = likelihood(system, null, [], c)
        single = [1.0]
        for score in scores[:FORMS]:
            if len(score.chains) > 1:
                single.append(float(scipy.special.chdtrc(score.size, score.gain)))
                continue
            after = fit_noise(system, [score.term], null, [c]).value[c]
            single.append(float(scipy.special.chdtrc(score.size, 2.0 * max(before - after, 0.0))))
        chances.append(min(1.0, different * min(single)))
    first, second = sorted([*chances, 1.0, 1.0])[:2]
    return first * second if first < SURE and second < SURE else 1.0


def _groups(catalogue: Sequence[Term]) -> list[dict[int, Term]]:
    """Thermal terms of one effect in one form, by chain; by channel where all channels share a chain."""
    made: dict[tuple, dict[int, Term]] = {}
    for term in catalogue:
        effect = term.effect
        if effect is None or "temperature" not in effect.requires or len(term.chains) != 1:
            continue
        if effect.common or effect.unit_amplitude:
            continue
        key = (term.name, term.variant.label, term.channels[0] - term.chains[0])
        made.setdefault(key, {})[term.chains[0]] = term
    return list(made.values())


def _remembered(system, null, groups, skills, taken, best, first, observed, p) -> Remembered | None:
    name = next(iter(groups[best].values())).name
    chosen, rivals = [], []
    for c, term in groups[best].items():
        found = whiten_system(system, null, [term]).scores
        if not taken[c] or not found:
            continue
        odds = STRETCHES * skills[best][c]
        chosen.append(Candidate(term, found[0], 2.0 * odds, odds))
        others: dict[str, tuple[float, Term]] = {}
        for group, mine in zip(groups, skills):
            other = group.get(c)
            if other is not None and other.name != name:
                others[other.name] = max(
                    others.get(other.name, (-np.inf, other)),
                    (mine[c], other),
                    key=lambda o: o[0],
                )
        single = [t for t in first if c in t.chains and t.effect is not None and t.name != name]
        others |= {t.name: (_skill(observed[c], [t], c), t) for t in single}
        close = [t for s, t in others.values() if 2.0 * (odds - STRETCHES * s) < BETTER]
        rivals.append(tuple(close))
    return Remembered(tuple(chosen), tuple(rivals), p, tuple(observed)) if chosen else None
