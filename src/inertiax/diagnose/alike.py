"""What two channels of a triad tell of the third one's slow noise.

The channels of a triad are of one design and go through one programme, so that flicker, walk, positioning errors and
levels of power cycles are alike. Where few dwells tell a variance, a weak effect passes for a little more of it; the
two other channels then say how much of it there is to be expected. With the restricted likelihoods $L$ of the log
variances $v$, the third channel's are known as a Student t distribution with the mean and the covariance of

$$p(v) \\propto L_a(v)\\,L_b(v), \\qquad \\text{covariance} + s^2 I,$$

where $s$ is the scatter between channels. Moments are taken over weighted draws, since a variance that neither channel
shows is bounded from above alone. White noise, the probe's error and the rig's are left to each channel's own rows:
scatter inside blocks tells the first, and promises bound the others.

**Reference:** Gelman et al., *Bayesian Data Analysis*, 3rd ed., ch. 5 (populations) and 10.4 (importance sampling).
"""

from collections.abc import Sequence

import equinox as eqx
import jax
import numpy as np
import scipy.stats
from jaxtyping import Array, Float

from .._typing import AnyArray
from .system import BOUNDS, NoiseFit, System
from .terms import Term
from .variance_fit import LEARNED, likelihood_inputs
from .whiten import Chain, Known, NUM_VARIANCES, unpack, whiten


SCATTER = 0.5  # between channels of a triad, standard deviation of a log variance
DRAWS = 256  # in each of two rounds
BATCH = 64  # draws evaluated together
HIGHEST = 4.0  # log variance over the scale up to which the first round looks
WIDTH = 1.3  # of the second round's draws, in standard deviations
TAILS = 5.0  # their degrees of freedom
LEAST_WIDTH = 0.15  # standard deviation of a log variance, where few draws of a round are useful


def alike(system: System, noise: NoiseFit, chosen: Sequence[Term] = ()) -> System:
    """The system with each channel's slow noise known from the other two channels.

    `noise` is fitted to the channels beside the `chosen` terms. A system of one chain, or one whose noise is known from
    other units, is returned as it is.
    """
    if len(system.chains) != 3 or any(k.precision.any() for k in system.known):
        return system
    return tied(system, noise, chosen)


def tied(system: System, noise: NoiseFit, chosen: Sequence[Term]) -> System:
    """`alike` anew, whatever was known before."""
    units = np.log([s[LEARNED] for s in system.scales])
    logs, told = _told(system, noise, chosen, units)
    known = []
    for c, unit in enumerate(units):
        mean, covariance = _moments(logs, told[c - 1] + told[c - 2])
        center, precision = np.zeros(NUM_VARIANCES), np.zeros((NUM_VARIANCES, NUM_VARIANCES))
        center[LEARNED] = mean - unit
        wide = covariance + SCATTER**2 * np.eye(len(LEARNED))
        precision[np.ix_(LEARNED, LEARNED)] = np.linalg.inv(wide)
        known.append(Known(center, precision))
    return eqx.tree_at(lambda s: s.known, system, tuple(known))


def _told(
    system: System, noise: NoiseFit, chosen: Sequence[Term], units: np.ndarray
) -> tuple[np.ndarray, list[np.ndarray]]:
    """Log variances (SI), `(draw, 4)`, and of each channel the log weight that its rows give them, as if alone.

    The first round of draws covers what is possible; the second lies around what the first found for each pair of
    channels. Weights of two channels add up but for the draws' own density, of which each has half.
    """
    rng = np.random.default_rng(0)
    low = np.array([BOUNDS[k][0] for k in LEARNED]) + units.mean(axis=0)
    high = HIGHEST + units.mean(axis=0)
    first = rng.uniform(low, high, (DRAWS, len(LEARNED)))
    inputs = [likelihood_inputs(system, c, chosen) for c in range(3)]
    told = [_log_likelihood(system, noise, c, inputs[c], first, units[c]) for c in range(3)]
    shapes = [_moments(first, told[a] + told[b]) for a, b in ((1, 2), (2, 0), (0, 1))]
    second = [_drawn(*shape, low, high, rng) for shape in shapes]
    more = np.concatenate(second)
    logs = np.concatenate([first, more])
    density = [np.full(len(logs), np.log(len(first)) - np.log(high - low).sum())]
    density += [_log_density(logs, *s) + np.log(len(d)) for s, d in zip(shapes, second)]
    half = 0.5 * np.logaddexp.reduce(density)
    more_told = [_log_likelihood(system, noise, c, inputs[c], more, units[c]) for c in range(3)]
    return logs, [np.concatenate(both) - half for both in zip(told, more_told)]


def _moments(logs: np.ndarray, log_weight: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Weighted mean and covariance; the latter not less than few useful draws can tell."""
    weight = np.exp(log_weight - log_weight.max())
    weight /= weight.sum()
    mean = weight @ logs
    off = logs - mean
    return mean, (weight[:, None] * off).T @ off + LEAST_WIDTH**2 * np.eye(logs.shape[1])


def _drawn(
    center: np.ndarray,
    covariance: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    rng: np.random.Generator,
) -> np.ndarray:
    """Heavy-tailed draws within what is possible."""
    normal = rng.standard_normal((DRAWS, len(center)))
    width = np.sqrt(rng.chisquare(TAILS, DRAWS) / TAILS)
    values = center + WIDTH * (normal / width[:, None]) @ np.linalg.cholesky(covariance).T
    inside = ((values > low) & (values < high)).all(axis=1)
    return np.concatenate([values[inside], np.clip(center, low, high)[None]])


def _log_density(values: np.ndarray, center: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Of `_drawn`'s draws, as if none fell outside what is possible."""
    factor = WIDTH * np.linalg.cholesky(covariance)
    return scipy.stats.multivariate_t.logpdf(values, center, factor @ factor.T, df=TAILS)


def _log_likelihood(
    system: System,
    noise: NoiseFit,
    chain: int,
    inputs: tuple[np.ndarray, ...],
    logs: np.ndarray,
    unit: np.ndarray,
) -> Float[np.ndarray, " draw"]:
    """Restricted log likelihood of one channel's rows at log variances (SI) of its slow noise."""
    observed, columns, extra = inputs
    theta = np.tile(noise.theta[chain], (-(-len(logs) // BATCH) * BATCH, 1))
    theta[: len(logs), LEARNED] = logs - unit
    if not extra.any():
        extra = extra[:, :0]
    rows = np.concatenate([observed[:, None], columns, extra], axis=1)
    scale, blocks = system.scales[chain], system.longer[chain]
    made = [
        _filtered(theta[k : k + BATCH], scale, blocks, rows) for k in range(0, len(theta), BATCH)
    ]
    gram = np.concatenate([np.asarray(g) for g, _ in made])[: len(logs)]
    logdet = np.concatenate([np.asarray(d) for _, d in made])[: len(logs)]
    norm = np.sqrt(np.einsum("dkk->dk", gram))
    used = norm[0] > 0.0
    used[0] = False
    gram, norm = (
        gram[:, [0, *np.flatnonzero(used)]][:, :, [0, *np.flatnonzero(used)]],
        norm[:, used],
    )
    scaled = gram[:, 1:, 1:] / (norm[:, :, None] * norm[:, None, :]) + 1e-11 * np.eye(norm.shape[1])
    factor = np.linalg.cholesky(scaled)
    part = np.linalg.solve(factor, (gram[:, 1:, 0] / norm)[:, :, None])[:, :, 0]
    num = np.count_nonzero(used[1 : 1 + columns.shape[1]])
    logs_of = np.log(np.einsum("dkk->dk", factor)[:, :num]) + np.log(norm[:, :num])
    square = gram[:, 0, 0] - np.square(part).sum(axis=1)
    return -0.5 * (logdet + square) - logs_of.sum(axis=1)


@jax.jit
def _filtered(
    thetas: Float[AnyArray, "draw 7"],
    scale: Float[AnyArray, "7"],
    chain: Chain,
    rows: Float[AnyArray, "block column"],
) -> tuple[Float[Array, "draw column column"], Float[Array, " draw"]]:
    """Products of the whitened columns, and log determinants of the noise. No linear algebra of a batch in here."""

    def one(theta):
        white, logdet = whiten(unpack(theta, scale), chain, rows)
        return white.T @ white, logdet

    return jax.vmap(one)(thetas)
