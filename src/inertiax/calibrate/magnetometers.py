"""The magnetometers' estimate: hard and soft iron over temperature, in the frame of the accelerometers.

The ellipsoid comes first, in the triad's own frame, from rests and samples in motion alike. Where rests with a known
vertical determine it, the rotation to the accelerometers follows in closed form, and one least squares over both
residuals ends it. Hard iron has its own degree over temperature and soft iron a lower one or the same, both by the
Bayesian information criterion.
"""

import dataclasses
import math
from typing import NamedTuple

import equinox as eqx
import numpy as np
from jaxtyping import Bool, Float
from scipy.signal import lfilter

from ..data.plausible_units import (
    field_unit_guess,
    GREATEST_EARTH_FIELD,
    GREATEST_FIELD,
    LEAST_EARTH_FIELD,
)
from ..estimators.magnetic_field import MagneticField, turn_to_vertical, VERTICAL
from ..model_selection.select_model import (
    HIGHEST_DEGREE,
    LEAST_SPAN,
    polynomial_basis,
    temperature_levels,
)
from ..numerics.linear_algebra import scaled_inverse
from ..physics.temperature import AbstractBasis, Constant, Curve
from ..procedure.single_device import Problem
from ..reduction.dwells import Dwells
from .between_dwell_variance import chi2_per_dof, with_scatter
from .observability import judge_normal
from .results import MagnetometerResult


_PASSES = 12  # over weights, scatter and the conventional field: each changes the answer ever less
_SETTLED = 1e-4  # of weights, relative: below what any data tell of a variance
_FEWEST_ALIKE = 20  # samples in motion from which their correlation is looked at
_UNKNOWN_NOISE = 1e-7  # T: equal weights where no sample says how noisy it is
LEAST_CURRENT = (
    0.1  # A, span: over less no wire of a drone makes a field that shows (50 nT at 0.4 m)
)
SURE_OF_FRAME = 0.1  # rad, 1 sigma of the rotation: beyond, the accelerometers' frame is not known
_STEEP = 0.3  # of the field, upward part, from which its sign tells the hemisphere


def calibrate_magnetometers(
    rows: Dwells,
    *,
    field: float | None = None,
    latitude: float | None = None,
    degree: int | None = None,
    robust: float | None = None,
) -> MagnetometerResult:
    """The magnetometers' estimate from rests and samples in motion.

    **Arguments:** `rows` as `reduction.field_rows` makes them, with the compensated specific force of the rests in
    `accel` where the accelerometers' frame is wanted; `field` is the local magnitude, T, else the scale is set so that
    det(E + S) = 1 in the middle of the temperatures; `latitude` (rad) tells which way the field points; `degree` of
    the hard iron over temperature, else chosen; `robust` a pseudo-Huber threshold in standard deviations.

    Raises `ValueError` where the rows do not determine the model, or are no field of the Earth in T.
    """
    first = _first_field(rows, field)
    with_current = rows.current is not None and float(np.ptp(np.asarray(rows.current))) > (
        LEAST_CURRENT
    )
    names = MagneticField(field=first, at=np.zeros(0), with_current=with_current).names
    estimator = MagneticField(
        field=first, at=np.zeros(len(names)), with_current=with_current, robust=robust
    )
    rows = _with_noise(rows)
    own = _solved(estimator, Constant(), rows, _free(names, (0, 0), turned=False), None, field)
    warnings: list[str] = []
    fit = _in_frame(own, latitude, field, warnings)
    degrees, reason = _degrees(fit, degree)
    if degrees != (0, 0):
        basis = polynomial_basis(max(degrees), rows)
        start = np.zeros((basis.size, len(names)))
        start[0] = fit.coefficients[0]
        free = _free(names, degrees, turned=fit.turned)
        fit = _solved(fit.estimator, basis, rows, free, start, field)
    if not fit.converged:
        raise ValueError(
            "mag: the estimation did not converge; look for a wrong unit, exchanged columns or iron that moved."
        )
    return _result(fit, field is not None, reason, warnings)


def _first_field(rows: Dwells, field: float | None) -> float:
    """A start for the magnitude, T, from the outputs' half span; the given one where there is one.

    Raises `ValueError` where the outputs are no field of the Earth in T.
    """
    outputs = np.asarray(rows.mag)
    about = outputs - 0.5 * (outputs.min(axis=0) + outputs.max(axis=0))
    size = float(np.median(np.linalg.norm(about, axis=1)))
    largest = float(np.median(np.linalg.norm(outputs, axis=1)))
    if largest > GREATEST_FIELD or not LEAST_EARTH_FIELD / 4.0 < size < 4.0 * GREATEST_EARTH_FIELD:
        raise ValueError(
            f"mag: the outputs move by {size:.3g} about their middle, and the Earth's field is "
            f"{1e6 * LEAST_EARTH_FIELD:g} to {1e6 * GREATEST_EARTH_FIELD:g} uT; turn the device all ways, or say the "
            f'unit: [columns] mag = {{ unit = "{field_unit_guess(max(size, 1e-12))}" }}.'
        )
    return size if field is None else field


def _with_noise(rows: Dwells) -> Dwells:
    """Equal weights where a row has no noise figure of its own."""
    spread = np.asarray(rows.mag_covariance)
    silent = np.trace(spread, axis1=1, axis2=2) <= 0.0
    if not silent.any():
        return rows
    filled = np.where(silent[:, None, None], _UNKNOWN_NOISE**2 * np.eye(3), spread)
    return eqx.tree_at(lambda d: d.mag_covariance, rows, filled)


def _free(
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


class _Memory(NamedTuple):
    """Correlation of the magnitude's misfit over samples in motion: `share` · `decay`^h with that h samples on."""

    share: float = 0.0
    decay: float = 0.0

    def applied(self, columns: Float[np.ndarray, "row column"]) -> Float[np.ndarray, "row column"]:
        """R X, where R has ones on its diagonal and the correlations beside it."""
        if self.share == 0.0:
            return columns
        one, recursion = np.ones(1), np.array([1.0, -self.decay])
        before = lfilter(one, recursion, columns, axis=0)
        after = lfilter(one, recursion, columns[::-1], axis=0)[::-1]
        return (1.0 - self.share) * columns + self.share * (before + after - columns)


class _Fit(NamedTuple):
    """A solve with its weights settled."""

    estimator: MagneticField
    rows: Dwells
    problem: Problem
    coefficients: Float[np.ndarray, "size parameter"]
    free: Bool[np.ndarray, "size parameter"]
    converged: bool
    memory: _Memory

    @property
    def turned(self) -> bool:
        """Whether it is in the frame of the accelerometers."""
        return bool(self.free[0, -1])

    @property
    def resting(self) -> Bool[np.ndarray, " dwell"]:
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
        """P (JᵀJ of the rests + JᵀR J / τ of the samples in motion) P, P = (JᵀJ)⁻¹; zero for what is not free."""
        designs = self._design()
        bread = self._normal_inverse(designs)
        rests, moving = designs
        alike = float(np.asarray(self.estimator.alike))
        filling = rests.T @ rests + moving.T @ self.memory.applied(moving) / alike
        size, own = self.free.size, np.flatnonzero(self.free.ravel())
        spread = np.zeros((size, size))
        spread[np.ix_(own, own)] = bread @ filling @ bread
        return spread

    def judged(self) -> tuple[Float[np.ndarray, "row 1"], Float[np.ndarray, "row 1"]]:
        """Misfits that count, and each one's sigma by the rows' own noise, T."""
        now = self.problem.at(self.coefficients)
        counted = np.column_stack([np.ones(len(now.misfit), bool), self.resting & self.turned])
        return now.misfit[counted][:, None], now.sigma[counted][:, None]


def _solved(
    estimator: MagneticField,
    basis: AbstractBasis,
    rows: Dwells,
    free: Bool[np.ndarray, "size parameter"],
    start: Float[np.ndarray, "size parameter"] | None,
    field: float | None,
) -> _Fit:
    """Least squares over the free coefficients; raises `ValueError` where they are not determined."""
    probe = np.asarray(rows.temperature)
    middle = basis.rows(np.array([0.5 * (probe.min() + probe.max())]))[0]
    visible = rows if free[0, -1] else _without_vertical(rows)
    problem = Problem(estimator, basis, visible)
    coefficients = problem.start() if start is None else start
    estimator = eqx.tree_at(lambda e: e.at, estimator, middle @ coefficients)
    fit = _Fit(
        estimator, rows, Problem(estimator, basis, visible), coefficients, free, False, _Memory()
    )
    _require_determined(fit)
    for _ in range(_PASSES):
        found, _, converged = fit.problem.solve(fit.coefficients, free=free)
        fit = fit._replace(coefficients=found, converged=converged)
        if not np.all(np.isfinite(found)):
            return fit._replace(converged=False)
        fit, moved = _settle(fit, middle, field)
        if moved < _SETTLED:
            break
    return fit


def _settle(
    fit: _Fit, middle: Float[np.ndarray, " size"], field: float | None
) -> tuple[_Fit, float]:
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
    memory, alike, unknowns = _memory(fit, float(np.asarray(estimator.scatter)))
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


def _memory(fit: _Fit, scatter: float) -> tuple[_Memory, float, float]:
    """The memory that the misfits show; how many samples therefore tell what one would whose error is its own, τ; and
    how many degrees of freedom the unknowns take.

    Correlations C_h / C_0 of what is left after the fit are too small: unknowns that samples with a memory tell take
    τ times what they would take of independent ones, σ² τ q κ_h of C_h, with q the unknowns that the samples tell and
    κ_h how alike two of them, h apart, tell them. That is given back. The memory is fitted to the lags before the first
    correlation below 2 sigma of a white series', 1/√n. τ is by how much, on average over the unknowns, a variance is
    larger than of independent samples: Σ R_ij over rows i and j, each pair weighted by how alike the two tell.
    """
    moving = fit.moving
    count = int(moving.sum())
    total = float(fit.free.sum())
    if count < _FEWEST_ALIKE:
        return _Memory(), 1.0, total
    now = fit.problem.at(fit.coefficients)
    relative = now.misfit[moving, 0] / np.hypot(now.sigma[moving, 0], scatter)
    told, taken = fit.told()
    lost = min(float(np.asarray(fit.estimator.alike)) * taken, 0.5 * count)
    left = float(relative @ relative)
    whole = left * count / (count - lost)
    seen = []
    for lag in range(1, count // 4 if left > 0.0 else 1):
        given_back = whole / count * lost * float(np.sum(told[:-lag] * told[lag:]))
        correlation = (float(relative[:-lag] @ relative[lag:]) + given_back) / whole
        if correlation < 2.0 / math.sqrt(count):
            break
        seen.append(correlation)
    if not seen:
        return _Memory(), 1.0, total
    powers = np.geomspace(0.3, 0.99, 40)[:, None] ** np.arange(1, len(seen) + 1)
    shares = np.clip(powers @ seen / np.sum(powers**2, axis=1), 0.0, 1.0)
    apart = np.sum(np.square(seen - shares[:, None] * powers), axis=1)
    best = int(np.argmin(apart))
    memory = _Memory(float(shares[best]), float(powers[best, 0]))
    alike = max(float(np.sum(told * memory.applied(told))), 1.0)
    return memory, alike, total + min((alike - 1.0) * taken, 0.5 * count)


def _without_vertical(rows: Dwells) -> Dwells:
    """All rows as samples of the magnitude alone."""
    return eqx.tree_at(lambda d: d.position, rows, np.full(rows.num_dwells, -1))


def _require_determined(fit: _Fit) -> None:
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


# The frame of the accelerometers ------------------------------------------------------------------------


def _in_frame(own: _Fit, latitude: float | None, field: float | None, warnings: list[str]) -> _Fit:
    """The fit in the frame of the accelerometers where the rests tell it, else as it is, with the reason."""
    dwells = own.rows
    known = np.zeros(dwells.num_dwells, bool)
    if dwells.accel is not None:
        known = np.asarray(dwells.position) >= 0
    rests = np.flatnonzero(known)
    why = f"{len(rests)} rests with calibrated accelerometers do not tell the rotation between the triads"
    names = own.estimator.names
    if len(rests) >= 6:
        rows = eqx.tree_at(lambda d: d.position, dwells, np.where(known, np.arange(len(known)), -1))
        start = _turned_start(own, rows, rests, latitude)
        free = _free(names, (0, 0), turned=True)
        try:
            fit = _solved(own.estimator, Constant(), rows, free, start, field)
        except ValueError:
            pass
        else:
            unsure = _rotation_sigma(fit)
            if fit.converged and unsure <= SURE_OF_FRAME:
                warnings.extend(_exchanged(fit))
                return fit
            why += f" better than {math.degrees(unsure):.0f}°" if math.isfinite(unsure) else ""
    warnings.append(
        f"magnetometers: in their own frame (x axis as it is, y in its xy plane), because {why}; rest in more "
        "orientations to have them in that of the accelerometers"
    )
    return own


def _turned_start(
    own: _Fit, rows: Dwells, rests: np.ndarray, latitude: float | None
) -> Float[np.ndarray, "1 parameter"]:
    """The ellipsoid turned so that the field keeps its angle to the vertical."""
    vector = own.coefficients[0]
    product = np.eye(3) + vector[3:12].reshape(3, 3)
    outputs = np.asarray(rows.mag)[rests] - vector[:3]
    if own.estimator.with_current:
        outputs = outputs - np.asarray(rows.current)[rests, None] * vector[12:15]
    force = np.asarray(rows.accel)[rests]
    up = force / np.linalg.norm(force, axis=1, keepdims=True)
    turn, vertical = turn_to_vertical(np.linalg.solve(product, outputs.T).T, up)
    steep = abs(vertical) > _STEEP * float(np.asarray(own.estimator.field))
    if latitude is not None and steep and abs(latitude) > _STEEP:
        inverted = vertical * latitude > 0.0  # north of the equator the field points down
    else:
        inverted = np.trace(turn) < 0.0
    sign = -1.0 if inverted else 1.0
    start = vector.copy()
    start[3:12] = (sign * product @ turn.T - np.eye(3)).ravel()
    start[-1] = sign * vertical
    return start[None, :]


def _orthogonal(product: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "3 3"]:
    """The orthogonal factor of a matrix: how its axes lie, mirrored ones too."""
    left, _, right = np.linalg.svd(product)
    return left @ right


def _rotation_sigma(fit: _Fit) -> float:
    """The largest standard deviation of the triad's rotation against the accelerometers, rad."""
    own = slice(3, 12)
    spread = fit.covariance()[: len(fit.free[0]), : len(fit.free[0])][own, own]
    if not np.all(np.isfinite(spread)):
        return float("nan")
    turn = _orthogonal(np.eye(3) + fit.coefficients[0][own].reshape(3, 3))
    # Of a small change dS, the antisymmetric part of dS Rᵀ is the rotation.
    axes = np.zeros((3, 9))
    for k, (i, j) in enumerate(((2, 1), (0, 2), (1, 0))):
        axes[k] = 0.5 * (np.outer(np.eye(3)[i], turn[j]) - np.outer(np.eye(3)[j], turn[i])).ravel()
    return float(np.sqrt(np.linalg.eigvalsh(axes @ spread @ axes.T)[-1]))


def _exchanged(fit: _Fit) -> list[str]:
    """A warning where the triad's axes lie along others than their columns say: the nearest of all 48 ways."""
    turn = _orthogonal(np.eye(3) + fit.coefficients[0][3:12].reshape(3, 3))
    nearest = np.zeros((3, 3))
    left = np.abs(turn)
    for _ in range(3):
        i, j = np.unravel_index(int(np.argmax(left)), (3, 3))
        nearest[i, j] = np.sign(turn[i, j])
        left[i, :] = left[:, j] = -1.0
    if np.allclose(nearest, np.eye(3)):
        return []
    words = ", ".join(
        f"{'xyz'[i]} along {'+' if nearest[i].sum() > 0 else '−'}{'xyz'[int(np.argmax(np.abs(nearest[i])))]}"
        for i in range(3)
    )
    return [
        f"magnetometers: by their angle to the vertical their axes lie {words} of the accelerometers; the matrix "
        "turns them, but look whether columns are exchanged or a sign is missing"
    ]


# Over temperature -----------------------------------------------------------------------------------------


def _degrees(fit: _Fit, asked: int | None) -> tuple[tuple[int, int], str]:
    """Degrees of hard and soft iron over temperature, and the reason in words.

    Linearised once at the constant solution, where the design of every pair of degrees is made of the same columns.
    """
    dwells = fit.problem.dwells[: fit.problem.num_dwells]
    temperature = np.asarray(dwells.temperature)
    span = float(np.ptp(temperature))
    if asked == 0:
        return (0, 0), "magnetometers: constants, as asked"
    if span < LEAST_SPAN:
        moves = f"moves by {span:.2f} °C" if span > 0.0 else "is not known to move"
        return (0, 0), f"magnetometers: constants, because the temperature {moves}"
    highest = min(HIGHEST_DEGREE, temperature_levels(temperature) - 1)
    if asked is not None:
        highest = asked
    now = fit.problem.at(fit.coefficients)
    counted = np.column_stack([np.ones(len(now.misfit), bool), fit.resting & fit.turned])
    right = now.residual[counted]
    # Samples that tell alike count as one.
    moving = fit.moving
    n = float(np.sum(~moving) + np.sum(moving) / float(np.asarray(fit.estimator.alike)))
    n += int(np.sum(fit.resting & fit.turned))
    x = 2.0 * (temperature - temperature.min()) / span - 1.0
    phi = np.polynomial.chebyshev.chebvander(x, max(highest, 0))
    design = np.einsum("na,nri->nrai", phi, now.jacobian)[counted]
    scores: dict[tuple[int, int], float] = {}
    for hard in range(highest + 1) if asked is None else [asked]:
        for soft in range(hard + 1):
            free = _free(fit.estimator.names, (hard, soft), turned=fit.turned)
            columns = design[:, : hard + 1][:, free]
            # With about as many unknowns as rows the misfit vanishes, and ln RSS rewards it beyond all measure.
            if n < 2.0 * columns.shape[1] and (hard, soft) != (0, 0):
                continue
            step, *_ = np.linalg.lstsq(columns, right, rcond=1e-10)
            rss = float(np.sum(np.square(right - columns @ step)))
            k = columns.shape[1]
            scores[hard, soft] = n * math.log(max(rss, 1e-300) / n) + k * math.log(n)
    if not scores:
        return (0, 0), "magnetometers: constants, because there are too few rows for more"
    hard, soft = min(scores, key=lambda d: scores[d])
    how = "by BIC" if asked is None else "as asked, soft iron by BIC"
    return (hard, soft), (
        f"magnetometers: temperature degree {hard} of the hard iron and {soft} of the soft iron, {how}"
    )


# What is told -----------------------------------------------------------------------------------------------


def _result(fit: _Fit, given: bool, reason: str, warnings: list[str]) -> MagnetometerResult:
    misfit, sigma = fit.judged()
    now = fit.problem.at(fit.coefficients)
    spread = fit.covariance()
    if not np.all(np.isfinite(spread)):
        raise ValueError(
            "mag: the rows do not determine the dependence on temperature; give [model] temperature_degree = 0."
        )
    scatter = float(np.asarray(fit.estimator.scatter))
    result = MagnetometerResult(
        estimator=fit.estimator,
        curve=Curve(fit.problem.basis, fit.coefficients),
        covariance=spread,
        free=fit.free,
        dwells=fit.rows,
        misfit=now.misfit * np.column_stack([np.ones(len(now.misfit)), fit.resting & fit.turned]),
        sigma=np.sqrt(np.square(now.sigma) + scatter**2),
        scatter=scatter,
        chi2_per_dof=chi2_per_dof(misfit, sigma, int(fit.free.sum())),
        frame="accel" if fit.turned else "own",
        field_given=given,
        statements=(),
        warnings=tuple(warnings),
    )
    return dataclasses.replace(result, statements=(reason, *_told(result)))


def _told(result: MagnetometerResult) -> tuple[str, ...]:
    """The estimate in two sentences."""
    hard, soft = result.worst_sigmas
    moving = result.dwells.num_dwells - result.num_rests
    where = "the accelerometers" if result.frame == "accel" else "the triad itself"
    field = 1e6 * float(np.asarray(result.estimator.field))
    scale = (
        f"scale by the given field of {field:.2f} µT"
        if result.field_given
        else f"scale by convention (a field of {field:.2f} µT makes it 1 in the mean; [site] magnetic_field gives it)"
    )
    return (
        f"magnetometers: hard iron ± {1e6 * hard:.2g} µT, soft iron ± {100 * soft:.2g} % (1 sigma, the worst), in the "
        f"frame of {where}, from {result.num_rests} rests and {moving} samples in motion; rms misfit "
        f"{1e6 * result.rms:.2g} µT",
        f"magnetometers: {scale}",
    )
