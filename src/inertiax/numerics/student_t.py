"""Draws for importance sampling: a Student t distribution somewhat wider than what it stands for.

**Reference:** Gelman et al., *Bayesian Data Analysis*, 3rd ed., 10.4, for tails that must not be too light.
"""

from dataclasses import dataclass

import numpy as np
import scipy.special
from jaxtyping import Float


WIDTH = 1.3  # standard deviations of the draws in those of what they stand for
TAILS = 5.0  # their degrees of freedom


@dataclass(frozen=True, eq=False)
class HeavyTails:
    """A multivariate Student t distribution."""

    center: Float[np.ndarray, " variable"]
    factor: Float[np.ndarray, "variable variable"]  # lower triangular, of the scale matrix

    @staticmethod
    def around(
        center: Float[np.ndarray, " variable"], covariance: Float[np.ndarray, "variable variable"]
    ) -> "HeavyTails":
        """Around a mean, for a covariance. Raises `numpy.linalg.LinAlgError` where it is not positive definite."""
        return HeavyTails(center, WIDTH * np.linalg.cholesky(covariance))

    def draw(self, count: int, rng: np.random.Generator) -> Float[np.ndarray, "draw variable"]:
        """Independent draws."""
        normal = rng.standard_normal((count, len(self.center)))
        width = np.sqrt(rng.chisquare(TAILS, count) / TAILS)
        return self.center + (normal / width[:, None]) @ self.factor.T

    def log_density(self, values: Float[np.ndarray, "draw variable"]) -> Float[np.ndarray, " draw"]:
        """Logarithm of the density."""
        size = len(self.center)
        square = np.square(np.linalg.solve(self.factor, (values - self.center).T)).sum(axis=0)
        constant = scipy.special.gammaln(0.5 * (TAILS + size)) - scipy.special.gammaln(0.5 * TAILS)
        constant -= 0.5 * size * np.log(np.pi * TAILS) + np.log(np.diag(self.factor)).sum()
        return constant - 0.5 * (TAILS + size) * np.log1p(square / TAILS)
