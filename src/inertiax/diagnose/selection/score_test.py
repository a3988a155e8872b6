"""Whitening of rows, and scores of candidate terms."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from ...numerics.common_errors import inverse_root
from ..candidates.columns import span, unit
from ..candidates.signatures import Term
from ..noise.common_mode_fit import coupled_theta, RIG
from ..noise.grouped_filter import whiten
from ..noise.observation_series import NoiseFit, System
from ..noise.state_space import Chain


CHUNK = 512  # columns whitened at once
ABSORBED = 2e-3  # part of a signature's square that must survive the baseline to count as testable
TOLD = 0.999  # square of a coefficient's own direction in those that the rows tell, from which it is told
REMEMBERED = 24  # whitened sets of shared errors, megabytes each


def whiten_columns(
    system: System, noise: NoiseFit, chain: int, columns: np.ndarray, *, apart: bool = False
) -> np.ndarray:
    """Columns of one chain, whitened; `apart` from the errors that chains share."""
    theta, rows, shared = noise.theta[chain], system.chains[chain], system.shared
    if shared is not None and not apart and shared.lasting:
        return _whiten_alone(system, theta, chain, columns)
    if apart and shared is not None:
        theta, rows = coupled_theta(noise)[chain], shared.chains[chain]
    return _whiten(rows, np.exp(theta) * system.scales[chain], columns)


def _whiten(rows: Chain, variances: np.ndarray, columns: np.ndarray) -> np.ndarray:
    if columns.shape[1] <= CHUNK:
        return whiten(rows, variances, columns)[0]
    made = np.empty(columns.shape, order="F")
    for here in _chunks(columns.shape[1]):
        made[:, here] = whiten(rows, variances, columns[:, here])[0]
    return made


def _whiten_alone(system: System, theta: np.ndarray, chain: int, columns: np.ndarray) -> np.ndarray:
    """Columns of a chain by itself, whitened with its own part of errors that last from dwell to dwell: what goes with
    time would pass for them, each dwell's by itself."""
    shared = system.shared
    assert shared is not None
    variances = np.exp(theta) * system.scales[chain]
    key = chain, theta.tobytes(), "alone"
    if len(shared.known) > REMEMBERED:
        shared.known.clear()
    if key not in shared.known:
        size = np.linalg.norm(shared.columns[chain], axis=0) + 1e-300
        own = _whiten(shared.chains[chain], variances, shared.columns[chain] / size) * size
        part = float(variances[RIG])
        turned = np.asarray(inverse_root(part * own.T @ own))
        shared.known[key] = own, part * turned @ turned.T
    own, middle = shared.known[key]
    made = _whiten(shared.chains[chain], variances, columns)
    for here in _chunks(made.shape[1]):
        made[:, here] -= own @ (middle @ (own.T @ made[:, here]))
    return made


def _chunks(width: int) -> Iterator[slice]:
    """Columns a few at a time, so that no copy of all is made beside the result."""
    return (slice(a, a + CHUNK) for a in range(0, width, CHUNK))


def _project_out(columns: np.ndarray, q: np.ndarray) -> None:
    """Take the span of orthonormal columns away from others, in place."""
    for here in _chunks(columns.shape[1]):
        columns[:, here] -= q @ (q.T @ columns[:, here])


@dataclass(frozen=True, eq=False)
class Whitened:
    """A system under one set of variances, with the baseline (and chosen terms) projected out."""

    residual: tuple[np.ndarray, ...]
    fitted: int  # directions that were projected out
    scores: tuple["Score", ...]

    @property
    def chi2(self) -> float:
        """Sum of squares of the whitened residuals."""
        return float(sum(r @ r for r in self.residual))

    @property
    def dof(self) -> int:
        """Rows less what was fitted."""
        return sum(map(len, self.residual)) - self.fitted


@dataclass(frozen=True, eq=False)
class Score:
    """A term under one set of variances: its whitened columns beside the baseline, and its gain."""

    term: Term
    # On which it shows: the term's, or all where the rig's errors couple them
    chains: tuple[int, ...]
    # Whitened columns with the baseline projected out, per chain; none where they were not asked for.
    white: tuple[np.ndarray, ...]
    turn: np.ndarray  # white @ turn is orthonormal
    part: np.ndarray  # coordinates of the residual in those directions
    gain: float  # drop of the sum of squares

    @property
    def size(self) -> int:
        """Testable directions."""
        return self.turn.shape[1]

    @property
    def directions(self) -> tuple[np.ndarray, ...]:
        """Orthonormal columns, per chain."""
        return tuple(w @ self.turn for w in self.white)

    @property
    def coefficients(self) -> np.ndarray:
        """Least-squares coefficients of the term's columns."""
        return self.turn @ self.part

    @property
    def covariance(self) -> np.ndarray:
        """Covariance of the coefficients, of those that are told."""
        return self.turn @ self.turn.T

    @property
    def told(self) -> np.ndarray:
        """Which coefficients the rows tell; of the others they tell nothing, or a sum with others alone."""
        scaled = self.turn * np.sqrt(sum(np.square(w).sum(axis=0) for w in self.white))[:, None]
        return np.square(np.linalg.qr(scaled)[0]).sum(axis=1) > TOLD


def whiten_system(
    system: System,
    noise: NoiseFit,
    candidates: Sequence[Term],
    chosen: Sequence[Term] = (),
) -> Whitened:
    """Whiten the rows, project the baseline and the chosen terms out, and score every candidate.

    `column_products` scores many candidates under many noises, without their whitened columns.

    Where the rig's errors couple the chains, candidates that follow the input are scored on all chains together. What
    is slow stays with its own chain, for slow noise is fitted chain by chain beside the whole of the rig's errors.
    """
    residual, fitted = [], 0
    alone, together = parted(system, candidates)
    white: list[dict[int, np.ndarray]] = [{} for _ in alone]
    seen = np.zeros((3, sum(t.size for t in alone)))  # as `_columns_seen`
    edges = np.cumsum([0, *(t.size for t in alone)])
    for c in range(len(system.chains)):
        y, fixed, rest, places = _white_rows(system, noise, c, alone, chosen)
        q = span(fixed)
        before = _squares(rest)
        _project_out(rest, q)
        residual.append(y - q @ (q.T @ y))
        now = _columns_seen(before, rest, residual[-1])
        for k, here in places:
            white[k][c] = rest[:, here]
            seen[:, edges[k] : edges[k + 1]] += now[:, here]
        fitted += q.shape[1]
    scores = [_score(t, w, seen[:, a:b]) for t, w, a, b in zip(alone, white, edges, edges[1:])]
    if together:
        scores += scored_together(system, noise, together, chosen)
        place = {id(t): k for k, t in enumerate(candidates)}
        scores.sort(key=lambda s: -1 if s is None else place[id(s.term)])
    return Whitened(tuple(residual), fitted, tuple(s for s in scores if s is not None))


def parts_by_chain(
    system: System, noise: NoiseFit, term: Term, chosen: Sequence[Term]
) -> dict[int, float]:
    """Parts of a term's gain beside the chosen ones that its coefficients make on each chain's own rows; they add up
    to 1. One with the fitted sign for the wrong reason loses on a chain, which counts as nothing."""
    if len(term.chains) == 1:
        return {term.chains[0]: 1.0}
    made = whiten_system(replace(system, shared=None), noise, [term], chosen)
    if not made.scores:
        return {}
    score, gains = made.scores[0], {}
    for c, white in zip(score.chains, score.white):
        fitted = white @ score.coefficients
        gains[c] = max(2.0 * float(fitted @ made.residual[c]) - float(fitted @ fitted), 0.0)
    total = sum(gains.values())
    return {c: gain / total for c, gain in gains.items()} if total > 0.0 else {}


def _white_rows(
    system: System,
    noise: NoiseFit,
    c: int,
    candidates: Sequence[Term],
    chosen: Sequence[Term],
    *,
    apart: bool = False,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[tuple[int, slice]]]:
    """Whitened residual, columns that are fitted, and candidates' columns of one chain with their places."""
    fixed = fixed_columns(system, chosen, c)
    owners = [(k, t.columns[t.chains.index(c)]) for k, t in enumerate(candidates) if c in t.chains]
    edges = np.cumsum([0, *(m.shape[1] for _, m in owners)])
    y = system.base.observed[c]
    columns = np.concatenate([y[:, None], fixed, *(m for _, m in owners)], axis=1)
    done = whiten_columns(system, noise, c, columns, apart=apart)
    split = 1 + fixed.shape[1]
    places = [(k, slice(a, b)) for (k, _), a, b in zip(owners, edges[:-1], edges[1:])]
    return done[:, 0], done[:, 1:split], done[:, split:], places


def fixed_columns(
    system: System, chosen: Sequence[Term], chain: int
) -> Float[np.ndarray, "row column"]:
    """What is fitted beside a candidate on one chain: the baseline, and the chosen terms in unit length."""
    mine = [t.columns[t.chains.index(chain)] for t in chosen if chain in t.chains]
    return np.concatenate([system.frames[chain], *map(unit, mine)], axis=1)


def parted(system: System, terms: Sequence[Term]) -> tuple[list[Term], list[Term]]:
    """The terms that each chain's rows score alone, and those that all chains score together.

    The latter follow the input, where the rig's errors couple the chains.
    """
    if system.shared is None:
        return list(terms), []
    coupled = [t.like_the_rig for t in terms]
    return [t for t, c in zip(terms, coupled) if not c], [t for t, c in zip(terms, coupled) if c]


def scored_together(
    system: System, noise: NoiseFit, candidates: Sequence[Term], chosen: Sequence[Term]
) -> list[Score | None]:
    """Scores on the rows of all chains, where the rig's errors make one problem of them."""
    rows, y, rest, before = _rows_together(system, noise, candidates, chosen)
    widths = np.cumsum([0, *(t.size for t in candidates)])
    seen, scores = _columns_seen(before, rest, y), []
    for k, term in enumerate(candidates):
        place = slice(widths[k], widths[k + 1])
        white = {c: rest[here, place] for c, here in enumerate(rows)}
        scores.append(_score(term, white, seen[:, place]))
    return scores


def residual_together(
    system: System, noise: NoiseFit, chosen: Sequence[Term]
) -> tuple[np.ndarray, ...]:
    """Whitened residuals of each chain beside the chosen terms, without the errors that chains share."""
    if system.shared is None:
        return whiten_system(system, noise, [], chosen).residual
    rows, y, *_ = _rows_together(system, noise, [], chosen)
    return tuple(y[here] for here in rows)


def _rows_together(
    system: System, noise: NoiseFit, candidates: Sequence[Term], chosen: Sequence[Term]
) -> tuple[list[slice], np.ndarray, np.ndarray, np.ndarray]:
    """Places of the chains in one set of rows; the residual there, candidates' columns beside the fitted ones, and
    their squares before."""
    edges = np.cumsum([0, *map(len, system.base.observed)])
    rows = [slice(a, b) for a, b in zip(edges[:-1], edges[1:])]
    widths = np.cumsum([0, *(t.size for t in candidates)])
    y, fixed = np.zeros(edges[-1]), []
    rest = np.zeros((edges[-1], widths[-1]), order="F")
    for c, here in enumerate(rows):
        mine, base, columns, places = _white_rows(system, noise, c, candidates, chosen, apart=True)
        y[here] = mine
        fixed.append(np.zeros((edges[-1], base.shape[1])))
        fixed[-1][here] = base
        for k, place in places:
            rest[here, widths[k] : widths[k + 1]] = columns[:, place]
    wide = np.concatenate([y[:, None], *fixed], axis=1)
    signatures, middle = _shared_root(system, noise)
    for columns in (wide, rest):
        _take_shared(columns, rows, signatures, middle)
    y, q = wide[:, 0], span(wide[:, 1:])
    before = _squares(rest)
    y = y - q @ (q.T @ y)
    _project_out(rest, q)
    return rows, y, rest, before


def _take_shared(
    columns: np.ndarray, rows: Sequence[slice], signatures: Sequence[np.ndarray], middle: np.ndarray
) -> None:
    """Multiply columns by the inverse root $1 - U M U^T$ of what chains share, with its rows by chain, in place."""
    for here in _chunks(columns.shape[1]):
        seen = sum(u.T @ columns[mine, here] for mine, u in zip(rows, signatures))
        seen = middle @ seen
        for mine, u in zip(rows, signatures):
            columns[mine, here] -= u @ seen


def _shared_root(system: System, noise: NoiseFit) -> tuple[list[np.ndarray], np.ndarray]:
    """The inverse root of what the shared errors add to the whitened rows of all chains: the chains' whitened
    signatures $U$, and the symmetric $M$ of $1 - U M U^T$."""
    shared = system.shared
    assert shared is not None
    theta = coupled_theta(noise)
    key = tuple(t.tobytes() for t in theta)
    if len(shared.known) > REMEMBERED:
        shared.known.clear()
    white, grams = [], []
    for c, own in enumerate(key):
        done = shared.known.get((c, own))
        if done is None:
            columns = shared.columns[c]
            size = np.linalg.norm(columns, axis=0) + 1e-300
            rows = whiten_columns(system, noise, c, columns / size, apart=True) * size
            shared.known[c, own] = done = rows, rows.T @ rows
        white.append(done[0])
        grams.append(done[1])
    middle = shared.known.get(key)
    if middle is None:
        part = np.mean([np.exp(t[RIG]) * s[RIG] for t, s in zip(theta, system.scales)])
        turned = np.asarray(inverse_root(part * np.sum(grams, axis=0)))
        shared.known[key] = middle = part * turned @ turned.T
    return white, middle


def _columns_seen(
    before: np.ndarray, rest: np.ndarray, residual: np.ndarray
) -> Float[np.ndarray, "3 column"]:
    """Squares of columns before and after the baseline was projected out, and products with the residual."""
    return np.stack([before, _squares(rest), residual @ rest])


def _squares(columns: np.ndarray) -> np.ndarray:
    """Sum of squares of each column."""
    return np.einsum("nk,nk->k", columns, columns)


def is_shown(
    before: Float[np.ndarray, "*any"], after: Float[np.ndarray, "*any"]
) -> Bool[np.ndarray, "*any"]:
    """Which columns the baseline leaves enough of to be tested, by their squares before and after."""
    return after > ABSORBED * np.maximum(before, 1e-300)


def turned(
    gram: Float[np.ndarray, "*term column column"],
    after: Float[np.ndarray, "*term column"],
    shown: Bool[np.ndarray, "*term column"],
) -> tuple[Float[np.ndarray, "*term column column"], Bool[np.ndarray, "*term column"]]:
    """Directions in which terms' columns with these products are orthonormal, in columns, and which of them there are.

    The others, in which columns coincide or are absorbed, are zeros.
    """
    norm = np.where(shown, np.sqrt(np.maximum(after, 1e-300)), np.inf)
    value, vector = np.linalg.eigh(gram / norm[..., :, None] / norm[..., None, :])
    good = value > 1e-7 * value[..., -1:]
    scale = np.where(good, 1.0 / np.sqrt(np.where(good, value, 1.0)), 0.0)
    return vector * scale[..., None, :] / norm[..., :, None], good


def score_of(
    term: Term,
    chains: tuple[int, ...],
    white: tuple[np.ndarray, ...],
    seen: Float[np.ndarray, "3 column"],
    turn: Float[np.ndarray, "column direction"] | None,
) -> Score | None:
    """A term's score from products of its whitened columns, `None` where the baseline absorbs it.

    **Arguments:** `seen` as `_columns_seen` has it; `turn` has the directions of a term with several columns, none of
    one that is absorbed.
    """
    if turn is None:
        before, after, product = seen[:, 0].tolist()
        if after <= ABSORBED * max(before, 1e-300):
            return None
        scale = 1.0 / math.sqrt(max(after, 1e-300))
        part = scale * product
        return Score(term, chains, white, np.array([[scale]]), np.array([part]), part * part)
    if not turn.shape[1]:
        return None
    part = turn.T @ seen[2]
    return Score(term, chains, white, turn, part, float(part @ part))


def _score(
    term: Term, white: dict[int, np.ndarray], seen: Float[np.ndarray, "3 column"]
) -> Score | None:
    turn = None
    if seen.shape[1] > 1:
        before, after, _ = seen
        shown, gram = is_shown(before, after), np.sum([w.T @ w for w in white.values()], axis=0)
        turn = np.zeros((len(shown), 0))
        if shown.any():
            turn, good = turned(gram, after, shown)
            turn = turn[:, good]
    return score_of(term, tuple(white), tuple(white.values()), seen, turn)
