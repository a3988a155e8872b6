"""How alike samples in motion err, and how many independent ones they are worth."""

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Float


FEWEST = 20  # samples in motion from which their correlation is looked at


class Memory(NamedTuple):
    """Correlation of the magnitude's misfit over samples in motion: `share` · `decay`^h with that h samples on."""

    share: float = 0.0
    decay: float = 0.0

    def applied(self, columns: Float[np.ndarray, "row column"]) -> Float[np.ndarray, "row column"]:
        """R X, where R has ones on its diagonal and the correlations beside it."""
        if self.share == 0.0:
            return columns
        from scipy.signal import (
            lfilter,
        )  # a third of a second to import, for devices with magnetometers alone

        one, recursion = np.ones(1), np.array([1.0, -self.decay])
        before = lfilter(one, recursion, columns, axis=0)
        after = lfilter(one, recursion, columns[::-1], axis=0)[::-1]
        return (1.0 - self.share) * columns + self.share * (before + after - columns)


class Worth(NamedTuple):
    """A memory, and what it makes of samples and unknowns."""

    memory: Memory
    alike: float  # samples that tell what one would whose error is its own, τ
    unknowns: float  # degrees of freedom that the unknowns take


def memory_of(
    relative: Float[np.ndarray, " row"],
    told: Float[np.ndarray, "row unknown"],
    taken: float,
    before: float,
    unknowns: float,
) -> Worth:
    """The memory that misfits of samples in motion show.

    Correlations C_h / C_0 of what is left after the fit are too small: unknowns that samples with a memory tell take
    τ times what they would take of independent ones, σ² τ q κ_h of C_h, with q the unknowns that the samples tell and
    κ_h how alike two of them, h apart, tell them. That is given back. The memory is fitted to the lags before the first
    correlation below 2 sigma of a white series', 1/√n. τ is by how much, on average over the unknowns, a variance is
    larger than of independent samples: Σ R_ij over rows i and j, each pair weighted by how alike the two tell.

    **Arguments:** misfits in their sigmas, in the order of the samples; `told` the samples' rows of J P^½ with a sum of
    squares of one, and `taken` that sum before; τ as it was `before`; the number of `unknowns`.
    """
    count = len(relative)
    if count < FEWEST:
        return Worth(Memory(), 1.0, unknowns)
    lost = min(before * taken, 0.5 * count)
    left = float(relative @ relative)
    whole = left * count / (count - lost)
    seen = []
    for lag in range(1, count // 4 if left > 0.0 else 1):
        given_back = whole / count * lost * float(np.sum(told[:-lag] * told[lag:]))
        correlation = (float(relative[:-lag] @ relative[lag:]) + given_back) / whole
        if correlation < 2.0 / math.sqrt(count):
            break
        seen.append(correlation)
    if not seen:
        return Worth(Memory(), 1.0, unknowns)
    powers = np.geomspace(0.3, 0.99, 40)[:, None] ** np.arange(1, len(seen) + 1)
    shares = np.clip(powers @ seen / np.sum(powers**2, axis=1), 0.0, 1.0)
    apart = np.sum(np.square(seen - shares[:, None] * powers), axis=1)
    best = int(np.argmin(apart))
    memory = Memory(float(shares[best]), float(powers[best, 0]))
    alike = max(float(np.sum(told * memory.applied(told))), 1.0)
    return Worth(memory, alike, unknowns + min((alike - 1.0) * taken, 0.5 * count))
