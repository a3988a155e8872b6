"""The ramp R of a log: a line in time, by generalised least squares on means of blocks.

The differences of block means have under each noise term a covariance known up to the coefficient's square.
"""

import numpy as np
from jaxtyping import Float
from scipy.linalg import solve_toeplitz
from scipy.special import stdtrit

from .model import NoiseTerm
from .stored_channel import blocks_of, Log


_BLOCKS = 256
_RIDGE = 1e-9


def plain_slope(log: Log, rate: float) -> float:
    """Slope of the log by ordinary least squares on block means, a second."""
    length = max(len(log) // _BLOCKS, 1)
    means = _block_means(log, length)
    time = (np.arange(len(means)) - 0.5 * (len(means) - 1)) * (length / rate)
    return float(time @ means / (time @ time))


def slope(
    log: Log, rate: float, squares: Float[np.ndarray, "4"]
) -> tuple[float, Float[np.ndarray, "4"]]:
    """Slope of the log, a second, weighted by the noise found, and its variance per square of each term.

    `squares` are those of Q, N, B and K.
    """
    length = max(len(log) // _BLOCKS, 1)
    means = _block_means(log, length)
    step, count = length / rate, len(means) - 1
    if not np.any(squares):
        squares = np.array([0.0, 1.0, 0.0, 0.0])
    covariance = _block_covariance(count, length, step, squares)
    covariance[0] *= (
        1.0 + _RIDGE
    )  # quantisation alone gives differences whose sums have no variance
    weights = solve_toeplitz(covariance, np.ones(count))
    weights = weights / weights.sum()
    lagged = np.correlate(weights, weights, mode="full")[count - 1 :]
    lagged[1:] *= 2.0
    shares = [lagged @ _block_covariance(count, length, step, one) for one in np.eye(len(squares))]
    return float(weights @ np.diff(means) / step), np.array(shares) / step**2


def _block_means(log: Log, length: int) -> Float[np.ndarray, " block"]:
    """Of the samples whose block is whole."""
    return np.array([b.mean() for b in blocks_of(log, length) if len(b) == length])


def _block_covariance(
    count: int, length: int, step: float, squares: Float[np.ndarray, "4"]
) -> Float[np.ndarray, " lag"]:
    """Autocovariance of the differences of block means `step` seconds long under the four terms."""
    quantisation, white, flicker, walk = squares
    result = np.zeros(max(count, 3))
    result[:3] += quantisation / step**2 * np.array([6.0, -4.0, 1.0])
    result[:2] += white / step * np.array([2.0, -1.0])
    within = 1.0 / (6.0 * length**2)
    result[:2] += walk * step * np.array([2.0 / 3.0 + 2.0 * within, 1.0 / 6.0 - within])
    t = np.abs(np.arange(-2, len(result) + 2).astype(float))
    phase = t**2 * np.log(np.where(t > 0, t, 1.0)) / (2.0 * np.pi)
    fourth = np.convolve(phase, [1.0, -4.0, 6.0, -4.0, 1.0], mode="valid")
    return (result + flicker * fourth)[:count]


def ramp_term(
    found: float,
    shares: Float[np.ndarray, "4"],
    squares: Float[np.ndarray, "4"],
    covariance: Float[np.ndarray, "4 4"],
    possible: Float[np.ndarray, "4"],
) -> NoiseTerm:
    """The slope's size; limits by Student's t, since its variance V = Σ v θ is itself an estimate.

    V rests on few low frequencies where random walk prevails: its degrees of freedom are ν = 2 V² / Var V
    (Satterthwaite), with the `covariance` of the squares θ. For the limits the squares count that are
    `possible`: flicker and walk that were found to be zero, with their 1 sigma.
    """
    variance = float(shares @ possible)
    freedom = 2.0 * variance**2 / max(float(shares @ covariance @ shares), 1e-300)
    wide = float(stdtrit(max(freedom, 1.0), 0.975) * np.sqrt(variance))
    value, std = abs(found), float(np.sqrt(shares @ squares))
    if value <= wide:
        return NoiseTerm(None, None, 0.0, value + wide)
    return NoiseTerm(value, std, value - wide, value + wide)
