"""What rests tell of parameters so far: a linearised posterior whose noise is not known, in information form.

Rows are linear about the present estimate, $r_k(\\theta) = J_k \\theta - z_k$, with variance $v_k + \\tau^2$: $v_k$ is
what the noise within the rest says, $\\tau$ the scatter between rests, which nobody knows. For each $\\tau$ of a grid

    Λ(τ) = P + Σ J_kᵀ J_k / (v_k + τ²),     θ(τ) = Λ⁻¹ (P θ₀ + Σ J_kᵀ z_k / (v_k + τ²))

and the probability of τ is its prior times the marginal likelihood

    log p(z | τ) = −½ Σ log(v_k + τ²) − ½ Σ r_k² / (v_k + τ²) − ½ (θ − θ₀)ᵀ P (θ − θ₀) − ½ log |Λ|.

The posterior is the mixture over τ: normal for each, with heavier tails than a normal while few rests tell τ (for
v_k = 0 it is Student's). A Bayesian posterior does not depend on why one stopped, so that stopping where it is narrow
does not make intervals too short.

**Reference:** Gelman et al., *Bayesian Data Analysis*, 3rd ed., sections 5.4 (a grid over the scale), 8.2 (ignorable
stopping) and 14.2.
"""

import dataclasses

import numpy as np
from jaxtyping import Float
from scipy.special import ndtr


# Of the grid over the scatter, in units of the rests' usual own noise. A scatter below a tenth of it changes no
# standard deviation by 1 %.
_LEAST, _MOST, _STEPS = 0.1, 1000.0, 41
# Of a rest's own noise: the median of the scatter's prior. `benchmarks/live_hand.py` has scatters from a tenth to three
# times the noise; with 1 the intervals of 95 % held 93 % where both are alike, with 4 they hold 95 %.
USUAL_SCATTER = 4.0
_FLOOR = 1e-7  # m/s² or rad/s: a converter that shows no noise is no perfect one


@dataclasses.dataclass(frozen=True, eq=False)
class Rows:
    """Linear rows about an estimate. All of one kind share one scatter."""

    jacobian: Float[np.ndarray, "row parameter"]
    value: Float[np.ndarray, " row"]  # z
    variance: Float[np.ndarray, " row"]  # of the rest's mean alone


@dataclasses.dataclass(frozen=True, eq=False)
class Posterior:
    """A mixture of normal distributions, one for each scatter τ."""

    weight: Float[np.ndarray, " tau"]  # sums to 1
    scatter: Float[np.ndarray, " tau"]  # τ
    means: Float[np.ndarray, "tau parameter"]
    covariances: Float[np.ndarray, "tau parameter parameter"]
    evidence: float = 0.0  # log p(z), but for a term that all models of the same rows share

    def first(self, count: int) -> "Posterior":
        """The posterior of the first parameters, whatever the others are."""
        inside = self.covariances[:, :count, :count]
        return dataclasses.replace(self, means=self.means[:, :count], covariances=inside)

    @property
    def mean(self) -> Float[np.ndarray, " parameter"]:
        """Of the mixture."""
        return self.weight @ self.means

    @property
    def covariance(self) -> Float[np.ndarray, "parameter parameter"]:
        """Of the mixture: mean of the covariances and covariance of the means."""
        apart = self.means - self.mean
        inside = np.einsum("t,tij->ij", self.weight, self.covariances)
        return inside + np.einsum("t,ti,tj->ij", self.weight, apart, apart)

    @property
    def std(self) -> Float[np.ndarray, " parameter"]:
        """Standard deviations of the mixture."""
        return np.sqrt(np.diagonal(self.covariance))

    @property
    def scatter_variance(self) -> float:
        """Mean of τ²."""
        return float(self.weight @ self.scatter**2)

    def freedom(self, own_variance: float) -> float:
        """Degrees of freedom ν with which a row's variance is known; `own_variance` is that within a rest.

        Those of a scaled inverse χ² distribution of the same coefficient of variation, (2 / (ν − 4))^½.
        """
        variance = max(own_variance, _FLOOR**2) + self.scatter**2
        mean = self.weight @ variance
        spread = self.weight @ (variance / mean - 1.0) ** 2
        return float(4.0 + 2.0 / max(spread, 1e-6))

    def within(self, limits: Float[np.ndarray, " parameter"]) -> float:
        """Probability that the errors of all parameters are below their limits (∞ where nothing is asked).

        Given τ the product of the single probabilities, which is at most the joint one (Šidák 1967, for normal
        distributions about their middle).
        """
        asked = np.isfinite(limits)
        off = (self.means - self.mean)[:, asked]
        deviation = np.sqrt(np.diagonal(self.covariances, axis1=1, axis2=2)[:, asked])
        single = ndtr((limits[asked] - off) / deviation) - ndtr((-limits[asked] - off) / deviation)
        return float(self.weight @ single.prod(axis=1))

    def ratio(self, limits: Float[np.ndarray, " parameter"], confidence: float) -> float:
        """By how much all limits would have to be wider for `within` to be `confidence`; 1 or less: reached."""
        low, high = 1e-6, 1e9
        for _ in range(60):
            middle = np.sqrt(low * high)
            low, high = (
                (low, middle) if self.within(middle * limits) >= confidence else (middle, high)
            )
        return float(high)


def posterior_of(
    rows: Rows,
    prior_mean: Float[np.ndarray, " parameter"],
    prior_std: Float[np.ndarray, " parameter"],
    *,
    own_noise: float | None = None,
) -> Posterior:
    """The posterior of linear rows.

    **Arguments:** `prior_std` are the priors' standard deviations; `own_noise` is the usual noise of a rest, by default
    the median of the rows'. The prior of τ is a half-Cauchy whose median is `USUAL_SCATTER` times that.
    """
    precision = 1.0 / np.square(prior_std)
    usual = own_noise
    if usual is None:
        usual = float(np.sqrt(np.median(rows.variance))) if len(rows.variance) else 1.0
    usual = max(usual, _FLOOR)
    tau = usual * np.append(0.0, np.geomspace(_LEAST, _MOST, _STEPS))
    log_prior = np.log(_cell_widths(tau)) - np.log1p((tau / (USUAL_SCATTER * usual)) ** 2)
    variance = np.maximum(rows.variance, _FLOOR**2)[None, :] + tau[:, None] ** 2
    weighted = rows.jacobian[None] / variance[:, :, None]  # tau row parameter
    information = np.swapaxes(weighted, 1, 2) @ rows.jacobian + np.diag(precision)
    right = weighted.transpose(0, 2, 1) @ rows.value + precision * prior_mean
    covariance = _inverse(information, prior_std)
    means = np.einsum("tij,tj->ti", covariance, right)
    left = means @ rows.jacobian.T - rows.value
    _, log_det = np.linalg.slogdet(information * np.outer(prior_std, prior_std))
    log_weight = (
        log_prior
        - 0.5 * np.log(variance).sum(axis=1)
        - 0.5 * np.sum(left**2 / variance, axis=1)
        - 0.5 * np.sum((means - prior_mean) ** 2 * precision, axis=1)
        - 0.5 * log_det
    )
    weight = np.exp(log_weight - log_weight.max())
    evidence = float(log_weight.max() + np.log(weight.sum()))
    weight /= weight.sum()
    kept = weight > 1e-6
    share = weight[kept] / weight[kept].sum()
    return Posterior(share, tau[kept], means[kept], covariance[kept], evidence)


def _cell_widths(tau: Float[np.ndarray, " tau"]) -> Float[np.ndarray, " tau"]:
    """How much of the axis each grid value stands for (trapezoids)."""
    gaps = np.diff(tau)
    return 0.5 * (np.append(gaps, gaps[-1]) + np.append(gaps[0], gaps))


def _inverse(
    information: Float[np.ndarray, "tau parameter parameter"],
    scale: Float[np.ndarray, " parameter"],
) -> Float[np.ndarray, "tau parameter parameter"]:
    """Inverses, in units of the priors, where they are well conditioned."""
    both = np.outer(scale, scale)
    return np.linalg.inv(information * both) * both
