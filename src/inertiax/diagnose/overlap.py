"""Which effects a plan shows in the same way: overlap of their signatures beside the calibration."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int

from ..effects import Effect
from .limits import Alias, AliasSet
from .scores import Score


ALIASED = 0.95  # R² of two projected signatures from which they count as one
OFTEN = 0.5  # part of an effect's forms that another must mimic to stand in one set with it


def mimicry(first: Sequence[Score], second: Sequence[Score]) -> Float[np.ndarray, " form"]:
    """For each form of the first effect the part of its square that the best form of the second explains."""
    one = np.concatenate([np.concatenate(s.directions) for s in first], axis=1)
    two = np.concatenate([np.concatenate(s.directions) for s in second], axis=1)
    sizes = [s.size for s in first]
    square = np.add.reduceat(np.square(two.T @ one), _starts([s.size for s in second]), axis=0)
    best = np.add.reduceat(square, _starts(sizes), axis=1).max(axis=0) / np.array(sizes)
    return np.minimum(best, 1.0)


def _starts(sizes: Sequence[int]) -> Int[np.ndarray, " form"]:
    """First column of each form."""
    return np.cumsum([0, *sizes[:-1]])


def aliases(scores: Sequence[Score]) -> list[Alias]:
    """Pairs of effects of one channel of which at least one form is mimicked."""
    made = []
    for channel in sorted({s.term.channel_names for s in scores}):
        mine = [s for s in scores if s.term.channel_names == channel]
        names = list(dict.fromkeys(s.term.name for s in mine))
        groups = {n: [s for s in mine if s.term.name == n] for n in names}
        for i, first in enumerate(names):
            for second in names[i + 1 :]:
                one = mimicry(groups[first], groups[second])
                two = mimicry(groups[second], groups[first])
                overlap = max(float(one.max()), float(two.max()))
                if overlap > ALIASED:
                    share = max(float(np.mean(m > ALIASED)) for m in (one, two))
                    made.append(Alias(", ".join(channel), first, second, overlap, share))
    return made


def alias_sets(pairs: Sequence[Alias], effects: Sequence[Effect]) -> list[AliasSet]:
    """Pairs that are alike in most of their forms, joined to sets; equal sets of several channels as one."""
    found: dict[tuple[str, ...], dict[str, float]] = {}
    order = {e.name: k for k, e in enumerate(effects)}
    for channel in dict.fromkeys(a.channel for a in pairs):
        mine = [a for a in pairs if a.channel == channel and a.share >= OFTEN]
        for names in _joined([(a.first, a.second) for a in mine]):
            inside = [a.r_squared for a in mine if a.first in names and a.second in names]
            names = tuple(sorted(names, key=lambda n: order.get(n, len(order))))
            found.setdefault(names, {})[channel] = min(inside)
    experiments = {e.name: e.separating for e in effects}
    return [
        AliasSet(
            names,
            tuple(channels),
            min(channels.values()),
            tuple(dict.fromkeys(experiments[n] for n in names if experiments.get(n))),
        )
        for names, channels in found.items()
    ]


def _joined(pairs: Sequence[tuple[str, str]]) -> list[tuple[str, ...]]:
    """Connected names."""
    groups: list[list[str]] = []
    for pair in pairs:
        touched = [g for g in groups if set(g) & set(pair)]
        merged = list(dict.fromkeys([*(n for g in touched for n in g), *pair]))
        groups = [g for g in groups if g not in touched] + [merged]
    return [tuple(g) for g in groups]
