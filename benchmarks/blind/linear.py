"""Generalised least squares on block means: what an effect leaves after the calibration took its share.

A triad's data are reduced to means over blocks of a few seconds inside each dwell. In the true noise
covariance Σ (which the generator knows) baseline columns B, an effect's signature s:

    z² = |Q s̃|²,  s̃ = L⁻¹ s,  Σ = L Lᵀ,  Q = projection that removes L⁻¹ B

z is the size of the effect in standard deviations of its best unbiased estimate.
"""

from dataclasses import dataclass

import numpy as np
from numpy.polynomial import chebyshev
from scipy.linalg import qr, solve_triangular
from table import Plan
from world import Noise, PROBE_SHARE, PROBE_TAU, RELAXATIONS


@dataclass
class Blocks:
    """Which rows belong to which block; blocks are contiguous rows of one dwell."""

    first: np.ndarray
    count: np.ndarray
    time: np.ndarray
    length: np.ndarray  # s
    dwell: np.ndarray
    session: np.ndarray

    def mean(self, x: np.ndarray) -> np.ndarray:
        """Means over blocks of the rows of `x`."""
        total = np.concatenate([np.zeros((1, *x.shape[1:])), np.cumsum(x, axis=0)])
        shape = (-1,) + (1,) * (x.ndim - 1)
        return (total[self.first + self.count] - total[self.first]) / self.count.reshape(shape)


def blocks_of(plan: Plan, rests_only: bool) -> Blocks:
    """Cut every dwell into equal blocks of about `plan.block_seconds`."""
    wanted = (plan.dwell >= 0) & (plan.resting | (not rests_only))
    dt = float(np.median(np.diff(plan.time)))
    edges = np.flatnonzero(np.diff(plan.dwell) | (np.diff(plan.session) != 0)) + 1
    first, count = [], []
    for rows in np.split(np.arange(len(plan.time)), edges):
        if not wanted[rows[0]]:
            continue
        parts = max(int(round(len(rows) * dt / plan.block_seconds)), 1)
        for piece in np.array_split(rows, parts):
            if len(piece) >= 2:
                first.append(piece[0])
                count.append(len(piece))
    first, count = np.array(first), np.array(count)
    blocks = Blocks(first, count, np.zeros(0), count * dt, plan.dwell[first], plan.session[first])
    blocks.time = blocks.mean(plan.time)
    return blocks


def _relaxation_covariance(blocks: Blocks, tau: float) -> np.ndarray:
    """Covariance of block means of a unit relaxation process."""
    h = blocks.length / tau
    gap = np.abs(blocks.time[:, None] - blocks.time[None, :]) / tau
    shape = np.sinh(np.minimum(h, 300) / 2) / (h / 2)
    with np.errstate(over="ignore", under="ignore"):
        cov = np.exp(-gap) * shape[:, None] * shape[None, :]
    np.fill_diagonal(cov, 2 / h * (1 - (1 - np.exp(-h)) / h))
    return cov


def kernels(plan: Plan, blocks: Blocks, noise: Noise) -> list[np.ndarray]:
    """Covariance of each channel's block means: all that is independent between channels."""
    session = blocks.session[:, None] == blocks.session[None, :]
    dwell = blocks.dwell[:, None] == blocks.dwell[None, :]
    relaxing = np.sum([_relaxation_covariance(blocks, tau) for tau in RELAXATIONS], axis=0)
    on = np.array([plan.time[plan.session == s][0] for s in range(plan.session.max() + 1) if s > 0])
    since = blocks.time - on[blocks.session - 1]
    walking = session * np.minimum(since[:, None], since[None, :]) - np.diag(blocks.length / 6)
    white = np.diag((noise.white**2 + noise.step**2 / 12) / blocks.count)
    return [
        white
        + noise.flicker[c] ** 2 * relaxing
        + noise.walk[c] ** 2 * walking
        + noise.dwell[c] ** 2 * dwell
        + noise.session[c] ** 2 * session
        for c in range(3)
    ]


def probe_kernel(blocks: Blocks, sigma: float) -> np.ndarray:
    """Covariance of the probe's error, °C²."""
    same = blocks.session[:, None] == blocks.session[None, :]
    each = (PROBE_SHARE * sigma) ** 2 / 2
    return each * (_relaxation_covariance(blocks, PROBE_TAU) + same)


def _cross(v: np.ndarray) -> np.ndarray:
    x, y, z = np.moveaxis(v, -1, 0)
    o = np.zeros_like(x)
    return np.stack(
        [np.stack([o, -z, y], -1), np.stack([z, o, -x], -1), np.stack([-y, x, o], -1)], -2
    )


@dataclass
class Problem:
    """One triad's whitened linear problem. `kind` is the estimator's name."""

    triad: str
    kind: str
    plan: Plan
    blocks: Blocks
    reading: np.ndarray  # (n, 3) what an ideal triad reads, sample by sample
    chol: np.ndarray
    base: np.ndarray  # orthonormal, whitened baseline columns
    up: np.ndarray  # (n, 3)

    def reduce(self, signal: np.ndarray) -> np.ndarray:
        """(n, 3) output change to the residuals the estimator sees (one vector, stacked)."""
        if self.kind == "invariant":
            return self.blocks.mean(np.sum(signal * self.up, axis=1))
        means = self.blocks.mean(signal)
        return means.T.ravel()

    def whiten(self, columns: np.ndarray) -> np.ndarray:
        return solve_triangular(self.chol, columns, lower=True, check_finite=False)

    def project(self, whitened: np.ndarray) -> np.ndarray:
        return whitened - self.base @ (self.base.T @ whitened)

    def visible(self, signal: np.ndarray) -> np.ndarray:
        """Whitened signature of an (n, 3) or (n, 3, q) output change, calibration projected out."""
        if signal.ndim == 2:
            return self.project(self.whiten(self.reduce(signal)))
        columns = np.stack([self.reduce(signal[..., k]) for k in range(signal.shape[-1])], -1)
        return self.project(self.whiten(columns))


def baseline(plan: Plan, triad: str, kind: str, reading, force, probe, up) -> np.ndarray:
    """(n, 3, p) output change per unit of each parameter of the calibration model."""
    n = len(plan.time)
    degree = int(plan.model.get("temperature_degree", 0))
    low, high = probe.min(), probe.max()
    scaled = (2 * probe - low - high) / max(high - low, 1e-9)
    basis = chebyshev.chebvander(scaled if degree else 0 * scaled, degree)
    out = []
    for c in range(3):
        terms = [np.ones(n)]
        if kind == "invariant":
            terms += [reading[:, j] for j in range(c + 1)]
        elif kind == "reference":
            terms += [reading[:, j] for j in range(3)]
        if triad == "gyro" and plan.model.get("g_sensitivity") and kind != "invariant":
            terms += [force[:, j] for j in range(3)]
        for term in terms:
            column = np.zeros((n, 3, degree + 1))
            column[:, c, :] = term[:, None] * basis
            out.append(column)
    return np.concatenate(out, axis=-1)


def span(columns: np.ndarray, tolerance: float = 1e-9) -> np.ndarray:
    """Orthonormal basis of the columns, those that add nothing left out."""
    size = np.linalg.norm(columns, axis=0)
    columns = columns[:, size > 0] / size[size > 0]
    if columns.shape[1] == 0:
        return columns
    q, r, _ = qr(columns, mode="economic", pivoting=True, check_finite=False)
    d = np.abs(np.diag(r))
    return q[:, : int(np.sum(d > tolerance * d[0]))]


def problem(plan, triad, reading, force, probe, noise: Noise, slope, sigma_probe) -> Problem:
    """Assemble Σ and the projected baseline of one triad.

    `reading`, `force`, `slope` are (n, 3): ideal reading, specific force in g, output per °C.
    """
    kind = plan.model[f"{triad}_estimator"]
    # On plateaus an accelerometer is compared with its planned reading, where the plan logs one.
    turning = kind == "reference" and (triad == "gyro" or "gyro" in plan.references)
    blocks = blocks_of(plan, rests_only=not turning)
    own = kernels(plan, blocks, noise)
    up = blocks.mean(plan.up)
    heated = blocks.mean(slope)
    drifting = probe_kernel(blocks, sigma_probe) if plan.model.get("temperature_degree") else 0.0
    if kind == "invariant":
        along = np.sum(heated * up, axis=1)
        cov = sum(k * np.outer(u, u) for k, u in zip(own, up.T, strict=True))
        cov += drifting * np.outer(along, along)
    else:
        x = blocks.mean(reading)
        turned = _cross(x)  # (m, 3, 3)
        move = blocks.dwell[:, None] == blocks.dwell[None, :]
        m = len(x)
        cov = np.zeros((3, m, 3, m))
        for i in range(3):
            for j in range(3):
                part = noise.position**2 * move * (turned[:, i] @ turned[:, j].T)
                if triad == "gyro" and kind == "reference":
                    part += noise.rate**2 * move * np.outer(x[:, i], x[:, j])
                part += drifting * np.outer(heated[:, i], heated[:, j])
                cov[i, :, j, :] = part + (own[i] if i == j else 0.0)
        cov = cov.reshape(3 * m, 3 * m)
    # LAPACK wants columns; a row-major factor would be copied at every solve.
    chol = np.asfortranarray(np.linalg.cholesky(cov))
    made = Problem(triad, kind, plan, blocks, reading, chol, np.zeros((len(cov), 0)), plan.up)
    columns = baseline(plan, triad, kind, reading, force, probe, plan.up)
    raw = np.stack([made.reduce(columns[..., k]) for k in range(columns.shape[-1])], -1)
    made.base = span(made.whiten(raw))
    return made


def share(signature: np.ndarray, columns: np.ndarray, given: np.ndarray | None = None) -> float:
    """R² of a visible signature in the span of other visible columns, beside those `given`."""
    if given is not None:
        q = span(given)
        signature = signature - q @ (q.T @ signature)
        columns = columns - q @ (q.T @ columns)
    keep = np.linalg.norm(columns, axis=0) > 0
    total = float(signature @ signature)
    if not keep.any() or total <= 0:
        return 0.0
    return float(np.sum((span(columns[:, keep]).T @ signature) ** 2) / total)
