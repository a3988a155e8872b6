"""Least squares of the magnetometers over some of their coefficients, with its weights settled."""

import dataclasses
import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from .._jax import eqx
from ..estimators.magnetic_field import MagneticField, VERTICAL
from ..numerics.linear_algebra import scaled_inverse
from ..physics.temperature import AbstractBasis
from ..procedure.single_device import Problem
from ..reduction.dwells import Dwells
from .between_dwell_variance import with_scatter
from .magnetic_halves import spread_of_halves
from .magnetic_memory import FEWEST, Memory, memory_of, Worth
from .observability import judge_normal


_PASSES = 12  # over weights, scatter and the conventional field: each changes the answer ever less
_MOST_UNLIKE = 3.0  # of semi-axes: soft iron is some tenths (convention)
_RAN_AWAY = 1e6  # of coefficients, parts and T: soft iron is some tenths, and squares of these still are numbers
_SETTLED = 1e-4  # of weights, relative: below what any data tell of a variance


def free_coefficients(
    names: tuple[str, ...], degrees: tuple[int, int], *, turned: bool
) -> Bool[np.ndarray, "size parameter"]:
    """Which coefficients are unknowns: hard and soft iron each up to its degree, the others constant.

    In the triad's own frame (not `turned`) S is lower triangular and the vertical unknown.
    """
    highest = []
    for name in names:
        if name.startswith("mag.matrix"):
            upper = int(name[-4]) < int(name[-2])
            highest.append(degrees[1] if turned or not upper else -1)
        elif name == VERTICAL:
            highest.append(0 if turned else -1)
        else:
            highest.append(degrees[0] if name.startswith("mag.bias") else 0)
    return np.arange(max(degrees) + 1)[:, None] <= np.array(highest)[None, :]


class Fit(NamedTuple):
    """A solve with its weights settled."""

    estimator: MagneticField
    rows: Dwells
    problem: Problem
    coefficients: Float[np.ndarray, "size parameter"]
    free: Bool[np.ndarray, "size parameter"]
    converged: bool
    memory: Memory

    @property
    def turned(self) -> bool:
        """Whether it is in the frame of the accelerometers."""
        return bool(self.free[0, -1])

    @property
    def resting(self) -> Bool[np.ndarray, " dwell"]:
        """Rests whose vertical is known."""
        dwells = self.problem.dwells
        resting = np.asarray(dwells.position)[: self.problem.num_dwells] >= 0
        return resting & (dwells.accel is not None)

    @property
    def moving(self) -> Bool[np.ndarray, " dwell"]:
        """Single samples in motion."""
        return np.asarray(self.rows.duration) == 0.0

    def _design(
        self,
    ) -> tuple[Float[np.ndarray, "still unknown"], Float[np.ndarray, "moving unknown"]]:
        """∂r/∂x of the free coefficients: of rests, and of samples in motion in their order."""
        jacobian = self.problem.at(self.coefficients).jacobian
        full = np.einsum("na,nri->nrai", self.problem.phi[: len(jacobian)], jacobian)
        own = full[:, :, self.free]
        return own[~self.moving].reshape(-1, own.shape[2]), own[self.moving, 0]

    def _normal_inverse(self, designs: tuple[np.ndarray, ...]) -> np.ndarray:
        whole = np.concatenate(designs)
        return scaled_inverse(whole.T @ whole)

    def told(self) -> tuple[Float[np.ndarray, "row unknown"], float]:
        """What samples in motion tell: their rows of J P^½, P = (JᵀJ)⁻¹, scaled to a sum of squares of one; and that
        sum, of how many unknowns they take."""
        designs = self._design()
        bread = self._normal_inverse(designs)
        if not np.all(np.isfinite(bread)):
            return np.zeros((len(designs[1]), 1)), 0.0
        values, vectors = np.linalg.eigh(bread)
        rows = designs[1] @ (vectors * np.sqrt(np.maximum(values, 0.0)))
        taken = float(np.sum(np.square(rows)))
        return rows / math.sqrt(max(taken, 1e-300)), taken

    def covariance(self) -> Float[np.ndarray, "unknowns unknowns"]:
        """P (JᵀJ of the rests + JᵀR J / τ of the samples in motion) P, P = (JᵀJ)⁻¹; zero for what is not free.

        Where the two halves of the samples differ, with what that adds (`spread_of_halves`).
        """
        designs = self._design()
        bread = self._normal_inverse(designs)
        rests, moving = designs
        alike = float(np.asarray(self.estimator.alike))
        filling = rests.T @ rests + moving.T @ self.memory.applied(moving) / alike
        left = self.problem.at(self.coefficients).residual[self.moving, 0]
        halves = spread_of_halves(moving, left, self.memory, alike)
        size, own = self.free.size, np.flatnonzero(self.free.ravel())
        spread = np.zeros((size, size))
        spread[np.ix_(own, own)] = bread @ filling @ bread + halves
        return spread

    def judged(self) -> tuple[Float[np.ndarray, "row 1"], Float[np.ndarray, "row 1"]]:
        """Misfits that count, and each one's sigma by the rows' own noise, T."""
        now = self.problem.at(self.coefficients)
        counted = np.column_stack([np.ones(len(now.misfit), bool), self.resting & self.turned])
        return now.misfit[counted][:, None], now.sigma[counted][:, None]


def solved(
    estimator: MagneticField,
    basis: AbstractBasis,
    rows: Dwells,
    free: Bool[np.ndarray, "size parameter"],
    start: Float[np.ndarray, "size parameter"] | None,
    field: float | None,
) -> Fit:
    """Least squares over the free coefficients; raises `ValueError` where they are not determined.

    Where r₁ leads to no answer, by the distance from the ellipsoid, if that leads to one whose axes are alike.
    """
    fit = _settled(estimator, basis, rows, free, start, field)
    if fit.converged or estimator.by_distance:
        return fit
    other = _settled(
        dataclasses.replace(estimator, by_distance=True), basis, rows, free, start, field
    )
    return other if other.converged and _axes_alike(other) else fit


def _axes_alike(fit: Fit) -> bool:
    """Whether no axis is much longer than another: an ellipsoid through outputs that do not go round it is."""
    middle = 0.5 * (fit.problem.phi.min(axis=0) + fit.problem.phi.max(axis=0))
    matrix = np.eye(3) + (middle @ fit.coefficients)[3:12].reshape(3, 3)
    return bool(np.linalg.cond(matrix) < _MOST_UNLIKE)


def _settled(
    estimator: MagneticField,
    basis: AbstractBasis,
    rows: Dwells,
    free: Bool[np.ndarray, "size parameter"],
    start: Float[np.ndarray, "size parameter"] | None,
    field: float | None,
) -> Fit:
    probe = np.asarray(rows.temperature)
    middle = basis.rows(np.array([0.5 * (probe.min() + probe.max())]))[0]
    visible = rows if free[0, -1] else _without_vertical(rows)
    problem = Problem(estimator, basis, visible)
    coefficients = problem.start() if start is None else start
    estimator = eqx.tree_at(lambda e: e.at, estimator, middle @ coefficients)
    fit = Fit(
        estimator, rows, Problem(estimator, basis, visible), coefficients, free, False, Memory()
    )
    _require_determined(fit)
    for _ in range(_PASSES):
        found, _, converged = fit.problem.solve(fit.coefficients, free=free)
        fit = fit._replace(coefficients=found, converged=converged)
        if not np.all(np.abs(found) < _RAN_AWAY):  # nor are they numbers
            return fit._replace(converged=False)
        fit, moved = _settle(fit, middle, field)
        if moved < _SETTLED:
            break
    return fit


def _settle(fit: Fit, middle: Float[np.ndarray, " size"], field: float | None) -> tuple[Fit, float]:
    """Weights, scatter and the conventional field as the solution has them, and how far they moved."""
    estimator, coefficients = fit.estimator, fit.coefficients.copy()
    stretch = 1.0
    if field is None:
        product = np.eye(3) + (middle @ coefficients)[3:12].reshape(3, 3)
        stretch = float(np.cbrt(abs(np.linalg.det(product))))
        ideal = np.zeros_like(coefficients)
        ideal[0, [3, 7, 11]] = 1.0
        grown = (coefficients + ideal)[:, 3:12] / stretch - ideal[:, 3:12]
        coefficients[:, 3:12] = np.where(fit.free[:, 3:12], grown, coefficients[:, 3:12])
        coefficients[:, -1] *= stretch
    at = middle @ coefficients
    before = np.asarray(estimator.at)
    memory, alike, unknowns = _worth(fit, float(np.asarray(estimator.scatter)))
    fit = fit._replace(memory=memory)
    settled = with_scatter(estimator, *fit.judged(), round(unknowns))
    assert isinstance(settled, MagneticField)
    size = float(np.asarray(estimator.field))
    moved = max(
        abs(stretch - 1.0),
        float(np.max(np.abs(at - before)[:3])) / size,
        float(np.max(np.abs(at - before)[3:12])),
        abs(float(settled.scatter) - float(estimator.scatter)) / size,
        abs(alike / float(np.asarray(estimator.alike)) - 1.0),
    )
    new = (at, np.asarray(size * stretch), np.asarray(alike))
    settled = eqx.tree_at(lambda e: (e.at, e.field, e.alike), settled, new)
    problem = Problem(settled, fit.problem.basis, fit.problem.dwells[: fit.problem.num_dwells])
    return fit._replace(estimator=settled, problem=problem, coefficients=coefficients), moved


def _worth(fit: Fit, scatter: float) -> Worth:
    """What the fit's samples in motion show of their memory."""
    moving, total = fit.moving, float(fit.free.sum())
    if int(moving.sum()) < FEWEST:
        return Worth(Memory(), 1.0, total)
    now = fit.problem.at(fit.coefficients)
    relative = now.misfit[moving, 0] / np.hypot(now.sigma[moving, 0], scatter)
    return memory_of(relative, *fit.told(), float(np.asarray(fit.estimator.alike)), total)


def _without_vertical(rows: Dwells) -> Dwells:
    """All rows as samples of the magnitude alone."""
    return eqx.tree_at(lambda d: d.position, rows, np.full(rows.num_dwells, -1))


def _require_determined(fit: Fit) -> None:
    names, own = fit.estimator.names, np.flatnonzero(fit.free.ravel())
    count = int(len(fit.resting) + np.sum(fit.resting & fit.turned))
    if count < len(own):
        raise ValueError(
            f"mag: {count} equations for {len(own)} unknowns; turn the device all ways, at rest or in motion."
        )
    normal = fit.problem.normal(fit.problem.at(fit.coefficients).jacobian)
    term = lambda k: f" (temperature term {k // len(names)})" if k >= len(names) else ""
    labels = tuple(names[k % len(names)] + term(k) for k in own)
    seen = judge_normal(normal[np.ix_(own, own)], labels, 1)
    if seen.rank < seen.unknowns:
        raise ValueError(
            f"mag: the orientations do not determine {seen.unknowns - seen.rank} of {seen.unknowns} unknowns: "
            f"{'; '.join(seen.unseen[:3])}; turn the device all ways, upside down too."
        )
