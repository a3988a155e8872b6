"""Errors of the rig that the three channels of a triad share.

A positioning error is a small rotation of the case, and a rate error scales the whole rate:

$$\\delta_d = x \\times \\varepsilon_d + \\rho_d\\, x, \\qquad
\\varepsilon_d \\sim N(0, \\sigma_\\varepsilon^2 I), \\quad \\rho_d \\sim N(0, \\sigma_\\rho^2),$$

with the reading $x$ of an ideal triad in dwell $d$; plateaus of one positioning have one
$\\varepsilon$. Where $x$ lies along an axis the channels' errors are independent
of each other; between the axes they are not, and what two channels say of $\\varepsilon_d$ tells the third one's
error. `numerics.common_errors` has the inverse root of such a covariance.
"""

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float, Int

from ...reduction.room_attitudes import ALIKE
from .state_space import Chain


SHARED = 0.2  # covariance of two channels' errors in a dwell, in the larger variance, from which it counts
MOST = 300  # shared errors that are kept apart; whitening them takes most of the time


@dataclass(frozen=True, eq=False)
class SharedErrors:
    """Signatures of the shared errors on each chain, for one standard deviation as the rig states it."""

    columns: tuple[Float[np.ndarray, "block error"], ...]
    chains: tuple[Chain, ...]  # without the variance that the shared errors stand for, padded
    lasting: bool = (
        False  # whether some last from dwell to dwell, so that each chain alone must know of them
    )
    known: dict = field(default_factory=dict)  # whitened signatures and roots, by the variances

    @property
    def num(self) -> int:
        """Number of shared errors."""
        return self.columns[0].shape[1]


def signatures(
    reading: Float[np.ndarray, "block 3"],
    dwell: Int[np.ndarray, " block"],
    white: Float[np.ndarray, "block 3"],
    angle: Float[np.ndarray, " block"],
    rate: float,
    positioning: Int[np.ndarray, " block"] | None = None,
) -> tuple[Float[np.ndarray, "block 3 error"], Float[np.ndarray, "block 3"]]:
    """Errors of one standard deviation that channels share in a dwell, or dwells in a positioning.

    **Arguments:** `reading` of an ideal triad, m/s² or rad/s; `dwell` numbers each block's rest or plateau; `white` is
    the variance of each block's mean; `angle` rad and `rate` (relative) are the rig's standard deviations, the
    former of what a block's positioning has by itself;
    `positioning` numbers those that several dwells share, −1 elsewhere.

    **Returns** the errors, and of the rig's variance at each block the part that stays each channel's own, NaN where
    all of it does.
    """
    number = np.full(len(dwell), -1) if positioning is None else positioning
    made: list[np.ndarray] = []
    own = np.full(reading.shape, np.nan)

    def add(rows: np.ndarray, errors: list[np.ndarray]) -> None:
        for error in errors:
            column = np.zeros_like(reading)
            column[rows] = error
            made.append(column)

    for group in np.unique(number[number >= 0]):
        rows = np.flatnonzero(number == group)
        add(rows, _turns(reading[rows], float(angle[rows[0]])))
        for plateau in np.unique(dwell[rows]):
            mine = rows[dwell[rows] == plateau]
            both = rate**2 * np.outer(*2 * [reading[mine].mean(axis=0)])
            shared = rate > 0.0 and _couples(both, white[mine])
            own[mine] = 0.0 if shared else np.square(rate * reading[mine])
            add(mine, [rate * reading[mine]] if shared else [])
    for plateau in np.unique(dwell[number < 0]):
        rows = np.flatnonzero(dwell == plateau)
        mean = reading[rows].mean(axis=0)
        both = np.outer(mean, mean)
        covariance = angle[rows[0]] ** 2 * (mean @ mean * np.eye(3) - both) + rate**2 * both
        if not _couples(covariance, white[rows]):
            continue
        own[rows] = 0.0
        add(rows, _turns(reading[rows], float(angle[rows[0]])))
        add(rows, [rate * reading[rows]] if rate > 0.0 else [])
    return np.stack(made, axis=-1) if made else np.zeros((*reading.shape, 0)), own


def _couples(covariance: Float[np.ndarray, "3 3"], white: Float[np.ndarray, "block 3"]) -> bool:
    """Whether what two channels share in a dwell counts beside the variance of its blocks' mean."""
    off = np.abs(covariance - np.diag(np.diag(covariance))).max()
    level = (white.mean(axis=0) / len(white)).max()
    return bool(off > SHARED * (np.diag(covariance).max() + level))


def _turns(
    reading: Float[np.ndarray, "block 3"], angle: float
) -> list[Float[np.ndarray, "block 3"]]:
    """What three angles do to the readings, or the two across their common axis where they have one."""
    size, axes = np.linalg.svd(reading, full_matrices=True)[1:]
    common = len(size) < 2 or size[1] <= ALIKE * size[0]
    return [angle * np.cross(reading, e) for e in axes[1 if common else 0 :]]
