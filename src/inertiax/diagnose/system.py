"""One triad's rows with their noise: fit of the variances, whitening, and scores of candidate terms."""

from collections.abc import Sequence
from dataclasses import dataclass

import equinox as eqx
import jax
import numpy as np
import scipy.optimize

from .baseline import Baseline
from .blocks import Blocks
from .terms import bucket, Term
from .whiten import Chain, Known, unpack, value_and_gradient, Variances, whiten_jit


COLUMNS = 10  # the baseline's columns are padded to a multiple
EXTRA = 16  # columns of effects that a fit of variances has room for
CHUNK = 384  # columns whitened at once, so that one compiled program serves all
ABSORBED = 2e-3  # part of a signature's square that must survive the baseline to count as testable
START = np.array([0.0, -1.0, -4.0, -2.0, -3.0, -1.5, -0.5])
# The likelihood of flicker and walk together has more than one maximum.
STARTS = (START, np.array([0.0, -6.0, 1.0, -2.0, -3.0, -1.5, -0.5]))
# Neither a probe nor a rig is worse than stated; how much better it is, the rows say.
BOUNDS = [(-1.0, 4.0), *4 * [(-9.0, 12.0)], (-6.0, 0.0), (-3.0, 0.0)]


class System(eqx.Module):
    """Rows of one triad: chains with noise structure, residuals, and the baseline's columns."""

    base: Baseline
    chains: tuple[Chain, ...]
    scales: tuple[np.ndarray, ...]
    frames: tuple[np.ndarray, ...]  # orthonormal basis of the baseline's columns, chain by chain
    longer: tuple[Chain, ...]  # the chains with rows of padding, for compiled programs
    known: tuple[Known, ...]  # what other units tell of each chain's variances

    @property
    def num_rows(self) -> int:
        """Observations over all chains."""
        return sum(len(y) for y in self.base.observed)


def make(
    base: Baseline, blocks: Blocks, rig: Sequence[np.ndarray], heated: Sequence[np.ndarray]
) -> System:
    """Chains of a fitted baseline; `rig` gives each chain's positioning variance per block, `heated` the change by
    one standard deviation of the probe's error, `(block, 1)` or `(block, 0)`."""
    white = getattr(blocks, f"{base.form.triad}_white")
    gap = np.r_[0.0, np.maximum(np.diff(blocks.time), 0.0)]
    fresh = np.r_[1.0, (np.diff(blocks.dwell) != 0).astype(float)]
    cycle = np.r_[1.0, (np.diff(blocks.cycle) != 0).astype(float)]
    chains, scales = [], []
    for c, _ in enumerate(base.observed):
        if len(base.observed) == 1:
            level = (white * base.loads[0] ** 2).sum(axis=1)
        else:
            level = white[:, c]
        chains.append(Chain(level, base.loads[c], gap, fresh, cycle, rig[c], heated[c]))
        mean = float(np.mean(level))
        scales.append(np.array([1.0, mean, mean / 1000.0, mean, mean, 0.5, 1.0]))
    frames = tuple(_range(x / np.linalg.norm(x, axis=0)) for x in base.columns)
    longer = tuple(jax.tree.map(_lengthen, chain) for chain in chains)
    nothing = tuple(Known.nothing() for _ in chains)
    return System(base, tuple(chains), tuple(scales), frames, longer, nothing)


def _lengthen(rows: np.ndarray, width: int | None = None) -> np.ndarray:
    """The rows with zeros behind them up to a bucket size, and columns of zeros up to `width`."""
    made = np.zeros(
        (bucket(len(rows)), *rows.shape[1:]) if width is None else (bucket(len(rows)), width)
    )
    made[(slice(len(rows)), *(slice(n) for n in rows.shape[1:]))] = rows
    return made


class NoiseFit(eqx.Module):
    """Fitted variances of every chain, and minus the log likelihood reached."""

    theta: tuple[np.ndarray, ...]
    value: tuple[float, ...]

    @property
    def total(self) -> float:
        """Minus the restricted log likelihood over all chains."""
        return float(sum(self.value))


def likelihood_inputs(system: System, c: int, chosen: Sequence[Term]) -> tuple[np.ndarray, ...]:
    """Residual, scaled baseline columns and padded columns of the chosen terms of one chain."""
    y = system.base.observed[c]
    unit = float(np.sqrt(system.scales[c][1])) * np.sqrt(len(y))
    extra = np.zeros((len(y), EXTRA))
    mine = [t.columns[t.chains.index(c)] for t in chosen if c in t.chains]
    if mine:
        found = _range(np.concatenate(mine, axis=1))[:, :EXTRA]
        extra[:, : found.shape[1]] = found * unit
    frame = system.frames[c] * unit
    wide = -(-frame.shape[1] // COLUMNS) * COLUMNS
    return _lengthen(y), _lengthen(frame, wide), _lengthen(extra)


def likelihood(system: System, noise: NoiseFit, chosen: Sequence[Term], chain: int) -> float:
    """Minus the restricted log likelihood of the chosen terms on one chain under given variances."""
    inputs = likelihood_inputs(system, chain, chosen)
    theta, scale = noise.theta[chain], system.scales[chain]
    return float(
        value_and_gradient(theta, scale, system.longer[chain], *inputs, system.known[chain])[0]
    )


def fit_noise(
    system: System,
    chosen: Sequence[Term] = (),
    start: NoiseFit | None = None,
    only: Sequence[int] | None = None,
) -> NoiseFit:
    """Restricted maximum likelihood of the variance components with the chosen terms in the mean.

    `only` limits the fit to some chains; the others are taken over from `start`.
    """
    thetas, values = [], []
    for c in range(len(system.chains)):
        if start is not None and only is not None and c not in only:
            thetas.append(start.theta[c])
            values.append(start.value[c])
            continue
        first = _starts(system.known[c]) if start is None else (start.theta[c],)
        theta, value = _maximise(system, c, chosen, first)
        thetas.append(theta)
        values.append(value)
    return NoiseFit(tuple(thetas), tuple(values))


def _starts(known: Known) -> tuple[np.ndarray, ...]:
    if not known.precision.any():
        return STARTS
    low, high = np.transpose(BOUNDS)
    return (*STARTS, np.clip(known.center, low, high))


def _maximise(
    system: System, c: int, chosen: Sequence[Term], starts: Sequence[np.ndarray]
) -> tuple[np.ndarray, float]:
    inputs = likelihood_inputs(system, c, chosen)

    def objective(theta: np.ndarray) -> tuple[float, np.ndarray]:
        value, slope = value_and_gradient(
            theta, system.scales[c], system.longer[c], *inputs, system.known[c]
        )
        value = float(value)
        return (value, np.asarray(slope)) if np.isfinite(value) else (1e12, np.zeros(len(theta)))

    options = {"ftol": 1e-7, "gtol": 5e-2, "maxiter": 40}
    found = [
        scipy.optimize.minimize(
            objective, s, jac=True, method="L-BFGS-B", bounds=BOUNDS, options=options
        )
        for s in starts
    ]
    best = min(found, key=lambda f: f.fun)
    return best.x, float(best.fun)


def variances(system: System, noise: NoiseFit) -> list[Variances]:
    """Variance components in SI units squared, chain by chain."""
    return [jax.tree.map(float, unpack(t, s)) for t, s in zip(noise.theta, system.scales)]


def whiten_columns(system: System, noise: NoiseFit, chain: int, columns: np.ndarray) -> np.ndarray:
    """Columns of one chain, whitened, in chunks of equal width."""
    v = unpack(noise.theta[chain], system.scales[chain])
    pieces = []
    for a in range(0, columns.shape[1], CHUNK):
        piece = columns[:, a : a + CHUNK]
        done = whiten_jit(v, system.longer[chain], _lengthen(piece, CHUNK))[0]
        pieces.append(np.asarray(done)[: len(columns), : piece.shape[1]])
    return np.concatenate(pieces, axis=1) if pieces else columns


@dataclass(frozen=True, eq=False)
class Whitened:
    """A system under one set of variances, with the baseline (and chosen terms) projected out."""

    residual: tuple[np.ndarray, ...]
    quotient: tuple[np.ndarray, ...]  # orthonormal columns of what was projected out
    scores: tuple["Score", ...]

    @property
    def chi2(self) -> float:
        """Sum of squares of the whitened residuals."""
        return float(sum(r @ r for r in self.residual))

    @property
    def dof(self) -> int:
        """Rows less what was fitted."""
        return int(sum(len(r) - q.shape[1] for r, q in zip(self.residual, self.quotient)))


@dataclass(frozen=True, eq=False)
class Score:
    """A term under one set of variances: its whitened columns beside the baseline, and its gain."""

    term: Term
    white: tuple[np.ndarray, ...]  # whitened columns with the baseline projected out, per chain
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
        """Covariance of the coefficients."""
        return self.turn @ self.turn.T


def whiten_system(
    system: System, noise: NoiseFit, candidates: Sequence[Term], chosen: Sequence[Term] = ()
) -> Whitened:
    """Whiten the rows, project the baseline and the chosen terms out, and score every candidate."""
    residual, quotient = [], []
    white: list[dict[int, np.ndarray]] = [{} for _ in candidates]
    raw: list[dict[int, float]] = [{} for _ in candidates]
    for c in range(len(system.chains)):
        y = system.base.observed[c] / system.scales[c][1] ** 0.5
        mine = [t.columns[t.chains.index(c)] for t in chosen if c in t.chains]
        fixed = np.concatenate([system.frames[c], *map(_unit, mine)], axis=1)
        owners = [
            (k, t.columns[t.chains.index(c)]) for k, t in enumerate(candidates) if c in t.chains
        ]
        widths = [m.shape[1] for _, m in owners]
        rest = np.concatenate([m for _, m in owners], axis=1) if owners else np.zeros((len(y), 0))
        scaled = np.linalg.norm(rest, axis=0) + 1e-300
        done = whiten_columns(
            system, noise, c, np.concatenate([y[:, None], fixed, rest / scaled], axis=1)
        )
        q = _range(done[:, 1 : 1 + fixed.shape[1]])
        rest = done[:, 1 + fixed.shape[1] :]
        before = np.linalg.norm(rest, axis=0)
        rest = rest - q @ (q.T @ rest)
        at = 0
        for (k, _), width in zip(owners, widths):
            white[k][c] = rest[:, at : at + width] * scaled[at : at + width]
            raw[k][c] = before[at : at + width] * scaled[at : at + width]
            at += width
        y = done[:, 0] * system.scales[c][1] ** 0.5
        y = y - q @ (q.T @ y)
        residual.append(y)
        quotient.append(q)
    scores = [_score(t, w, r, residual) for t, w, r in zip(candidates, white, raw)]
    return Whitened(tuple(residual), tuple(quotient), tuple(s for s in scores if s is not None))


def _unit(columns: np.ndarray) -> np.ndarray:
    return columns / (np.linalg.norm(columns, axis=0) + 1e-300)


def _range(columns: np.ndarray) -> np.ndarray:
    """Orthonormal basis of the columns' span, by the Gram matrix twice over."""
    columns = columns[:, np.linalg.norm(columns, axis=0) > 0.0]
    for _ in range(2):
        if not columns.shape[1]:
            break
        columns = _unit(columns)
        value, vector = np.linalg.eigh(columns.T @ columns)
        kept = value > 1e-12 * value[-1]
        columns = columns @ (vector[:, kept] / np.sqrt(value[kept]))
    return columns


def _score(term: Term, white: dict, raw: dict, residual: list[np.ndarray]) -> Score | None:
    before = sum(raw[c] ** 2 for c in term.chains)
    gram = sum(white[c].T @ white[c] for c in term.chains)
    after = np.diag(gram)
    if not np.any(after > ABSORBED * np.maximum(before, 1e-300)):
        return None
    norm = np.where(
        after > ABSORBED * np.maximum(before, 1e-300), np.sqrt(np.maximum(after, 1e-300)), np.inf
    )
    if len(norm) == 1:
        turn = 1.0 / norm[None, :]
    else:
        value, vector = np.linalg.eigh(gram / norm[:, None] / norm[None, :])
        good = value > 1e-7 * value[-1]
        turn = vector[:, good] / np.sqrt(value[good]) / norm[:, None]
    part = turn.T @ sum(white[c].T @ residual[c] for c in term.chains)
    return Score(term, tuple(white[c] for c in term.chains), turn, part, float(part @ part))
