"""Expanded uncertainty by the GUM: contributions to a standard uncertainty, effective degrees of freedom, coverage."""

import math
from collections.abc import Sequence

from scipy.special import ndtri, stdtrit


COVERAGE = 0.95  # probability of the two-sided interval


def effective_degrees(stds: Sequence[float], degrees: Sequence[float]) -> float:
    """Degrees of freedom of u = √(Σ uᵢ²) by Welch and Satterthwaite,

        ν = u⁴ / Σ (uᵢ⁴ / νᵢ),

    infinite where all contributions are known exactly or are zero.

    **Arguments:** standard uncertainties uᵢ of independent contributions, in one unit, and their degrees of freedom
    νᵢ > 0 (`inf` for those that are stated). Raises `ValueError` for as many as not.

    **Reference:** JCGM 100:2008 (GUM), G.4.1, equation (G.2b).
    """
    if len(stds) != len(degrees):
        raise ValueError(
            f"`effective_degrees(...)`: {len(stds)} uncertainties but {len(degrees)} degrees of freedom."
        )
    total = math.fsum(u * u for u in stds)
    if total == 0.0:
        return math.inf
    # Shares of the variance, so that no fourth power of a small number underflows.
    spread = math.fsum((u * u / total) ** 2 / nu for u, nu in zip(stds, degrees, strict=True))
    return 1.0 / spread if spread > 0.0 else math.inf


def coverage_factor(degrees: float, probability: float = COVERAGE) -> float:
    """Half-width in standard uncertainties of the two-sided interval that Student's t gives the probability.

    **Reference:** JCGM 100:2008 (GUM), G.3.2; ν is not truncated to an integer.
    """
    return quantile(0.5 * (1.0 + probability), degrees)


def quantile(probability: float, degrees: float) -> float:
    """Below which Student's t lies with a probability; of the normal distribution for infinite degrees of freedom."""
    return float(ndtri(probability) if math.isinf(degrees) else stdtrit(degrees, probability))
