"""Both triads in one least squares: curves of each, lever arms constant over temperature, one covariance.

The unknowns are the coefficients of `JointImu`'s parameters in one basis, each triad up to its own degree and the
lever arms at degree 0. Scatter between dwells is found for each triad from its own rows.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from .._jax import eqx, jax, jnp, optx
from .._typing import AnyArray
from ..calibration.fitted_effects import FittedEffect
from ..data.recording import Rig
from ..estimators import JointImu, ReferenceAccel
from ..estimators.host_forms import LinearisedDwells
from ..physics.alignment import Alignment, inter_triad
from ..physics.temperature import AbstractBasis, Constant, Curve, Polynomial
from ..procedure.single_device import Problem
from ..procedure.thermal_iterations import ThermalSolution
from ..reduction.dwells import Dwells
from .between_dwell_variance import (
    chi2_per_dof,
    judged,
    num_judged,
    with_provisional_scatter,
    with_scatter,
)
from .noise_of_motions import with_noise_shown
from .observability import judge_normal, Observability
from .results import TriadResult
from .slow_noise_together import with_slow_noise_of
from .unseen_arms import covariance_beside, with_arms_told, without_unseen_arms


_NOTHING_STATED = Rig()
_MOST_PASSES = 3  # over the scatter between dwells, which changes weights, hardly the answer


class Together(eqx.Module):
    """The joint estimate. `covariance` is of all coefficients, row-major (size, parameters)."""

    estimator: JointImu  # with the scatter that was found
    curve: Curve
    covariance: Float[AnyArray, "unknowns unknowns"]
    accel: TriadResult  # curve and marginal covariance of the triad's own parameters
    gyro: TriadResult
    converged: bool = eqx.field(static=True)

    @property
    def lever_arms(self) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, "9 9"]]:
        """Lever arms by rows, m, with their covariance by rows, m². Zero where they were not estimated."""
        count = len(self.estimator.names)
        arms = np.asarray(self.estimator.arms(np.asarray(self.curve.coefficients)[0]))
        own = np.arange(count - 9, count)
        known = self.estimator.lever_arms
        return arms, np.asarray(self.covariance)[np.ix_(own, own)] if known else np.zeros((9, 9))

    def alignment(self, temperature: float) -> Alignment:
        """The gyros' rotation against the accelerometers at one temperature, °C, by the joint covariance."""
        estimator, names = self.estimator, self.estimator.names
        phi = np.asarray(self.curve.basis(temperature))
        blocks = np.asarray(self.covariance).reshape(phi.size, len(names), phi.size, len(names))
        covariance = np.einsum("a,aibj,b->ij", phi, blocks, phi)
        vector = np.asarray(self.curve(temperature))
        theta = estimator.triad_map("gyro")[3:12]
        gyro = (theta @ vector).reshape(3, 3)
        if not isinstance(estimator.accel, ReferenceAccel):
            return inter_triad(gyro, theta @ covariance @ theta.T)
        gamma = estimator.triad_map("accel")[3:]
        rows = np.vstack([theta, gamma])
        return inter_triad(gyro, rows @ covariance @ rows.T, accel=(gamma @ vector).reshape(3, 3))

    @property
    def statements(self) -> tuple[str, ...]:
        """What the joint estimate says beyond the two triads', one line each."""
        nodes = self.curve.basis.nodes
        middle = float(sorted(nodes)[len(nodes) // 2])
        rotation = self.alignment(middle)
        sigma = np.sqrt(np.diagonal(np.asarray(rotation.covariance)))
        lines = ["accelerometers and gyros: one least squares over both"]
        if self.estimator.misalignment:
            shown = _with_sigmas(1e3 * np.asarray(rotation.rotation), 1e3 * sigma)
            lines.append(f"gyros against accelerometers: turned by {shown} mrad about x, y, z")
        if self.estimator.lever_arms:
            arms, covariance = self.lever_arms
            sigmas = np.sqrt(np.diagonal(covariance)).reshape(3, 3)
            for k, axis in enumerate("xyz"):
                shown = _with_sigmas(1e3 * arms[k], 1e3 * sigmas[k])
                unseen = ", ".join(np.array(list("xyz"))[arms[k] == 0.0])
                said = f"; no plateau shows that along {unseen}, held at zero ± the others' size"
                lines.append(
                    f"accelerometer {axis}: lever arm {shown} mm along x, y, z{said if unseen else ''}"
                )
        return tuple(lines)

    def effects(self, greatest_force: float) -> tuple[FittedEffect, ...]:
        """The lever arms as the catalogue's `size_effect`, one per accelerometer, for `Calibration.effects`.

        `greatest_force` is the greatest specific force in the data, g.
        """
        if not self.estimator.lever_arms:
            return ()
        arms, covariance = self.lever_arms
        basis = self.curve.basis
        scale = (basis.low, basis.high) if isinstance(basis, Polynomial) else (0.0, 1.0)
        return tuple(
            FittedEffect(
                "size_effect", "accel", (k,), (), arms[k],
                covariance[3 * k : 3 * k + 3, 3 * k : 3 * k + 3], "m",
                None, None, greatest_force, basis.size - 1, scale,
            )
            for k in range(3)
        )  # fmt: skip


def fit_together(
    estimator: JointImu,
    dwells: Dwells,
    *,
    degrees: tuple[int, int] = (0, 0),
    bounds: tuple[float, float] | None = None,
    rig: Rig = _NOTHING_STATED,
) -> Together:
    """One least squares over both triads' rows of the dwells.

    **Arguments:** `dwells` hold raw outputs of both triads (with `GravityRotation`, as `with_motions`
    makes them of uncompensated dwells); `degrees` of the accelerometers' and gyros' polynomials over
    temperature, scaled over `bounds` (°C; the dwells' own where absent); `rig` is what the station states,
    which is no slow noise. Each triad's own covariance holds its slow noise, that of both together none.

    Raises `ValueError` where a triad is missing or the dwells do not determine the unknowns.
    """
    for triad in ("accel", "gyro"):
        if getattr(dwells, triad) is None:
            raise ValueError(
                f"`fit_together(dwells=...)`: both triads are needed; {triad} is absent."
            )
    basis = _basis(max(degrees), dwells, bounds)
    free = _free(estimator, basis, degrees)
    estimator = _with_provisional(estimator, dwells)
    problem = Problem(estimator, basis, dwells)
    free = without_unseen_arms(problem, free)
    seen = _observable(problem, free)
    fit = _fit(estimator, basis, dwells, free)
    told = with_arms_told(estimator.names, fit.coefficients, fit.normal, free)
    if np.any(told != free):
        # From there: at a start without misalignment these arms would not show at all.
        free, fit = told, _fit(estimator, basis, dwells, told, fit.coefficients)
    shown = with_noise_shown(dwells, fit.gyro.misfit, fit.gyro.sigma, fit.gyro.unknowns)
    if shown is not dwells:
        dwells, fit = shown, _fit(estimator, basis, shown, free, fit.coefficients)
    for _ in range(_MOST_PASSES - 1):
        settled = _with_scatter(fit)
        if settled is None:
            break
        fit = _fit(settled, basis, dwells, free, fit.coefficients)
    covariance = covariance_beside(estimator.names, fit.coefficients, fit.normal, free)
    problem = Problem(fit.estimator, basis, dwells)
    accel, gyro = [
        with_slow_noise_of(
            problem, fit.coefficients, free, part.rows,
            _result(fit, triad, basis, covariance, degree, seen), rig,
        )
        for triad, part, degree in zip(("accel", "gyro"), (fit.accel, fit.gyro), degrees, strict=True)
    ]  # fmt: skip
    return Together(
        fit.estimator,
        Curve(basis, jnp.asarray(fit.coefficients)),
        covariance,
        accel,
        gyro,
        fit.converged,
    )


def _with_sigmas(values: Float[np.ndarray, "3"], sigmas: Float[np.ndarray, "3"]) -> str:
    return ", ".join(f"{v:.3g} ± {s:.2g}" for v, s in zip(values, sigmas, strict=True))


# Unknowns --------------------------------------------------------------------------------------------


def _basis(degree: int, dwells: Dwells, bounds: tuple[float, float] | None) -> AbstractBasis:
    if degree == 0:
        return Constant()
    probe = np.asarray(dwells.temperature)[np.asarray(dwells.valid)]
    return Polynomial(degree, *(bounds or (float(probe.min()), float(probe.max()))))


def _free(
    estimator: JointImu, basis: AbstractBasis, degrees: tuple[int, int]
) -> Bool[np.ndarray, "size parameter"]:
    """Which coefficients are unknowns; the others stay zero."""
    highest = [
        0 if "lever_arm" in name else degrees[name.startswith("gyro")] for name in estimator.names
    ]
    return np.arange(basis.size)[:, None] <= np.array(highest)[None, :]


def _observable(problem: Problem, free: Bool[np.ndarray, "size parameter"]) -> Observability:
    names = problem.estimator.names
    normal = problem.normal(problem.at(np.zeros(free.shape)).jacobian)
    own = np.flatnonzero(free.ravel())
    term = lambda k: f" (temperature term {k // len(names)})" if k >= len(names) else ""
    labels = tuple(names[k % len(names)] + term(k) for k in own)
    seen = judge_normal(normal[np.ix_(own, own)], labels, 1)
    if seen.rank < seen.unknowns:
        raise ValueError(
            f"accel and gyro together: the dwells do not determine {seen.unknowns - seen.rank} of "
            f"{seen.unknowns} unknowns: {'; '.join(seen.unseen[:3])}; lever arms need plateaus about axes "
            f"inclined to the case axes, Θ turns about all three."
        )
    return seen


# The solve -------------------------------------------------------------------------------------------


class _Part(NamedTuple):
    """The judged rows of one triad."""

    misfit: Float[np.ndarray, "dwells rows"]
    sigma: Float[np.ndarray, "dwells rows"]
    dwells: Dwells
    unknowns: int
    rows: tuple[
        Int[np.ndarray, " dwell"], slice
    ]  # the dwells that have them, and place in a dwell's


class _Fit(NamedTuple):
    """A solve with given weights."""

    estimator: JointImu
    coefficients: Float[np.ndarray, "size parameter"]
    normal: Float[np.ndarray, "unknowns unknowns"]
    residual: Float[np.ndarray, "dwells rows"]
    accel: _Part
    gyro: _Part
    num_steps: int
    converged: bool


def _fit(
    estimator: JointImu,
    basis: AbstractBasis,
    dwells: Dwells,
    free: Bool[np.ndarray, "size parameter"],
    start: Float[np.ndarray, "size parameter"] | None = None,
) -> _Fit:
    problem = Problem(estimator, basis, dwells)
    start = np.where(free, problem.start() if start is None else start, 0.0)
    coefficients, steps, converged = problem.solve(start, free=free)
    now = problem.at(coefficients)
    now = now._replace(misfit=problem.judged_misfit(now))
    seen = _seen_by(estimator, problem.vectors(coefficients)[: dwells.num_dwells], dwells)
    parts = _split(estimator, now, jax.tree.map(np.asarray, seen), free)
    normal = problem.normal(now.jacobian)
    return _Fit(estimator, coefficients, normal, now.residual, *parts, steps, converged)


@eqx.filter_jit
def _seen_by(estimator: JointImu, vectors: AnyArray, dwells: Dwells) -> tuple[Dwells, Dwells]:
    return jax.vmap(estimator.seen_by)(jnp.asarray(vectors), dwells)


# Each triad's part -----------------------------------------------------------------------------------


def _split(
    estimator: JointImu,
    now: LinearisedDwells,
    seen: tuple[Dwells, Dwells],
    free: Bool[np.ndarray, "size parameter"],
) -> tuple[_Part, _Part]:
    by_reference = isinstance(estimator.accel, ReferenceAccel)
    used = np.flatnonzero(np.asarray(estimator.accel.usable(seen[0]).valid))
    kept = np.flatnonzero(judged(seen[1]))
    first = 3 if by_reference else 1
    mine = np.array([n.startswith("accel") for n in estimator.names])
    accel = eqx.tree_at(lambda d: d.motion, seen[0], None, is_leaf=lambda x: x is None)[used]
    gyro = int(free[:, ~mine].any(axis=1).sum()) * num_judged(estimator.gyro, seen[1])
    return (
        _Part(
            now.misfit[used, :first],
            now.sigma[used, :first],
            accel,
            int(free[:, mine].sum()),
            (used, slice(0, first)),
        ),
        _Part(
            now.misfit[kept, first:],
            now.sigma[kept, first:],
            seen[1][kept],
            gyro,
            (kept, slice(first, None)),
        ),
    )


def _with_provisional(estimator: JointImu, dwells: Dwells) -> JointImu:
    return eqx.tree_at(
        lambda e: (e.accel, e.gyro),
        estimator,
        tuple(with_provisional_scatter(e, dwells) for e in (estimator.accel, estimator.gyro)),
    )


def _with_scatter(fit: _Fit) -> JointImu | None:
    """The estimator with the scatter that the misfits show; `None` where that is what it had."""
    old = fit.estimator.accel, fit.estimator.gyro
    new = tuple(
        with_scatter(own, part.misfit, part.sigma, part.unknowns)
        for own, part in zip(old, (fit.accel, fit.gyro), strict=True)
    )
    if all(float(n.scatter) == float(o.scatter) for n, o in zip(new, old, strict=True)):
        return None
    return eqx.tree_at(lambda e: (e.accel, e.gyro), fit.estimator, new)


def _result(
    fit: _Fit,
    triad: str,
    basis: AbstractBasis,
    covariance: Float[np.ndarray, "unknowns unknowns"],
    degree: int,
    seen: Observability,
) -> TriadResult:
    """Curve and marginal covariance in the triad's own parameters, up to its own degree."""
    own = fit.estimator.triad_map(triad)
    size = degree + 1
    coefficients = jnp.asarray((fit.coefficients @ own.T)[:size])
    spread = np.kron(np.eye(basis.size), own)[: size * len(own)]
    if isinstance(basis, Polynomial):
        basis = Polynomial(degree, basis.low, basis.high) if degree else Constant()
    done = optx.RESULTS.successful if fit.converged else optx.RESULTS.nonlinear_max_steps_reached
    part, estimator = (
        (fit.accel, fit.estimator.accel) if triad == "accel" else (fit.gyro, fit.estimator.gyro)
    )
    solution = ThermalSolution(
        curve=Curve(basis, coefficients),
        covariance=jnp.asarray(spread @ covariance @ spread.T),
        residuals=jnp.asarray(fit.residual),
        result=done,
        num_iterations=jnp.asarray(fit.num_steps),
        history=coefficients[None],
        step_sizes=jnp.full(1, jnp.nan),
        method="together",
    )
    scatter = float(estimator.scatter)
    return TriadResult(
        estimator=estimator,
        solution=solution,
        dwells=part.dwells,
        misfit=part.misfit,
        sigma=np.sqrt(np.square(part.sigma) + scatter**2),
        observability=seen,
        scatter=scatter,
        chi2_per_dof=chi2_per_dof(part.misfit, part.sigma, part.unknowns),
    )
