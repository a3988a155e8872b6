"""What may stand beside effects that were chosen already."""

from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np

from ..candidates.signatures import Term
from .evidence import Candidate


MOST_EFFECTS = 3  # on rows of one kind: one channel, or |a|
SAME_COLUMN = 1e-6  # part of a column beyond others' span that is rounding


def full(chosen: Sequence[Candidate], new: Candidate) -> bool:
    """Whether the rows that a candidate acts on have their number of effects already.

    One effect on several channels, such as a lag behind their common probe, is one.
    """
    after = [*(old.key for old in chosen), new.key]
    chains = [*(old.term.chains for old in chosen), new.term.chains]
    mine = [[key for key, on in zip(after, chains) if c in on] for c in new.term.chains]
    return any(causes(keys) > MOST_EFFECTS for keys in mine)


def causes(keys: Sequence[tuple[str, tuple[int, ...]]]) -> int:
    """Number of different effects; one that a channel has twice counts twice."""
    times: dict[str, int] = {}
    for (name, _), count in Counter(keys).items():
        times[name] = max(times.get(name, 0), count)
    return sum(times.values())


def twice(chosen: Sequence[Candidate], new: Candidate) -> bool:
    """Whether a channel would get a second one of an effect that it can only have once, or its opposite beside it."""
    return barred([old.term for old in chosen], new.term)


def barred(chosen: Sequence[Term], new: Term) -> bool:
    """`twice` of terms."""
    effect = new.effect
    if effect is None or not effect.once:
        return False
    mine, names = set(new.channels), (effect.name, effect.opposite)
    return any(old.name in names and mine & {*old.channels} for old in chosen)


def holds(wide: Term, narrow: Term) -> bool:
    """Whether a form of the same effect has another form's columns in its span, so that the two are one.

    All three axes hold each alone; beside one another neither has a size of its own.
    """
    if wide.name != narrow.name or not set(narrow.chains) <= set(wide.chains):
        return False
    for chain, columns in zip(narrow.chains, narrow.columns):
        frame = wide.columns[wide.chains.index(chain)]
        beyond = columns - frame @ np.linalg.lstsq(frame, columns, rcond=None)[0]
        if np.any(np.linalg.norm(beyond, axis=0) > SAME_COLUMN * np.linalg.norm(columns, axis=0)):
            return False
    return True


def among(chosen: Sequence[Candidate], chains: Sequence[int]) -> bool:
    """Whether one of the chosen effects acts on these rows."""
    return any(not set(c.term.chains).isdisjoint(chains) for c in chosen)


def explained_beside(
    chosen: Sequence[Candidate], new: Candidate, parts: Mapping[int, Mapping[int, float]]
) -> float:
    """Drop of the sum of squares by the effects chosen already on the rows that a candidate acts on.

    Without those of the rig and the reference that geometry gives forms, and no course in time: of an angle of 40
    arcsec the linear form leaves a part of 2e-4, and of its drop the square of that.

    **Arguments:** `parts` of each chosen one's gain by chain, by the identity of its term; all counts where they are
    not given.
    """
    total, mine = 0.0, set(new.term.chains)
    for c in chosen:
        if among([c], new.term.chains) and not _geometric(c):
            by_chain = parts.get(id(c.term))
            here = 1.0 if by_chain is None else sum(p for k, p in by_chain.items() if k in mine)
            total += c.score.gain * here
    return float(total)


def _geometric(one: Candidate) -> bool:
    """Whether an effect of the rig or the reference has no form but what geometry gives it."""
    effect = one.term.effect
    return effect is not None and effect.common and effect.driver != "time"
