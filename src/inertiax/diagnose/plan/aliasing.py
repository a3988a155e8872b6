"""Which effects a plan shows in the same way: overlap of their signatures beside the calibration."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int

from ...effects import Effect
from ..selection.score_test import Score
from .limits import Alias, AliasSet


ALIASED = 0.95  # R² of two projected signatures from which they count as one
OFTEN = 0.5  # part of an effect's forms that another must mimic to stand in one set with it


def mimicry(
    square: Float[np.ndarray, "two one"], first: Sequence[int], second: Sequence[int]
) -> Float[np.ndarray, " form"]:
    """For each form of the first effect the part of its square that the best form of the second explains.

    **Arguments:** squared cosines of all directions of two effects, and the number of directions of each one's forms.
    """
    by_form = np.add.reduceat(square, _starts(second), axis=0)
    best = np.add.reduceat(by_form, _starts(first), axis=1).max(axis=0) / np.array(first)
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
        groups = [[s for s in mine if s.term.name == n] for n in names]
        sizes = [[s.size for s in g] for g in groups]
        turned = [np.concatenate([np.concatenate(s.directions) for s in g], axis=1) for g in groups]
        for i, first in enumerate(names):
            for j in range(i + 1, len(names)):
                square = np.square(turned[j].T @ turned[i])
                one = mimicry(square, sizes[i], sizes[j])
                two = mimicry(square.T, sizes[j], sizes[i])
                overlap = max(float(one.max()), float(two.max()))
                if overlap > ALIASED:
                    share = max(float(np.mean(m > ALIASED)) for m in (one, two))
                    made.append(Alias(", ".join(channel), first, names[j], overlap, share))
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
