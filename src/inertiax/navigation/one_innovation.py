"""A sum of independent Gauss-Markov processes of one variance, made by one normal number a sample.

Sampled at intervals h, with λ_i = h/T_i, processes of variance 1 and time constants T_i add up to the spectrum

    S(ω) = Σ sinh λ_i / (cosh λ_i − cos ω).

It is zero where cos ω = cosh μ_j, with one μ_j between each two neighbours of λ, so that S = |H|² with

    H(z) = g Π (1 − e^{−μ_j}/z) / Π (1 − e^{−λ_i}/z) = Σ r_i / (1 − e^{−λ_i}/z).

So x_i ← e^{−λ_i} x_i + r_i w with one w for all makes the same Gaussian process as noise of its own for each x_i: both
have the autocovariance Σ e^{−λ_i |k|}. All r_i have one sign, so that nothing cancels in Σ x_i.

**Reference:** Anderson and Moore, *Optimal Filtering*, Prentice-Hall 1979, ch. 9 (spectral factorisation).
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float


HALVINGS = 60  # of an interval of log μ


class OneInnovation(NamedTuple):
    """The filter of a sum of processes; its output is the sum of its states after a sample."""

    decay: Float[np.ndarray, " processes"]  # 1 − e^{−λ_i}, which rounding would lose in e^{−λ_i}
    drive: Float[np.ndarray, " processes"]  # r_i
    # Cholesky factor of the states' covariance in equilibrium, r_i r_j / (1 − e^{−λ_i−λ_j}).
    start: Float[np.ndarray, "processes processes"]


def one_innovation(rates: Float[np.ndarray, " processes"]) -> OneInnovation:
    """The filter for λ_i = h/T_i, which must decrease."""
    apart = lambda x, y: np.sinh(0.5 * (x + y)) * np.sinh(0.5 * (x - y))  # (cosh x − cosh y)/2
    # S rises from −∞ to ∞ from each rate to the next greater one.
    low, high = np.log(rates[1:]), np.log(rates[:-1])
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        above = (np.sinh(rates) / apart(rates, np.exp(middle)[:, None])).sum(axis=1) > 0.0
        low, high = np.where(above, low, middle), np.where(above, middle, high)
    zeros = np.exp(0.5 * (low + high))
    others = ~np.eye(len(rates), dtype=bool)
    drive = np.array(
        [
            np.expm1(own - zeros).prod() / np.expm1(own - rates[rest]).prod()
            for own, rest in zip(rates, others)
        ]
    )
    covariance = np.outer(drive, drive) / -np.expm1(-np.add.outer(rates, rates))
    scale = np.sqrt(
        len(rates) / covariance.sum()
    )  # the sum's variance is that of as many processes
    return OneInnovation(-np.expm1(-rates), scale * drive, scale * np.linalg.cholesky(covariance))
