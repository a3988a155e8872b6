"""Covariances of dwell means, from the scatter within dwells."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Bool, Float, Int

from .._records import field, Module
from .mean_noise import fit_noise_shape, NoiseShape, prior_freedom, quantisation_floor


_SAMPLES_FOR_SHAPE = 1 << 18


class Scatter(Module):
    """Samples of a triad's channels in each dwell, as deviations from what the dwell should read."""

    counts: Int[np.ndarray, " dwell"]  # samples in each dwell
    # Sums over a dwell of products of two channels, unit².
    products: Float[np.ndarray, "dwell channel channel"]
    sloping: Bool[np.ndarray, " dwell"]  # deviations are from a straight line, not only the mean
    step: Float[np.ndarray, "dwell channel"]  # LSB of the converter, 0 where it does not show
    number: Int[np.ndarray, " dwell"]  # of the dwell, as `first` counts them
    # Deviations (row, channel) of the first samples of some dwells: their numbers, and how many of each.
    first: Callable[[np.ndarray, np.ndarray], np.ndarray] = field(static=True)

    @property
    def squares(self) -> Float[np.ndarray, "dwell channel"]:
        """Sums of squares of each channel, unit²."""
        return np.diagonal(self.products, axis1=1, axis2=2)


def covariances_of_means(
    scatter: Scatter, pool: Int[np.ndarray, " dwell"]
) -> Float[np.ndarray, "dwell channel channel"]:
    """Covariance of each dwell's mean, unit²; dwells of one number in `pool` are pooled, as rests are, and plateaus.

    For channel c of dwell k with n samples

        Var = s²_kc τ_c(n) / n + quantisation floor,

    where τ follows from how the samples resemble their neighbours, pooled over dwells
    (`mean_noise.NoiseShape`), and s² is the dwell's own variance drawn towards all dwells' by their
    degrees of freedom (`mean_noise.prior_freedom`), so that no dwell gets a great weight for having
    been quiet by chance. Channels of a triad correlate as they do in all dwells together. A dwell
    of one sample has the pooled variance; where no dwell has two samples nothing is known, and
    the covariances are zero: an estimator then weights the dwells equally and takes the scale
    from its residuals.
    """
    result = np.zeros(scatter.products.shape)
    for number in np.unique(pool):
        group = pool == number
        result[group] = _pooled(select(scatter, group))
    return result


def select(scatter: Scatter, dwells: Bool[np.ndarray, " dwell"]) -> Scatter:
    """That of some dwells."""
    if dwells.all():
        return scatter
    return Scatter(
        scatter.counts[dwells], scatter.products[dwells], scatter.sloping[dwells],
        scatter.step[dwells], scatter.number[dwells], scatter.first,
    )  # fmt: skip


def _pooled(scatter: Scatter) -> Float[np.ndarray, "dwell channel channel"]:
    counts = scatter.counts.astype(float)
    squares = scatter.squares
    factor, left, freedom = (np.ones(squares.shape) for _ in range(3))
    for axis in range(squares.shape[1]):
        shape = _shape(scatter, squares[:, axis], axis)
        factor[:, axis] = shape.mean_factor(counts)
        left[:, axis] = _samples_left(shape, scatter)
        freedom[:, axis] = left[:, axis] / shape.squared_sum
    own = np.all(left > 0.5, axis=1)
    if not own.any() or not squares[own].any():
        return _diagonal(quantisation_floor(scatter.step, np.zeros_like(scatter.step)))
    variance = _shrunk(squares, left, freedom, scatter.step, own)
    of_mean = variance * factor / counts[:, None] + quantisation_floor(scatter.step, variance)
    deviation = np.sqrt(of_mean)
    return deviation[:, :, None] * deviation[:, None, :] * _between_channels(scatter, variance)


def _shape(scatter: Scatter, squares: Float[np.ndarray, " dwell"], axis: int) -> NoiseShape:
    """Pooled over dwells; over a part of them where there are many."""
    counts = scatter.counts
    chosen = np.flatnonzero((counts >= 3) & (squares > 0))
    if not len(chosen):
        return NoiseShape()
    stride = int(np.ceil(counts[chosen].sum() / _SAMPLES_FOR_SHAPE))
    chosen = chosen[:: max(1, min(stride, len(chosen) // 16))]
    kept = np.minimum(counts[chosen], max(_SAMPLES_FOR_SHAPE // len(chosen), 3))
    starts = np.cumsum(kept) - kept
    scale = np.sqrt(squares[chosen] / counts[chosen])
    # A dwell far noisier than the others must not speak for them all. Below that each keeps its own
    # level: dividing by it would hide the slow part of the noise, which is much of that level.
    usual = np.median(scale)
    scale = np.where(scale > 3.0 * usual, scale / usual, 1.0)
    deviations = scatter.first(scatter.number[chosen], kept)[:, axis]
    return fit_noise_shape(deviations / np.repeat(scale, kept), starts)


def _samples_left(shape: NoiseShape, scatter: Scatter) -> Float[np.ndarray, " dwell"]:
    """Σ r² over σ² to be expected: n less what the mean (and the slope) took with it."""
    distinct, which = np.unique(scatter.counts, return_inverse=True)
    by_mean = shape.mean_factor(distinct)
    by_slope = np.array([shape.slope_variance(int(n)) if n > 1 else 0.0 for n in distinct])
    left = scatter.counts - by_mean[which] - scatter.sloping * by_slope[which]
    return np.maximum(left, 0.0)


def _shrunk(
    squares: Float[np.ndarray, "dwell channel"],
    left: Float[np.ndarray, "dwell channel"],
    freedom: Float[np.ndarray, "dwell channel"],
    step: Float[np.ndarray, "dwell channel"],
    own: Bool[np.ndarray, " dwell"],
) -> Float[np.ndarray, "dwell channel"]:
    """Variance of a sample: each dwell's own, weighted with the pooled one."""
    variance = np.maximum(squares / np.maximum(left, 0.5), step**2 / 12.0)
    pooled = (freedom * variance)[own].sum(axis=0) / freedom[own].sum(axis=0)
    variance = np.maximum(variance, 1e-6 * np.where(pooled > 0, pooled, 1.0))
    prior, centre = prior_freedom(np.log(variance[own]), freedom[own])
    if np.isfinite(prior):
        pooled = np.where(pooled > 0, centre, 0.0)
        mixed = (prior * pooled + freedom * variance) / (prior + freedom)
    else:
        mixed = np.broadcast_to(pooled, variance.shape)
    return np.where(own[:, None], mixed, pooled)


def _between_channels(
    scatter: Scatter, variance: Float[np.ndarray, "dwell channel"]
) -> Float[np.ndarray, "channel channel"]:
    """Correlation of the channels at one instant, over all dwells."""
    sigma = np.sqrt(np.maximum(variance, 1e-300))
    products = (scatter.products / (sigma[:, :, None] * sigma[:, None, :])).sum(axis=0)
    scale = np.sqrt(np.maximum(np.diag(products), 1e-300))
    return np.where(np.eye(len(scale)) > 0, 1.0, products / np.outer(scale, scale))


def _diagonal(
    variances: Float[np.ndarray, "dwell channel"],
) -> Float[np.ndarray, "dwell channel channel"]:
    return variances[:, :, None] * np.eye(variances.shape[1])
