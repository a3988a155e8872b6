"""Values and 95 % limits of the noise terms, from the profile of the likelihood.

A term that the log does not show has no value, only an upper limit: it could be there, and it could be zero.
"""

from collections.abc import Callable
from typing import cast

import numpy as np
from scipy.optimize import brentq
from scipy.special import chdtri

from .likelihood import deviance, Fit, maximum_likelihood, Problem, variances
from .model import NoiseTerm


LIMIT = float(chdtri(1.0, 0.05))  # of the deviance, 95 % on both sides
# Of the deviance at zero: a term that is not there passes it in 1 % of the logs, half of the χ² law being at zero.
SHOWN = float(chdtri(1.0, 0.02))
_DOUBLINGS = 60
_NEAR = 3e-3  # of a standard deviation, to which a limit is found


def terms_of(
    problem: Problem, fit: Fit, names: tuple[str, ...], widening: float = 1.0
) -> dict[str, NoiseTerm]:
    """The random terms of a problem whose likeliest model is `fit`.

    A term that is absent is still estimated as zero or more, never less, and what it takes is missing
    in the others: limits from a fit with all terms alone would be too low. So they are joined with those of a
    fit without the terms that do not show. `widening` multiplies the variances where the model fails.
    """
    every = _limited(problem, fit, widening)
    shown = np.array([term.shown for term in every])
    if shown.any() and not shown.all():
        fewer = problem.with_terms(shown)
        part = Fit(fit.squares[shown], fit.filter, fit.model, fit.deviance)
        alone = _limited(fewer, maximum_likelihood(fewer, start=part), widening)
        for k, other in zip(np.flatnonzero(shown), alone, strict=True):
            lower, upper = min(every[k].lower, other.lower), max(every[k].upper, other.upper)
            every[k] = NoiseTerm(other.value, other.std, lower, upper)
    return dict(zip(names, every, strict=True))


def _limited(problem: Problem, fit: Fit, widening: float) -> list[NoiseTerm]:
    right, naive = variances(problem, fit)
    return [
        _term(problem, fit, k, float(right[k]) * widening, float(naive[k]))
        for k in range(len(fit.squares))
    ]


def _term(problem: Problem, fit: Fit, which: int, variance: float, naive: float) -> NoiseTerm:
    """A coefficient with the limits at which the profile of the likelihood falls by its 95 % point.

    `variance / naive` is by how much the ordinates' correlation dulls the likelihood.
    """
    square, std = float(fit.squares[which]), float(np.sqrt(variance))
    dulling = variance / naive

    def excess(candidate: float) -> float:
        """How far the deviance lies above its least, in undulled units."""
        held = maximum_likelihood(problem, start=fit, held=(which, candidate))
        return (deviance(problem, held.model) - fit.deviance) / dulling

    at_zero = excess(0.0) if square > 0.0 else 0.0
    beyond = lambda candidate: excess(candidate) - LIMIT
    far = square + np.sqrt(LIMIT) * std
    if at_zero <= SHOWN:
        return NoiseTerm(None, None, 0.0, float(np.sqrt(_upper(beyond, square, far))))
    lower = cast(float, brentq(beyond, 0.0, square, xtol=_NEAR * std))
    value = float(np.sqrt(square))
    upper = _upper(beyond, square, far)
    return NoiseTerm(value, std / (2.0 * value), float(np.sqrt(lower)), float(np.sqrt(upper)))


def _upper(beyond: Callable[[float], float], inside: float, outside: float) -> float:
    """Where a profile's excess turns positive above `inside`; infinity where it never does."""
    step = outside - inside
    for _ in range(_DOUBLINGS):
        if beyond(outside) > 0.0:
            return cast(float, brentq(beyond, inside, outside, xtol=_NEAR * step))
        inside, outside = outside, inside + 2.0 * (outside - inside)
    return float("inf")
