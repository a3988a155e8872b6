"""Held-out proof: what the effect predicts on data that its coefficients were not fitted to."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Int

from ..candidates.columns import span
from ..candidates.signatures import Term
from ..noise.observation_series import NoiseFit
from ..noise.state_space import Chain
from ..problem import Prepared


FOLDS = 5
CHUNKS = 40  # stretches at first
# Part of what all rows tell of a coefficient that the others must tell for a prediction from them. Of n rows whose
# squared error is s, a coefficient told by the part p adds at most s (1 - p) / p: 9 of hundreds of rows.
TOLD_BY_OTHERS = 0.1


def folds(prepared: Prepared) -> np.ndarray:
    """Fold of each block: contiguous stretches of whole dwells, dealt out in turn.

    Neighbouring samples stay together, so that slow noise does not leak from one side to the other. The stretches are
    as long as they can be while the others still tell every parameter of the model: where one stretch alone shows a
    scale factor at the coldest plateau, its prediction from the others would be anything.
    """
    order = _pieces(prepared)
    count = int(order.max()) + 1
    chunks = min(CHUNKS, count)
    fold = order * chunks // count % FOLDS
    told = _least_told(prepared, fold)
    while told < TOLD_BY_OTHERS and chunks < count:
        chunks = min(2 * chunks, count)
        finer = order * chunks // count % FOLDS
        fold, told = max((fold, told), (finer, _least_told(prepared, finer)), key=lambda f: f[1])
    return fold


def _pieces(prepared: Prepared) -> np.ndarray:
    """Number of the piece that each block is in, and that is never cut: a dwell, or a block where dwells are few."""
    blocks = prepared.blocks
    if len(np.unique(blocks.dwell)) >= 2 * FOLDS:
        return np.unique(blocks.dwell, return_inverse=True)[1]
    return np.arange(blocks.num_blocks)


def _least_told(prepared: Prepared, fold: np.ndarray) -> float:
    """Least part of the information on any combination of the model's parameters that is left without one fold."""
    least = 1.0
    for frame, chain in zip(prepared.system.frames, prepared.system.chains):
        basis = span(frame / np.sqrt(chain.white)[:, None])
        for k in range(FOLDS):
            left = basis[fold != k]
            least = min(least, float(np.linalg.eigvalsh(left.T @ left)[0]))
    return least


def predict_rest(
    model: Float[np.ndarray, "row parameter"],
    effects: Float[np.ndarray, "row coefficient"],
    observed: Float[np.ndarray, " row"],
    variance: Float[np.ndarray, " row"],
    known: Bool[np.ndarray, " row"],
) -> Float[np.ndarray, " rest"]:
    """Predict the rows that are not `known` from those that are.

    Weighted least squares, in which an effect has no part where the known rows hardly tell its coefficient: of a
    warm-up nothing is known without the minutes that show it, and a coefficient fitted to what its tail leaves in the
    rest would be anything. With the model's columns projected out, the effects' information on all rows is $A$ and on
    the known ones $B$; in directions with $B v = \\lambda A v$ and $\\lambda < 0.1$ coefficients are zero, each counted
    in units of what it changes in the rows.

    **Arguments:** columns of the model and of the effects (per unit of their coefficients), SI, and the variance of
    each row. **Returns** the predicted rows, in their order.
    """
    weight = 1.0 / np.sqrt(variance)
    return _predicted(_predictors(model, effects, weight, known), observed, weight, known)


def _predicted(
    columns: np.ndarray, observed: np.ndarray, weight: np.ndarray, known: np.ndarray
) -> Float[np.ndarray, " rest"]:
    weighted = columns[known] * weight[known, None]
    solution = np.linalg.lstsq(weighted, observed[known] * weight[known], rcond=1e-9)[0]
    return columns[~known] @ solution


def _predictors(
    model: np.ndarray, effects: np.ndarray, weight: np.ndarray, known: np.ndarray
) -> Float[np.ndarray, "row column"]:
    """Columns of the model, and of what the known rows tell of the effects, of norm one."""
    model = model / (np.linalg.norm(model, axis=0) + 1e-300)
    told = effects @ _told(model * weight[:, None], effects * weight[:, None], known)
    return np.concatenate([model, told / (np.linalg.norm(told, axis=0) + 1e-300)], axis=1)


def reach(
    columns: Float[np.ndarray, "piece column"], known: Bool[np.ndarray, " piece"]
) -> Float[np.ndarray, " piece"]:
    r"""How uncertain a prediction is beside a single observation: $1 + x^T (X^T X)^{-1} x$, X the known pieces.

    The variance of an error of prediction in units of that of one piece, where pieces are alike. Six rests tell nine
    parameters badly, and what they say of a seventh far from them may be anything: its error then proves little.
    """
    solved = np.linalg.pinv(columns[known], rcond=1e-9)
    return 1.0 + np.square(columns @ solved).sum(axis=1)


def _told(model: np.ndarray, effects: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Basis of the coefficients that the known rows tell, `(coefficient, direction)`."""
    effects = _apart(model, effects)
    size = np.linalg.norm(effects, axis=0) + 1e-300
    _, spread, turn = np.linalg.svd(effects / size, full_matrices=False)
    seen = spread > 1e-9
    directions = turn[seen].T / spread[seen]
    some = _apart(model[known], (effects / size)[known] @ directions)
    share, axes = np.linalg.eigh(some.T @ some)
    untold = np.concatenate([turn[~seen].T, directions @ axes[:, share < TOLD_BY_OTHERS]], axis=1)
    # All that is orthogonal to what the known rows do not tell.
    left, kept = np.linalg.qr(untold, mode="complete")[0], untold.shape[1]
    return left[:, kept:] / size[:, None]


def _apart(model: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Columns without what the model's explain."""
    frame = span(model)
    return columns - frame @ (frame.T @ columns)


def effect_columns(
    chosen: Sequence[Term], chain: int, rows: int
) -> Float[np.ndarray, "row coefficient"]:
    """Columns of the chosen terms on one chain of so many rows, side by side."""
    mine = [t.columns[t.chains.index(chain)] for t in chosen if chain in t.chains]
    return np.concatenate([np.zeros((rows, 0)), *mine], axis=1)


def held_out_rms(
    prepared: Prepared, chosen: Sequence[Term], chains: Sequence[int] | None = None
) -> float:
    """Root mean square of the rows of every fold predicted from the others, SI, each by one over its variance.

    Beside fast turns, whose rows err ten times as much, what the others show would count for nothing. Of all chains, or
    of those that are named.
    """
    some = range(len(prepared.system.chains)) if chains is None else chains
    fold = folds(prepared)
    squares = np.stack([_held_out_squares(prepared, chosen, c, fold) for c in some])
    weight = np.stack([1.0 / _variance(prepared.system.chains[c]) for c in some])
    return float(np.sqrt((weight * squares).sum() / weight.sum())) if squares.size else 0.0


def _variance(chain: Chain) -> Float[np.ndarray, " row"]:
    """Variance of each row by scatter and as the rig states it."""
    return chain.white + chain.rig


def gain_over_stretches(
    prepared: Prepared, term: Term, others: Sequence[Term]
) -> Float[np.ndarray, " stretch"]:
    r"""What a term beside the others takes from the sum of squares of each stretch, when that is left out, SI.

    $$g_d = \sum_{i \in d} (e_i^2 / u_d - \tilde e_i^2 / \tilde u_d),$$ with $e_i$ predicted without the term and
    $\tilde e_i$ with it, and $u_d$ the variance of such a prediction beside that of one stretch (`reach`). A stretch
    is a dwell, or a fortieth of the blocks where dwells are few.
    """
    piece = _pieces(prepared)
    if len(np.unique(prepared.blocks.dwell)) < 2 * FOLDS:
        piece = piece * min(CHUNKS, len(piece)) // len(piece)
    fold, change = folds(prepared), np.zeros(len(piece))
    for c in term.chains:  # those of others are predicted as before
        change += _held_out_squares(prepared, others, c, fold, piece)
        change -= _held_out_squares(prepared, [*others, term], c, fold, piece)
    return np.bincount(piece, change)


def _held_out_squares(
    prepared: Prepared,
    chosen: Sequence[Term],
    chain: int,
    fold: Int[np.ndarray, " row"],
    piece: Int[np.ndarray, " row"] | None = None,
) -> Float[np.ndarray, " row"]:
    """Squared errors of a chain's rows of every fold predicted from the others, SI squared; with the number of the
    `piece` of each row by the variance of such a prediction."""
    system = prepared.system
    y, frame = system.base.observed[chain], system.frames[chain]
    effects, variance = effect_columns(chosen, chain, len(y)), _variance(system.chains[chain])
    squares, weight = np.zeros(len(fold)), 1.0 / np.sqrt(variance)
    for k in range(FOLDS):
        known = fold != k
        columns = _predictors(frame, effects, weight, known)
        left = y[~known] - _predicted(columns, y, weight, known)
        squares[~known] = left**2
        if piece is not None:
            squares[~known] /= _reach_of_rows(columns, known, piece)[~known]
    return squares


def _reach_of_rows(
    columns: np.ndarray, known: np.ndarray, piece: np.ndarray
) -> Float[np.ndarray, " row"]:
    """`reach` of the piece that each row is in; a piece is known where most of its rows are."""
    count = np.bincount(piece)
    means = np.stack([np.bincount(piece, column) / count for column in columns.T], axis=1)
    return reach(means, np.bincount(piece, known) > 0.5 * count)[piece]


def in_sample(prepared: Prepared, noise: NoiseFit, chosen: Sequence[Term]) -> tuple[float, float]:
    """Root mean square of the rows (SI) by least squares, and chi² per degree of freedom under the noise."""
    from ..selection.score_test import whiten_system

    system = prepared.system
    square, number = 0.0, 0
    for c, chain in enumerate(system.chains):
        y = system.base.observed[c]
        x = np.concatenate([system.frames[c], effect_columns(chosen, c, len(y))], axis=1)
        x = x / (np.linalg.norm(x, axis=0) + 1e-300)
        w = 1.0 / np.sqrt(chain.white)
        left = y - x @ np.linalg.lstsq(x * w[:, None], y * w, rcond=1e-9)[0]
        square += float(left @ left)
        number += len(left)
    white = whiten_system(system, noise, [], chosen)
    return float(np.sqrt(square / number)), white.chi2 / max(white.dof, 1)
