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
from dataclasses import replace

import numpy as np
import scipy.special
from jaxtyping import Float

from ...numerics.student_t import HeavyTails
from ..candidates.columns import lengthen
from ..candidates.signatures import Term
from .grouped_filter import groups_of
from .many_variances import grams_under_each, Steps, TOGETHER
from .observation_series import BOUNDS, NoiseFit, System
from .reml import LEARNED, likelihood_inputs
from .state_space import Known, NUM_VARIANCES


SCATTER = 0.5  # between channels of a triad, standard deviation of a log variance
UNLIKE = 1e-3  # chance of one noise for all channels, below which they are left to themselves
TOLD = (
    "{triad}: the channels do not differ in flicker, walk, positioning errors and levels of power cycles by more than "
    "chance makes likely, and two of them told what to expect of the third."
)
FIRST = 256  # draws over all that is possible
ROUNDS = 3  # further ones, each around what was found before
DRAWS = 64  # in each of them for each pair of channels
PAIRS = ((1, 2), (2, 0), (0, 1))
COLUMNS = 4  # columns are padded to a multiple
HIGHEST = 4.0  # log variance over the scale up to which the first round looks
LEAST_WIDTH = 0.15  # standard deviation of a log variance, where few draws of a round are useful


def alike(system: System, noise: NoiseFit, chosen: Sequence[Term] = ()) -> System:
    """The system with each channel's slow noise known from the other two channels.

    `noise` is fitted to the channels beside the `chosen` terms. A system is returned as it is where it has one chain,
    where other units tell its noise, or where the channels are not alike: twice the log likelihood ratio of a noise of
    each channel's own against one for all is chi-square with eight degrees of freedom, and rarer than `UNLIKE`.
    """
    if len(system.chains) != 3 or any(k.precision.any() for k in system.known):
        return system
    units = np.log([s[LEARNED] for s in system.scales])
    logs, told, likely = _told(system, noise, chosen, units)
    if scipy.special.chdtrc(2 * len(LEARNED), evidence_against(likely)) < UNLIKE:
        return system
    known = []
    for c, unit in enumerate(units):
        mean, covariance = _moments(logs, told[c - 1] + told[c - 2])
        center, precision = np.zeros(NUM_VARIANCES), np.zeros((NUM_VARIANCES, NUM_VARIANCES))
        center[LEARNED] = mean - unit
        wide = covariance + SCATTER**2 * np.eye(len(LEARNED))
        precision[np.ix_(LEARNED, LEARNED)] = np.linalg.inv(wide)
        known.append(Known(center, precision))
    # The chains stay the same objects, whose filters are kept.
    return replace(system, known=tuple(known))


def evidence_against(likely: Sequence[Float[np.ndarray, " draw"]]) -> float:
    """Twice the log likelihood ratio of a noise of each channel's own against one for all, over the draws."""
    return 2.0 * float(sum(v.max() for v in likely) - np.sum(likely, axis=0).max())


def _told(
    system: System, noise: NoiseFit, chosen: Sequence[Term], units: np.ndarray
) -> tuple[np.ndarray, list[np.ndarray], list[np.ndarray]]:
    """Log variances (SI), `(draw, 4)`, and of each channel the log weight that its rows give them, and log likelihood.

    The first round of draws covers what is possible, the further ones lie around what was found before for each pair of
    channels. Weights of two channels add up but for the draws' own density, of which each has half. Log likelihoods
    are those of the draws and, at the end, of what was fitted to the channels.
    """
    rng = np.random.default_rng(0)
    low = np.array([BOUNDS[k][0] for k in LEARNED]) + units.mean(axis=0)
    high = HIGHEST + units.mean(axis=0)
    inputs = [likelihood_inputs(system, c, chosen) for c in range(3)]

    def likelihoods(logs):
        return [_log_likelihood(system, noise, c, inputs[c], logs, units[c]) for c in range(3)]

    logs = rng.uniform(low, high, (FIRST, len(LEARNED)))
    fitted = np.array([theta[LEARNED] for theta in noise.theta]) + units
    together = likelihoods(np.concatenate([logs, fitted]))
    likely, at_fitted = ([v[:FIRST] for v in together], [v[FIRST:] for v in together])
    shapes: list[tuple[HeavyTails, float]] = []
    density = np.full(FIRST, np.log(FIRST) - np.log(high - low).sum())
    for _ in range(ROUNDS):
        moments = [_moments(logs, likely[a] + likely[b] - density) for a, b in PAIRS]
        made = [HeavyTails.around(*m) for m in moments]
        drawn = [_drawn(shape, low, high, rng) for shape in made]
        shapes += [(shape, np.log(len(new))) for shape, new in zip(made, drawn)]
        more = np.concatenate(drawn)
        logs = np.concatenate([logs, more])
        likely = [np.concatenate(both) for both in zip(likely, likelihoods(more))]
        parts = [np.full(len(logs), np.log(FIRST) - np.log(high - low).sum())]
        parts += [shape.log_density(logs) + count for shape, count in shapes]
        density = np.logaddexp.reduce(parts)
    told = [v - 0.5 * density for v in likely]
    return logs, told, [np.concatenate(both) for both in zip(likely, at_fitted)]


def _moments(logs: np.ndarray, log_weight: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Weighted mean and covariance; the latter not less than few useful draws can tell."""
    weight = np.exp(log_weight - log_weight.max())
    weight /= weight.sum()
    mean = weight @ logs
    off = logs - mean
    return mean, (weight[:, None] * off).T @ off + LEAST_WIDTH**2 * np.eye(logs.shape[1])


def _drawn(
    shape: HeavyTails, low: np.ndarray, high: np.ndarray, rng: np.random.Generator
) -> np.ndarray:
    """Draws within what is possible, and the center."""
    values = shape.draw(DRAWS, rng)
    inside = ((values > low) & (values < high)).all(axis=1)
    return np.concatenate([values[inside], np.clip(shape.center, low, high)[None]])


def _log_likelihood(
    system: System,
    noise: NoiseFit,
    chain: int,
    inputs: tuple[np.ndarray, ...],
    logs: np.ndarray,
    unit: np.ndarray,
) -> Float[np.ndarray, " draw"]:
    """Restricted log likelihood of one channel's rows at log variances (SI) of its slow noise.

    What was asked before is known: beside each choice the draws are asked of all channels, of which most have not
    changed.
    """
    rest = np.delete(noise.theta[chain], LEARNED)
    asked = rest.tobytes(), inputs[2].tobytes()
    known = groups_of(system.chains[chain]).drawn.setdefault(asked, {})
    fresh = np.array([one.tobytes() not in known for one in logs])
    if fresh.any():
        made = _evaluated(system, noise, chain, inputs, logs[fresh], unit)
        known.update((one.tobytes(), value) for one, value in zip(logs[fresh], made))
    return np.array([known[one.tobytes()] for one in logs])


def _evaluated(
    system: System,
    noise: NoiseFit,
    chain: int,
    inputs: tuple[np.ndarray, ...],
    logs: np.ndarray,
    unit: np.ndarray,
) -> Float[np.ndarray, " draw"]:
    observed, columns, extra = inputs
    rows = np.concatenate([observed[:, None], columns, extra], axis=1)
    # Padded, so that few compiled programs serve the three channels and later campaigns.
    padded = lengthen(rows, -(-rows.shape[1] // COLUMNS) * COLUMNS)
    theta = np.tile(noise.theta[chain], (-(-len(logs) // TOGETHER) * TOGETHER, 1))
    theta[: len(logs), LEARNED] = logs - unit
    variances = np.exp(theta) * system.scales[chain]
    steps = Steps.of(system.longer[chain])
    made = [
        grams_under_each(variances[k : k + TOGETHER], steps, padded)
        for k in range(0, len(variances), TOGETHER)
    ]
    gram = np.concatenate([g for g, _ in made])[: len(logs), : rows.shape[1], : rows.shape[1]]
    logdet = np.concatenate([d for _, d in made])[: len(logs)]
    finite = np.isfinite(gram).all(axis=(1, 2)) & np.isfinite(logdet)
    gram[~finite] = np.eye(rows.shape[1])
    norm = np.sqrt(np.einsum("dkk->dk", gram))[:, 1:]
    scaled = gram[:, 1:, 1:] / (norm[:, :, None] * norm[:, None, :]) + 1e-11 * np.eye(norm.shape[1])
    factor = np.linalg.cholesky(scaled)
    part = np.linalg.solve(factor, (gram[:, 1:, 0] / norm)[:, :, None])[:, :, 0]
    num = columns.shape[1]
    logs_of = np.log(np.einsum("dkk->dk", factor)[:, :num]) + np.log(norm[:, :num])
    square = gram[:, 0, 0] - np.square(part).sum(axis=1)
    return np.where(finite, -0.5 * (logdet + square) - logs_of.sum(axis=1), -np.inf)
