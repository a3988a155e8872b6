"""Held-out proof: what the effect predicts on data that its coefficients were not fitted to."""

from collections.abc import Sequence

import numpy as np

from .engine import Prepared
from .system import NoiseFit
from .terms import Term


FOLDS = 5
CHUNKS = 40


def folds(prepared: Prepared) -> np.ndarray:
    """Fold of each block: contiguous stretches of whole dwells, dealt out in turn.

    Neighbouring samples stay together, so that slow noise does not leak from one side to the other.
    """
    blocks = prepared.blocks
    if len(np.unique(blocks.dwell)) >= 2 * FOLDS:
        order = np.unique(blocks.dwell, return_inverse=True)[1]
    else:
        order = np.arange(blocks.num_blocks)
    chunk = (order * CHUNKS) // (order.max() + 1)
    return chunk % FOLDS


def held_out_rms(prepared: Prepared, noise: NoiseFit, chosen: Sequence[Term]) -> float:
    """Root mean square of the rows of every fold predicted from the others, SI."""
    fold = folds(prepared)
    system = prepared.system
    square, number = 0.0, 0
    for c, chain in enumerate(system.chains):
        mine = [t.columns[t.chains.index(c)] for t in chosen if c in t.chains]
        x = np.concatenate([system.frames[c], *mine], axis=1)
        x = x / (np.linalg.norm(x, axis=0) + 1e-300)
        y = system.base.observed[c]
        w = 1.0 / np.sqrt(chain.white)
        for k in range(FOLDS):
            train = fold != k
            solution = np.linalg.lstsq(x[train] * w[train, None], y[train] * w[train], rcond=1e-9)[
                0
            ]
            left = y[~train] - x[~train] @ solution
            square += float(left @ left)
            number += len(left)
    return float(np.sqrt(square / max(number, 1)))


def in_sample(prepared: Prepared, noise: NoiseFit, chosen: Sequence[Term]) -> tuple[float, float]:
    """Root mean square of the rows (SI) by least squares, and chi² per degree of freedom under the noise."""
    from .scores import whiten_system

    system = prepared.system
    square, number = 0.0, 0
    for c, chain in enumerate(system.chains):
        mine = [t.columns[t.chains.index(c)] for t in chosen if c in t.chains]
        x = np.concatenate([system.frames[c], *mine], axis=1)
        x = x / (np.linalg.norm(x, axis=0) + 1e-300)
        w = 1.0 / np.sqrt(chain.white)
        y = system.base.observed[c]
        left = y - x @ np.linalg.lstsq(x * w[:, None], y * w, rcond=1e-9)[0]
        square += float(left @ left)
        number += len(left)
    white = whiten_system(system, noise, [], chosen)
    return float(np.sqrt(square / number)), white.chi2 / max(white.dof, 1)
