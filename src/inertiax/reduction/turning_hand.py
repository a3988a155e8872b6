"""What rests held by hand are worth along the force: the hand turns gravity across it and trembles to and fro."""

import numpy as np
from jaxtyping import Bool, Float

from .block_length import length_beyond_tremor
from .mean_covariance import covariances_of_means, Scatter, select


# Of the variance along the force to that of the channels (convention): at rest the two agree within a tenth.
_TURNING = 0.5
_ROUNDING = 1e-9  # of an output
_SAMPLES_FOR_LENGTH = 1 << 18  # by which the length of blocks is found


def less_turning(
    covariance: Float[np.ndarray, "dwell 3 3"],
    scatter: Scatter,
    output: Float[np.ndarray, "dwell 3"],
    chosen: Bool[np.ndarray, " dwell"],
) -> Float[np.ndarray, "dwell 3 3"]:
    """The covariances of accelerometers' means, along the force as it is seen along the force, unit².

    **Arguments:** `covariance` is `covariances_of_means` of the `scatter`; `output` is what the accelerometers read in
    each dwell, m/s²; `chosen` are the rests, of which none has a known attitude.

    A hand that turns a little moves gravity across its direction u and, to first order, not along it. Pooled by
    channels, that motion is laid on all directions, and |f|, from which such rests are calibrated, seems to be much
    noisier than it is. With v² the variance of the mean of u·f, from its own samples as a channel's is,

        C' = P C P + min(v², uᵀ C u) u uᵀ,   P = I − u uᵀ.

    A hand also trembles to and fro along the force, of which a mean over seconds has next to nothing: samples are
    joined to blocks that outlast it (`block_length`), and v² is by these. All that is done where v² is below uᵀ C u by
    `_TURNING` in the median rest; noise of an instrument at rest has no such direction, and keeps the covariance of
    its channels.
    """
    length = np.linalg.norm(output, axis=1)
    chosen = chosen & (length > 0.0) & (scatter.counts > 1)
    if not chosen.any():
        return covariance
    u = output / np.where(length > 0.0, length, 1.0)[:, None]
    seen = _beyond_tremor(_along(select(scatter, chosen), u))
    scattered = np.sqrt(seen.products[:, 0, 0] / seen.counts)
    if not np.any(scattered > _ROUNDING * length[chosen]):  # a constant output tells of no hand
        return covariance
    own = covariances_of_means(seen, np.zeros(chosen.sum(), int))[:, 0, 0]
    result = covariance.copy()
    result[chosen] = with_variance_along(covariance[chosen], u[chosen], own)
    return result


def with_variance_along(
    covariance: Float[np.ndarray, "dwell 3 3"],
    u: Float[np.ndarray, "dwell 3"],
    own: Float[np.ndarray, " dwell"],
) -> Float[np.ndarray, "dwell 3 3"]:
    """The covariances with the variances `own` along directions `u`, C' of `less_turning`; as they are where no hand
    turned the rests, by their median. A variance of 0 is not known."""
    pooled = np.einsum("ki,kij,kj->k", u, covariance, u)
    known = own > 0.0
    if not known.any() or not np.median(own[known] / pooled[known]) < _TURNING:
        return covariance
    along = u[:, :, None] * u[:, None, :]
    across = np.eye(3) - along
    least = np.where(known, np.minimum(own, pooled), pooled)
    return across @ covariance @ across + least[:, None, None] * along


def _along(scatter: Scatter, u: Float[np.ndarray, "every 3"]) -> Scatter:
    """The scatter along a direction of each dwell, which `u` has by its number, as that of one channel."""
    mine = u[scatter.number]

    def first(dwells: np.ndarray, kept: np.ndarray) -> np.ndarray:
        return np.sum(scatter.first(dwells, kept) * np.repeat(u[dwells], kept, axis=0), axis=1)[
            :, None
        ]

    return Scatter(
        scatter.counts,
        np.einsum("ki,kij,kj->k", mine, scatter.products, mine)[:, None, None],
        scatter.sloping,
        np.linalg.norm(mine * scatter.step, axis=1)[:, None],
        scatter.number,
        first,
    )  # fmt: skip


def _beyond_tremor(scatter: Scatter) -> Scatter:
    """The scatter of means over blocks in the place of samples, where a tremor makes these scatter too much."""
    counts = scatter.counts
    some = np.minimum(counts, max(_SAMPLES_FOR_LENGTH // len(counts), 1))
    ends = np.cumsum(some)
    drawn = scatter.first(scatter.number, some)
    length = length_beyond_tremor(drawn, ends - some, ends, 1, lasting=True)
    if length == 1:
        return scatter
    samples = scatter.first(scatter.number, counts)
    starts = np.cumsum(counts) - counts
    blocks = np.maximum(counts // length, 1)
    within = np.arange(blocks.sum()) - np.repeat(np.cumsum(blocks) - blocks, blocks)
    first = np.repeat(starts, blocks) + within * length
    total = np.concatenate([np.zeros((1, 1)), np.cumsum(samples, axis=0)])
    means = (total[np.minimum(first + length, len(samples))] - total[first]) / length
    owner = np.repeat(np.arange(len(counts)), blocks)
    squares = np.bincount(owner, means[:, 0] ** 2, len(counts))

    def kept(dwells: np.ndarray, count: np.ndarray) -> np.ndarray:
        begin = (np.cumsum(blocks) - blocks)[dwells]
        return means[np.arange(count.sum()) + np.repeat(begin - np.cumsum(count) + count, count)]

    # Tremor moves a converter's output through its steps.
    none, number = np.zeros_like(scatter.step), np.arange(len(counts))
    return Scatter(blocks, squares[:, None, None], scatter.sloping, none, number, kept)
