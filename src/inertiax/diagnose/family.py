"""How rare the best of a whole family of candidates is by noise alone."""

from collections.abc import Sequence

import numpy as np
import scipy.stats

from .search import Candidate
from .system import Score


def effective_tests(scores: Sequence[Score], lengths: Sequence[int], draws: int = 160) -> float:
    """Number of independent tests with the same smallest p-value as the correlated family.

    White residuals are drawn, and the distribution 1 − (1 − p)^N is fitted to their smallest p-values.
    """
    rng = np.random.default_rng(20240229)
    noise = [rng.standard_normal((n, draws)) for n in lengths]
    smallest = np.ones(draws)
    by_chain: dict[int, list[Score]] = {}
    for score in scores:
        by_chain.setdefault(score.term.chains[0] if len(score.term.chains) == 1 else -1, []).append(
            score
        )
    for c, members in by_chain.items():
        product = np.empty((0, draws))
        if c >= 0:
            white = np.concatenate([s.white[0] for s in members], axis=1)
            product = white.T @ noise[c]
        at = 0
        for s in members:
            if c >= 0:
                width = s.white[0].shape[1]
                part = product[at : at + width]
                at += width
            else:
                part = sum(w.T @ noise[k] for w, k in zip(s.white, s.term.chains))
            gain = np.square(s.turn.T @ part).sum(axis=0)
            smallest = np.minimum(smallest, scipy.stats.chi2.sf(gain, s.size))
    return float(draws / -np.log1p(-np.clip(smallest, 1e-15, 1 - 1e-12)).sum())


def family_p(candidate: Candidate, tests: float) -> float:
    """Chance that the best of the whole family reaches this likelihood ratio by noise alone."""
    single = scipy.stats.chi2.sf(max(candidate.ratio, 0.0), candidate.score.size)
    return float(-np.expm1(tests * np.log1p(-min(single, 1 - 1e-12))))
