"""Scores of many candidates under many noises, from products of their whitened columns chain by chain.

What a candidate gains needs no whitened column itself but, of each chain, the columns' squares before and after the
baseline was projected out, their products with the residual and with each other. Chains are independent, so that these
add up over the chains of a candidate; and they depend on the variances of their own chain alone. A search varies one
chain's variances at a time: what it found for the others is kept here, one short line of numbers a column.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from ..candidates.columns import span
from ..candidates.signatures import Term
from ..noise.observation_series import NoiseFit, System
from .score_test import (
    CHUNK,
    fixed_columns,
    is_shown,
    parted,
    Score,
    score_of,
    turned,
    whiten_columns,
)


@dataclass(frozen=True, eq=False)
class _OneChain:
    """The candidates' columns on one chain: those that stand alone first, then the others by number of columns."""

    columns: Float[np.ndarray, "row column"]
    place: Int[np.ndarray, " column"]  # of each column among all candidates'
    singles: int
    # By size: columns, and which terms of it
    several: dict[int, tuple[slice, Int[np.ndarray, " term"]]]


@dataclass(frozen=True, eq=False)
class Sums:
    """What the scores of all candidates are made of, under one set of variances."""

    # Squares before and after the projection, products with the residual
    seen: Float[np.ndarray, "3 column"]
    # By number of columns, of terms with several
    grams: dict[int, Float[np.ndarray, "term size size"]]

    def __add__(self, other: "Sums") -> "Sums":
        grams = {size: gram + other.grams[size] for size, gram in self.grams.items()}
        return Sums(self.seen + other.seen, grams)


@dataclass(frozen=True, eq=False)
class Gains:
    """What all candidates gain under one set of variances."""

    drop: Float[
        np.ndarray, " term"
    ]  # of the sum of squares; minus infinity where the baseline absorbs a candidate
    # By number of columns, of terms with several: as `turned` has it
    turns: dict[int, tuple[Float[np.ndarray, "_ _ _"], Bool[np.ndarray, "_ _"]]]


class ColumnProducts:
    """Candidates beside chosen terms on the rows of one system, to be scored under one noise after the other.

    Those that are scored on all chains together, where the rig's errors couple them, are left out: `together`.
    """

    def __init__(self, system: System, candidates: Sequence[Term], chosen: Sequence[Term]):
        self._system = system
        distinct = list({id(t): t for t in candidates}.values())
        self.terms, self.together = parted(system, distinct)
        self._edges = np.cumsum([0, *(t.size for t in self.terms)])
        sizes = np.diff(self._edges)
        self._of_size = {int(s): np.flatnonzero(sizes == s) for s in np.unique(sizes)}
        number = len(system.chains)
        self.touches = np.zeros((len(self.terms), number), bool)
        for k, t in enumerate(self.terms):
            self.touches[k, list(t.chains)] = True
        self._fixed = [fixed_columns(system, chosen, c) for c in range(number)]
        self._chains = [self._stacked(c) for c in range(number)]
        self._known: dict[tuple[int, bytes], Sums] = {}

    def _stacked(self, c: int) -> _OneChain:
        """The columns on one chain, in the order that `_OneChain` says."""
        parts, places, several, at = [np.zeros((len(self._system.base.observed[c]), 0))], [], {}, 0
        for size, members in self._of_size.items():
            mine = [k for k in members if self.touches[k, c]]
            parts += [self.terms[k].columns[self.terms[k].chains.index(c)] for k in mine]
            places += [self._edges[k] + n for k in mine for n in range(size)]
            width = size * len(mine)
            if size > 1 and mine:
                several[size] = slice(at, at + width), np.searchsorted(members, mine)
            at += width
        singles = at - sum(here.stop - here.start for here, _ in several.values())
        return _OneChain(np.concatenate(parts, axis=1), np.array(places, int), singles, several)

    def sums(self, noise: NoiseFit) -> Sums:
        """Of all candidates under a noise."""
        made = None
        for c, theta in enumerate(noise.theta):
            key = c, theta.tobytes()
            if key not in self._known:
                self._known[key] = self._sums_of(noise, c)
            made = self._known[key] if made is None else made + self._known[key]
        assert made is not None  # a system has a chain
        return made

    def _sums_of(self, noise: NoiseFit, c: int) -> Sums:
        """The part of one chain; zeros for candidates that do not touch it."""
        chain, observed = self._chains[c], self._system.base.observed[c]
        seen = np.zeros((3, self._edges[-1]))
        grams = {
            size: np.zeros((len(members), size, size))
            for size, members in self._of_size.items()
            if size > 1
        }
        if not len(chain.place):
            return Sums(seen, grams)
        base = np.concatenate([observed[:, None], self._fixed[c]], axis=1)
        base = whiten_columns(self._system, noise, c, base)
        q = span(base[:, 1:])
        residual = base[:, 0] - q @ (q.T @ base[:, 0])
        for first in range(0, chain.singles, CHUNK):
            here = slice(first, min(first + CHUNK, chain.singles))
            white = whiten_columns(self._system, noise, c, chain.columns[:, here])
            before = np.einsum("nk,nk->k", white, white)
            inside = q.T @ white
            # The residual is at right angles to the baseline, so that the product needs no projection.
            after = before - np.einsum("nk,nk->k", inside, inside)
            seen[:, chain.place[here]] = before, after, residual @ white
        for size, (here, terms) in chain.several.items():
            white = whiten_columns(self._system, noise, c, chain.columns[:, here])
            before = np.einsum("nk,nk->k", white, white)
            # Directions of a term may nearly coincide: their Gram matrix is no difference of large numbers.
            white -= q @ (q.T @ white)
            after = np.einsum("nk,nk->k", white, white)
            seen[:, chain.place[here]] = before, after, residual @ white
            each = white.T.reshape(len(terms), size, len(white))
            grams[size][terms] = each @ each.transpose(0, 2, 1)
        return Sums(seen, grams)

    def gains(self, sums: Sums) -> Gains:
        """Drop of the sum of squares by each candidate, with the directions that it is in."""
        made, turns = np.full(len(self.terms), -np.inf), {}
        for size, members in self._of_size.items():
            before, after, product = sums.seen[:, self._edges[members][:, None] + np.arange(size)]
            shown = is_shown(before, after)
            if size == 1:
                gain = np.square(product[:, 0]) / np.maximum(after[:, 0], 1e-300)
            else:
                turns[size] = turn, _ = turned(sums.grams[size], after, shown)
                gain = np.square(np.einsum("tcd,tc->td", turn, product)).sum(axis=1)
            made[members] = np.where(shown.any(axis=1), gain, -np.inf)
        return Gains(made, turns)

    def score(self, k: int, sums: Sums, gains: Gains) -> Score:
        """The score of one candidate that shows, without its whitened columns."""
        term, directions = self.terms[k], None
        if term.size > 1:
            turn, good = gains.turns[term.size]
            place = np.searchsorted(self._of_size[term.size], k)
            directions = turn[place][:, good[place]]
        seen = sums.seen[:, self._edges[k] : self._edges[k + 1]]
        found = score_of(term, term.chains, (), seen, directions)
        assert found is not None  # it shows
        return found
