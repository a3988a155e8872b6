"""The restricted likelihood of `state_space` in NumPy, with its slope; a test holds the two forms together."""

import numpy as np
import scipy.linalg
from jaxtyping import Float

from .grouped_filter import filter_of, Gains, gains, gradient, Groups, remember
from .processes import RIG
from .state_space import FREEDOM, Known, STATED, stated_price, WALK


SOFT = 1e-11  # added to the diagonal of the scaled Gram matrix, as in the other form
WHITE_SPREAD = 0.15  # of the white level's logarithm about what the scatter inside blocks tells


class RestrictedLikelihood:
    r"""Minus the logarithm of the restricted likelihood of one chain's log variances, and its slope.

    With the Gram matrix G of the whitened observations $y$ and columns $(X, Z)$, of which X alone enters the
    determinant, and $\beta$ the coefficients that fit y,

    $$\ell = \tfrac12 (\log|V| + G_{yy} - \beta^T G_{\cdot y} + \log|G_{XX}|), \qquad
    2 \frac{\partial \ell}{\partial G} = (1, -\beta)(1, -\beta)^T + G_{XX}^{-1}.$$
    """

    def __init__(
        self,
        groups: Groups,
        scale: Float[np.ndarray, "7"],
        known: Known,
        observed: Float[np.ndarray, " row"],
        columns: Float[np.ndarray, "row column"],
        extra: Float[np.ndarray, "row extra"],
    ):
        self._groups = groups
        self._scale = np.asarray(scale)
        self._known = known
        self._fixed = columns.shape[1]
        self._rows = np.concatenate([observed[:, None], columns, extra], axis=1)
        self._least, self._best = np.inf, None
        self._stated = bool(groups.added[RIG].any() or groups.own[RIG].any())

    def value(self, theta: Float[np.ndarray, "7"]) -> float:
        """Of log variances relative to the scale; infinite where rounding leaves no positive covariance."""
        try:
            found = filter_of(self._groups, np.exp(theta) * self._scale)
            white = found.whiten(self._rows)
            by_gram, _ = self._by_gram(white.T @ white)
        except np.linalg.LinAlgError:
            return np.inf
        return 0.5 * found.log_determinant + by_gram + self._prior(theta)[0]

    def value_and_slope(
        self, theta: Float[np.ndarray, "7"]
    ) -> tuple[float, Float[np.ndarray, "7"]]:
        """The same with the derivative by the log variances."""
        variances = np.exp(theta) * self._scale
        try:
            found = self._filter(variances)
            value, slope = gradient(found, self._rows, self._by_gram)
        except np.linalg.LinAlgError:
            return np.inf, np.zeros(len(theta))
        prior, its_slope = self._prior(theta)
        if value + prior < self._least:
            self._least, self._best = value + prior, (variances, found)
        return value + prior, slope * variances + its_slope

    def _filter(self, variances: Float[np.ndarray, "7"]) -> Gains:
        """One that is kept, or a new one. Where a search begins is kept: others begin there beside other columns."""
        found = self._groups.known.get(variances.tobytes())
        if found is None:
            found = gains(self._groups, variances)
            if self._best is None:
                remember(variances, found)
        return found

    def keep_best(self) -> None:
        """Keep the filter of the likeliest variances whose slope was asked for: what follows a search begins there."""
        if self._best is not None:
            remember(*self._best)

    def _by_gram(
        self, gram: Float[np.ndarray, "column column"]
    ) -> tuple[float, Float[np.ndarray, "column column"]]:
        """What of the likelihood the Gram matrix makes, and its derivative. Raises `numpy.linalg.LinAlgError`."""
        fixed = self._fixed
        # Normed to a unit diagonal.
        norm = np.sqrt(gram.diagonal()[1:])
        scaled = gram[1:, 1:] / (norm[:, None] * norm) + SOFT * np.eye(len(norm))
        factor = np.linalg.cholesky(scaled)
        solve = lambda b: scipy.linalg.cho_solve((factor, True), b, check_finite=False)
        beta = solve(gram[1:, 0] / norm) / norm
        logs = np.log(factor.diagonal()[:fixed]) + np.log(norm[:fixed])
        value = 0.5 * float(gram[0, 0] - beta @ gram[1:, 0]) + float(logs.sum())
        contrast = np.r_[1.0, -beta]
        by = 0.5 * np.outer(contrast, contrast)
        inner = scipy.linalg.cho_solve(
            (factor[:fixed, :fixed], True), np.eye(fixed), check_finite=False
        )
        by[1 : fixed + 1, 1 : fixed + 1] += 0.5 * inner / (norm[:fixed, None] * norm[:fixed])
        return value, by

    def _prior(self, theta: Float[np.ndarray, "7"]) -> tuple[float, Float[np.ndarray, "7"]]:
        """Half of what `negative_log_likelihood` adds for what is known beforehand, and its slope."""
        slope = np.zeros(len(theta))
        part = theta[0] / WHITE_SPREAD
        value = np.log1p(part**2)
        slope[0] = 2.0 * part / (1.0 + part**2) / WHITE_SPREAD
        value += 0.5 * WALK * np.logaddexp(0.0, theta[2] + 3.0)
        slope[2] = 0.5 * WALK / (1.0 + np.exp(-(theta[2] + 3.0)))
        if self._stated:
            value += 0.5 * stated_price(float(theta[RIG]))
            slope[RIG] += 0.5 * STATED * (1.0 - np.exp(-theta[RIG]))
        precision = np.asarray(self._known.precision)
        if precision.any():
            off = theta - np.asarray(self._known.center)
            told = np.count_nonzero(precision.diagonal() > 0.0)
            square = float(off @ precision @ off) / FREEDOM
            value += 0.5 * (FREEDOM + told) * np.log1p(square)
            slope += (FREEDOM + told) / (1.0 + square) / FREEDOM * (precision @ off)
        return float(value), slope
