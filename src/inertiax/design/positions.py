"""Optimal programmes of positions for a two-axis table: exchange on a grid, then a gradient's polish."""

import equinox as eqx
import numpy as np
from jaxtyping import Float
from scipy.optimize import minimize

from ..estimators import AbstractEstimator
from ..simulate.programme import Programme, Table
from .criteria import CRITERIA, log_score_slope
from .information import host_rows, host_slopes, sphere_average


class TableLimits(eqx.Module):
    """Angles (rad) that each axis reaches, and the step to which it can be set (0: any angle)."""

    outer: tuple[float, float] = eqx.field(
        static=True,
        default=(-np.pi, np.pi),
        converter=lambda pair: (float(pair[0]), float(pair[1])),
    )
    inner: tuple[float, float] = eqx.field(
        static=True,
        default=(-np.pi, np.pi),
        converter=lambda pair: (float(pair[0]), float(pair[1])),
    )
    step: float = eqx.field(static=True, default=0.0, converter=float)

    def __check_init__(self):
        for name, (low, high) in (("outer", self.outer), ("inner", self.inner)):
            if not low < high:
                raise ValueError(
                    f"`TableLimits({name}=...)` needs low < high in rad; got {low}, {high}."
                )


def optimal_positions(
    estimator: AbstractEstimator,
    count: int,
    *,
    criterion: str = "D",
    table: Table | None = None,
    limits: TableLimits | None = None,
    starts: int = 8,
    seed: int = 0,
    grid: float = np.pi / 12.0,
) -> Programme:
    """The best programme of `count` positions found from `starts` random ones.

    Each start is improved by Fedorov's exchange over a grid of table angles (spacing `grid`, rad) until
    no exchange of one position helps; the best is polished by L-BFGS-B on all angles with the exact
    gradient, within the table's limits, and rounded to its step. Positions are in the order of the
    shortest slews.

    Raises `ValueError` where the positions are too few for the parameters.

    **Reference:** Fedorov, *Theory of Optimal Experiments*, Academic Press 1972, ch. 3.
    """
    table = Table() if table is None else table
    limits = TableLimits() if limits is None else limits
    if criterion not in CRITERIA:
        raise ValueError(f"`optimal_positions(criterion={criterion!r})`: one of {list(CRITERIA)}.")
    candidates = _grid(limits, grid)
    rows = host_rows(estimator, table, candidates)
    if count * rows.shape[1] < estimator.num_parameters:
        raise ValueError(
            f"`optimal_positions(count={count})`: {count * rows.shape[1]} equations cannot determine "
            f"{estimator.num_parameters} parameters; ask for more positions."
        )
    weight = sphere_average(estimator, table)
    rng = np.random.default_rng(seed)
    found = [_exchange(rows, count, criterion, weight, rng) for _ in range(starts)]
    best = max(found, key=lambda f: f[1])[0]
    angles = _polish(estimator, table, limits, candidates[best], criterion, weight)
    programme = Programme(f"{criterion}-optimal {count}", angles, np.arange(count))
    return shortest_order(programme)


def _grid(limits: TableLimits, spacing: float) -> Float[np.ndarray, "candidates 2"]:
    def axis(low: float, high: float) -> np.ndarray:
        return np.linspace(low, high, max(2, round((high - low) / spacing) + 1))

    outer, inner = np.meshgrid(axis(*limits.outer), axis(*limits.inner), indexing="ij")
    return np.stack([outer.reshape(-1), inner.reshape(-1)], axis=1)


def _criterion(
    criterion: str, matrices: np.ndarray, weight: np.ndarray
) -> Float[np.ndarray, " plans"]:
    """Larger is better; −inf where singular. Host code: small LAPACK calls in a row, no `vmap`."""
    if criterion == "D":
        sign, log_det = np.linalg.slogdet(matrices)
        return np.where(sign > 0, log_det, -np.inf)
    # A little information that everyone has keeps a singular start comparable.
    eye = 1e-9 * np.eye(matrices.shape[-1])
    inverse = np.linalg.inv(matrices + eye)
    wanted = weight if criterion == "I" else np.eye(len(weight))
    return -np.log(np.einsum("nij,ji->n", inverse, wanted))


def _exchange(
    rows: np.ndarray, count: int, criterion: str, weight: np.ndarray, rng: np.random.Generator
) -> tuple[np.ndarray, float]:
    """Indices of the candidates taken, and their criterion."""
    products = np.einsum("nri,nrj->nij", rows, rows)
    chosen = rng.integers(0, len(rows), count)
    ridge = 1e-9 * np.eye(rows.shape[2])
    value = -np.inf
    while True:
        before = value
        for k in range(count):
            rest = products[np.delete(chosen, k)].sum(axis=0) + ridge
            values = _criterion(criterion, rest[None] + products, weight)
            best = int(np.argmax(values))
            if values[best] > values[chosen[k]] + 1e-12:
                chosen[k] = best
            value = float(values[chosen[k]])
        if not value > before + 1e-9:
            return chosen, value


def _polish(
    estimator: AbstractEstimator,
    table: Table,
    limits: TableLimits,
    start: Float[np.ndarray, "positions 2"],
    criterion: str,
    weight: np.ndarray,
) -> Float[np.ndarray, "positions 2"]:
    count = len(start)

    bounds = [limits.outer, limits.inner] * count
    first = np.clip(start.reshape(-1), *np.array(bounds).T)

    def evaluate(flat: np.ndarray) -> tuple[float, np.ndarray]:
        # The criterion's own derivative is on the host: to compile one through an inverse takes far longer.
        rows, slopes = host_slopes(estimator, table, flat.reshape(count, 2))
        information = np.einsum("nri,nrj->ij", rows, rows)
        value, by_matrix = log_score_slope(criterion, information, count, weight)
        # ∂(JᵀJ)/∂α = J'ᵀJ + JᵀJ', and the criterion's derivative is symmetric.
        own = 2.0 * np.einsum("nria,ij,nrj->na", slopes, by_matrix, rows, optimize=True)
        return -value, -own.reshape(-1)

    done = minimize(
        evaluate, first, jac=True, method="L-BFGS-B", bounds=bounds,
        options={"maxiter": 500, "ftol": 1e-14, "gtol": 1e-9},
    )  # fmt: skip
    angles = done.x if done.fun <= evaluate(first)[0] else first
    angles = angles.reshape(count, 2)
    if limits.step > 0.0:
        low = np.array([limits.outer[0], limits.inner[0]])
        high = np.array([limits.outer[1], limits.inner[1]])
        angles = np.clip(np.round(angles / limits.step) * limits.step, low, high)
    return angles


def shortest_order(programme: Programme) -> Programme:
    """The positions in an order of short slews: nearest neighbour, then 2-opt; the first one stays.

    A slew takes as long as the axis that has farther to go.
    """
    angles = np.asarray(programme.angles)
    distance = _slews(angles)
    order = [0]
    left = set(range(1, len(angles)))
    while left:
        nearest = min(left, key=lambda j: distance[order[-1], j])
        order.append(nearest)
        left.remove(nearest)
    path = _two_opt(np.array(order), distance)
    return Programme(programme.name, angles[path], np.asarray(programme.numbers)[path])


def _slews(angles: np.ndarray) -> Float[np.ndarray, "positions positions"]:
    turn = angles[:, None] - angles[None]
    turn = np.abs((turn + np.pi) % (2.0 * np.pi) - np.pi)
    return turn.max(axis=2)


def _two_opt(order: np.ndarray, distance: np.ndarray) -> np.ndarray:
    length = lambda path: float(distance[path[:-1], path[1:]].sum())
    improved = True
    while improved:
        improved = False
        for i in range(1, len(order) - 1):
            for j in range(i + 1, len(order)):
                other = np.concatenate([order[:i], order[i : j + 1][::-1], order[j + 1 :]])
                if length(other) < length(order) - 1e-9:
                    order, improved = other, True
    return order
