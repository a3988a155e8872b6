"""Values and 95 % limits of the noise terms, from the profile of the likelihood.

A term that the log does not show has no value, only an upper limit: it could be there, and it could be zero.
"""

import dataclasses
from collections.abc import Callable
from functools import cache
from typing import cast, NamedTuple

import numpy as np
from jaxtyping import Int
from scipy.optimize import brentq
from scipy.special import chdtri

from .likelihood import deviance, Fit, maximum_likelihood, Problem, variance
from .model import NoiseTerm


LIMIT = float(chdtri(1.0, 0.05))  # of the deviance, 95 % on both sides
# Of the deviance at zero: a term that is not there passes it in 1 % of the logs, half of the χ² law being at zero.
SHOWN = float(chdtri(1.0, 0.02))
_DOUBLINGS = 60
_NEAR = 3e-3  # of a standard deviation, to which a limit is found


class _Profile(NamedTuple):
    """The least deviance of a problem as a function of one term's square."""

    problem: Problem
    fit: Fit  # the likeliest model
    which: int
    variance: float  # of the square
    dulling: float  # by how much the ordinates' correlation dulls the likelihood

    @property
    def coefficient(self) -> float:
        """Of the likeliest model."""
        return float(np.sqrt(self.fit.squares[self.which]))

    def excess(self, candidate: float) -> float:
        """How far the deviance lies above its least, in undulled units."""
        if candidate == self.fit.squares[self.which]:
            return 0.0
        held = maximum_likelihood(self.problem, start=self.fit, held=(self.which, candidate))
        return (deviance(self.problem, held.model) - self.fit.deviance) / self.dulling


def terms_of(
    problem: Problem, fit: Fit, names: tuple[str, ...], widening: float = 1.0
) -> dict[str, NoiseTerm]:
    """The random terms of a problem whose likeliest model is `fit`.

    A term that is absent is still estimated as zero or more, never less, and what it takes is missing
    in the others: limits from a fit with all terms alone would be too low. So they are joined with those of a
    fit without the terms that the log can do without. `widening` multiplies the variances where the model fails.
    """

    @cache
    def profiles(terms: tuple[int, ...]) -> dict[int, _Profile]:
        """Of the fit with these terms alone."""
        return dict(zip(terms, _profiles(problem, fit, np.array(terms), widening), strict=True))

    @cache
    def rise(terms: tuple[int, ...], without: int) -> float:
        """Of the deviance, where one more is left out."""
        return profiles(terms)[without].excess(0.0)

    every = tuple(range(len(names)))
    fewest = profiles(_needed(every, None, rise))
    found = {}
    for which, name in enumerate(names):
        term = _term(profiles(every)[which])
        needed = _needed(every, which, rise)
        if needed != every:
            other = _term(profiles(needed)[which])
            lower, upper = min(term.lower, other.lower), max(term.upper, other.upper)
            best = other if term.shown and other.shown else term
            term = NoiseTerm(best.value, best.std, lower, upper)
        least = fewest[which].coefficient if which in fewest else 0.0
        found[name] = dataclasses.replace(term, least=least)
    return found


def _needed(
    terms: tuple[int, ...], which: int | None, rise: Callable[[tuple[int, ...], int], float]
) -> tuple[int, ...]:
    """The terms that the log needs, beside a given one, which stays; the weakest of the others is dropped first.

    One by one, since a log may need one of two terms without telling which: without both it is not described.
    """
    while len(terms) > 1:
        rises = {term: rise(terms, term) for term in terms if term != which}
        weakest = min(rises, key=rises.__getitem__)
        if rises[weakest] > SHOWN:
            break
        terms = tuple(term for term in terms if term != weakest)
    return terms


def _profiles(
    problem: Problem, fit: Fit, terms: Int[np.ndarray, " term"], widening: float
) -> list[_Profile]:
    """The terms' profiles where the problem has no others."""
    if len(terms) < len(fit.squares):
        problem = problem.with_terms(terms)
        start = Fit(fit.squares[terms], fit.filter, fit.model, fit.deviance)
        fit = maximum_likelihood(problem, start=start)
    made = []
    for which in range(len(terms)):
        right, naive = variance(problem, fit, which)
        made.append(_Profile(problem, fit, which, right * widening, right * widening / naive))
    return made


def _term(profile: _Profile) -> NoiseTerm:
    """A coefficient with the limits at which the profile of the likelihood falls by its 95 % point."""
    square, std = float(profile.fit.squares[profile.which]), float(np.sqrt(profile.variance))
    beyond = lambda candidate: profile.excess(candidate) - LIMIT
    upper = float(np.sqrt(_upper(beyond, square, square + np.sqrt(LIMIT) * std)))
    if profile.excess(0.0) <= SHOWN:
        return NoiseTerm(None, None, 0.0, upper)
    lower = cast(float, brentq(beyond, 0.0, square, xtol=_NEAR * std))
    value = profile.coefficient
    return NoiseTerm(value, std / (2.0 * value), float(np.sqrt(lower)), upper)


def _upper(beyond: Callable[[float], float], inside: float, outside: float) -> float:
    """Where a profile's excess turns positive above `inside`; infinity where it never does."""
    step = outside - inside
    for _ in range(_DOUBLINGS):
        if beyond(outside) > 0.0:
            return cast(float, brentq(beyond, inside, outside, xtol=_NEAR * step))
        inside, outside = outside, inside + 2.0 * (outside - inside)
    return float("inf")
