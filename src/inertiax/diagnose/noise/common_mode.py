"""Errors of the rig that the three channels of a triad share.

A positioning error is a small rotation of the case, and a rate error scales the whole rate:

$$\\delta_d = x \\times \\varepsilon_d + \\rho_d\\, x, \\qquad
\\varepsilon_d \\sim N(0, \\sigma_\\varepsilon^2 I), \\quad \\rho_d \\sim N(0, \\sigma_\\rho^2),$$

with the reading $x$ of an ideal triad in dwell $d$. Where $x$ lies along an axis the channels' errors are independent
of each other; between the axes they are not, and what two channels say of $\\varepsilon_d$ tells the third one's
error. With the whitened signatures $U$ of the shared errors the whitened rows have covariance $I + U U^T$, whose
inverse root is

$$S = I - F F^T, \\qquad F = U W \\,\\mathrm{diag}\\Big(\\frac{1 - (1 + \\lambda)^{-1/2}}{\\lambda}\\Big)^{1/2}, \\qquad
U^T U = W \\,\\mathrm{diag}(\\lambda)\\, W^T.$$
"""

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from .state_space import Chain


SHARED = 0.2  # covariance of two channels' errors in a dwell, in the larger variance, from which it counts
MOST = 300  # shared errors that are kept apart; whitening them takes most of the time


@dataclass(frozen=True, eq=False)
class SharedErrors:
    """Signatures of the shared errors on each chain, for one standard deviation as the rig states it."""

    columns: tuple[Float[np.ndarray, "block error"], ...]
    chains: tuple[Chain, ...]  # without the variance that the shared errors stand for, padded
    known: dict = field(default_factory=dict)  # whitened signatures and roots, by the variances

    @property
    def num(self) -> int:
        """Number of shared errors."""
        return self.columns[0].shape[1]


def root(whitened: Float[np.ndarray, "row error"]) -> Float[np.ndarray, "row error"]:
    """`F` of the module's formula: rows `a` with covariance `I + U Uᵀ` become white as `a − F (Fᵀ a)`."""
    value, vector = np.linalg.eigh(whitened.T @ whitened)
    value = np.maximum(value, 0.0)
    small = value < 1e-8  # the limit of the factor is one half
    factor = np.where(small, 0.5, (1.0 - 1.0 / np.sqrt(1.0 + value)) / np.where(small, 1.0, value))
    return whitened @ (vector * np.sqrt(factor))


def signatures(
    reading: Float[np.ndarray, "block 3"],
    dwell: np.ndarray,
    white: Float[np.ndarray, "block 3"],
    angle: float,
    rate: float,
) -> tuple[Float[np.ndarray, "block 3 error"], np.ndarray]:
    """Errors of one standard deviation in the dwells where channels share them, and which blocks those are.

    **Arguments:** `reading` of an ideal triad, m/s² or rad/s; `dwell` numbers each block's positioning; `white` is
    the variance of each block's mean; `angle` rad and `rate` (relative) are the rig's standard deviations.
    """
    made, shared = [], np.zeros(len(dwell), bool)
    for number in np.unique(dwell):
        rows = np.flatnonzero(dwell == number)
        mean = reading[rows].mean(axis=0)
        square = mean @ mean
        both = np.outer(mean, mean)
        covariance = angle**2 * (square * np.eye(3) - both) + rate**2 * both
        off = np.abs(covariance - np.diag(np.diag(covariance))).max()
        level = (white[rows].mean(axis=0) / len(rows)).max()
        if off <= SHARED * (np.diag(covariance).max() + level):
            continue
        shared[rows] = True
        across = np.linalg.svd(mean[None])[2][1:]  # two directions that the reading does not lie in
        errors = [angle * np.cross(reading[rows], e) for e in across]
        errors += [rate * reading[rows]] if rate > 0.0 else []
        for error in errors:
            column = np.zeros_like(reading)
            column[rows] = error
            made.append(column)
    return np.stack(made, axis=-1) if made else np.zeros((*reading.shape, 0)), shared
