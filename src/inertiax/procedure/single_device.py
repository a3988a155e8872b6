"""The procedures for one device at a time, driven from the host.

`thermal_iterations.iterate` and `joint_fit` compile the whole loop into one program, which pays for fleets and for
derivatives of the answer, but takes ten seconds and more to compile. The same passes run here one by one: all dwells
are linearised at once, and `numerics.gauss_newton` takes the steps.

Estimators with a NumPy form (`estimators.host_forms`) are linearised by it, in 64 bits whatever JAX is set to. Others,
such as a user's own, are compiled; their dwells are padded to a few lengths, so that recordings of about the same
size share those programs (and the cache of compiled code).
"""

import numpy as np
from jaxtyping import Bool, Float

from .._jax import Array, eqx, jax, jnp, optx
from .._typing import AnyArray
from ..estimators import AbstractEstimator
from ..estimators.host_forms import AbstractHostForm, host_form, LinearisedDwells
from ..numerics.gauss_newton import solve_on_host
from ..numerics.linear_algebra import scaled_inverse
from ..physics.temperature import AbstractBasis, Curve
from ..reduction.dwells import Dwells
from .rank import has_full_rank
from .shared_errors import shared_errors
from .thermal_iterations import GaussNewtonIteration, ThermalSolution


_PATIENCE = 3  # passes in turn without a solution, after which the rows do not tell some unknown


class Problem:
    """One device's dwells with their estimator and basis, ready to be linearised again and again."""

    def __init__(self, estimator: AbstractEstimator, basis: AbstractBasis, dwells: Dwells):
        self.estimator = estimator
        self.basis = basis
        self.num_dwells = dwells.num_dwells
        self._given = np.asarray(dwells.valid)
        self.form = host_form(estimator)
        self.dwells = _prepared(estimator, dwells)
        self.phi = basis.rows(np.asarray(self.dwells.temperature))
        self.at_nodes = basis.at_nodes
        self.shared = shared_errors(estimator, estimator.usable(jax.tree.map(np.asarray, dwells)))

    def vectors(self, coefficients: AnyArray) -> Float[np.ndarray, "dwell parameter"]:
        """Each dwell's parameters, θ(T) = φ(T) C."""
        return self.phi @ np.asarray(coefficients)

    def at(self, coefficients: AnyArray, dwells: Dwells | None = None) -> LinearisedDwells:
        """Linearised at a curve's coefficients; `dwells` may stand in for the problem's own."""
        dwells = self.dwells if dwells is None else dwells
        parts = linearise(self.estimator, self.vectors(coefficients), dwells, self.form)
        return LinearisedDwells(*(part[: self.num_dwells] for part in parts))

    def start(self) -> Float[np.ndarray, "size parameter"]:
        """Block 2: a curve constant over temperature at the closed-form start."""
        start = (
            _start_vector(self.estimator, self.dwells)
            if self.form is None
            else self.form.start(self.dwells)
        )
        vector = np.asarray(start)
        return self.interpolated(np.tile(vector, (self.basis.size, 1)))

    def interpolated(
        self, values: Float[np.ndarray, "size parameter"]
    ) -> Float[np.ndarray, "size parameter"]:
        """Coefficients of the curve with these values at the basis' nodes: `temperature.interpolate`
        on the host, without a program for each of its steps."""
        return np.linalg.solve(self.at_nodes, values)

    def solve(
        self,
        start: Float[np.ndarray, "size parameter"],
        dwells: Dwells | None = None,
        *,
        free: Bool[np.ndarray, "size parameter"] | None = None,
    ) -> tuple[Float[np.ndarray, "size parameter"], int, bool]:
        """Least squares over all dwells: the coefficients, steps taken, whether it converged.

        Coefficients that are not `free` keep their start.
        """
        chosen = np.ones(start.shape, bool) if free is None else free

        def filled(unknowns: np.ndarray) -> np.ndarray:
            coefficients = start.copy()
            coefficients[chosen] = unknowns
            return coefficients

        def rows(unknowns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            design, residual = self.rows(filled(unknowns), dwells)
            return design[:, chosen.ravel()], residual

        unknowns, taken, converged = solve_on_host(rows, start[chosen])
        return filled(unknowns), taken, converged

    def covariance(
        self, coefficients: Float[np.ndarray, "size parameter"]
    ) -> Float[np.ndarray, "unknowns unknowns"]:
        """(JᵀJ)⁻¹ of the coefficients, row-major (size, parameters); NaN where the dwells do not determine all of
        them (`rank`)."""
        normal = self.normal(self.at(coefficients).jacobian)
        if not has_full_rank(normal, self.estimator.names, self.basis.size):
            return np.full_like(normal, np.nan)
        return scaled_inverse(normal)

    def compensated(self, coefficients: AnyArray) -> Dwells:
        """The dwells (without padding) refined with a curve's coefficients, block 3; `valid` as it was given."""
        refined = self.refined(coefficients)
        shortened = jax.tree.map(lambda x: np.asarray(x)[: self.num_dwells], refined)
        return eqx.tree_at(lambda d: d.valid, shortened, self._given)

    def refined(self, coefficients: AnyArray) -> Dwells:
        """As `compensated`, with the padding."""
        vectors = self.vectors(coefficients)
        if self.form is not None:
            return self.form.compensate(vectors, self.dwells)
        return _compensate(self.estimator, vectors, self.dwells)

    def normal(self, jacobian: Float[np.ndarray, "dwell row parameter"]) -> np.ndarray:
        """JᵀJ with respect to the coefficients, row-major (size, parameters); JᵀV⁻¹J where dwells share errors."""
        if self.shared is not None:
            design = self.decorrelated(self.design(jacobian))
            return design.T @ design
        phi, unknowns = self.phi[: self.num_dwells], self.basis.size * jacobian.shape[2]
        products = np.einsum("nri,nrj->nij", jacobian, jacobian)
        return np.einsum("na,nb,nij->aibj", phi, phi, products, optimize=True).reshape(
            unknowns, unknowns
        )

    def rows(
        self, coefficients: AnyArray, dwells: Dwells | None = None
    ) -> tuple[Float[np.ndarray, "row unknown"], Float[np.ndarray, " row"]]:
        """The residual's Jacobian with respect to the coefficients, row-major (size, parameters), and the residual,
        of unit covariance where dwells share errors, too."""
        now = self.at(coefficients, dwells)
        design, residual = self.design(now.jacobian), now.residual.reshape(-1)
        return self.decorrelated(design), self.decorrelated(residual)

    def design(
        self, jacobian: Float[np.ndarray, "dwell row parameter"]
    ) -> Float[np.ndarray, "rows unknown"]:
        """The dwells' Jacobians by their own parameters as those by the coefficients, row-major (size, parameters)."""
        full = np.einsum("na,nri->nrai", self.phi[: self.num_dwells], jacobian)
        return full.reshape(jacobian.shape[0] * jacobian.shape[1], -1)

    def decorrelated(self, rows: Float[np.ndarray, "row ..."]) -> Float[np.ndarray, "row ..."]:
        """Whitened rows without what the dwells share, of unit covariance."""
        if self.shared is None:
            return rows
        by_dwell = rows.reshape(self.num_dwells, len(rows) // self.num_dwells, -1)
        return np.asarray(self.shared.decorrelated(by_dwell)).reshape(rows.shape)

    def weighted(self, decorrelated: Float[np.ndarray, "row ..."]) -> Float[np.ndarray, "row ..."]:
        """Sᵀ times rows that `decorrelated` made, S x, of whitened rows x: V⁻¹ x, V their covariance."""
        if self.shared is None:
            return decorrelated
        by_dwell = decorrelated.reshape(self.num_dwells, len(decorrelated) // self.num_dwells, -1)
        return np.asarray(self.shared.weighted(by_dwell)).reshape(decorrelated.shape)

    def judged_misfit(self, now: LinearisedDwells) -> Float[np.ndarray, "dwell misfit"]:
        """The misfit in SI as the dwells' own noise makes it: without what several dwells share."""
        if self.shared is None:
            return now.misfit
        return np.asarray(self.shared.of_misfit(now.misfit, now.residual))


def iterate_one(
    estimator: AbstractEstimator,
    basis: AbstractBasis,
    dwells: Dwells,
    *,
    max_iterations: int = 20,
    tolerance: float = 1e-6,
    start: Float[np.ndarray, "size parameter"] | None = None,
) -> ThermalSolution:
    """`iterate(GaussNewtonIteration(estimator, basis), dwells)`, but compiled in a second or two.

    Passes, convergence tests and result are the same to rounding where it converges; it gives up after `_PATIENCE`
    passes in turn whose least squares do not. There are no derivatives of it. `start` are coefficients near the
    answer, such as those under other weights, where there are some.
    """
    problem = Problem(estimator, basis, dwells)
    coefficients = problem.start() if start is None else start
    covariance = problem.covariance(coefficients)
    sigma = np.sqrt(np.diagonal(covariance)).reshape(coefficients.shape)
    sigma = np.where(np.isfinite(sigma), sigma, 1.0)
    history, steps, unsolved = [coefficients], [np.nan], 0
    while len(history) <= max_iterations and not steps[-1] < tolerance and unsolved < _PATIENCE:
        refined = problem.refined(coefficients)
        correction, _, solved = problem.solve(np.zeros_like(coefficients), refined)
        unsolved = 0 if solved else unsolved + 1
        new = _composed(problem, coefficients, correction)
        steps.append(float(np.max(np.abs(new - coefficients) / sigma)))
        history.append(new)
        coefficients = new
    converged = steps[-1] < tolerance
    if problem.shared is not None:
        # Compensated rows are the whitened ones turned by an angle of the order of the misalignments, and what dwells
        # share is not turned with them: thousandths of a standard deviation, which these steps take away.
        coefficients, _, settled = problem.solve(coefficients)
        converged = converged and settled
    return _solution(
        problem,
        coefficients,
        converged=converged,
        history=_filled(history, max_iterations + 1),
        steps=_filled(steps, max_iterations + 1),
        num_iterations=len(history) - 1,
        method=GaussNewtonIteration.method,
    )


def joint_fit_one(
    estimator: AbstractEstimator, basis: AbstractBasis, dwells: Dwells
) -> ThermalSolution:
    """`joint_fit(estimator, basis, dwells)`, compiled in a second or two; no derivatives of it."""
    problem = Problem(estimator, basis, dwells)
    first = problem.start()
    coefficients, num_steps, converged = problem.solve(first)
    return _solution(
        problem,
        coefficients,
        converged=converged,
        history=np.stack([first, coefficients]),
        steps=np.full(2, np.nan),
        num_iterations=num_steps,
        method="joint",
    )


def padded(dwells: Dwells) -> Dwells:
    """The dwells, padded by its last with `valid` False to the next of 8, 10, 12, 14, 16, 20, …"""
    count = dwells.num_dwells
    grain = max(2 ** ((count - 1).bit_length() - 3), 2)
    length = max(-(-count // grain) * grain, 8)
    rows = np.minimum(np.arange(length), count - 1)
    result = jax.tree.map(lambda x: np.asarray(x)[rows], dwells)
    valid = result.valid & (np.arange(length) < count)
    return eqx.tree_at(lambda d: d.valid, result, valid)


def linearise(
    estimator: AbstractEstimator,
    vectors: AnyArray,
    dwells: Dwells,
    form: AbstractHostForm | None = None,
) -> LinearisedDwells:
    """Residuals, their Jacobians, misfits and sigmas of dwells, each at its own parameters (dwell, parameter).

    `form` is the estimator's NumPy form where that was made before.
    """
    form, vectors = form or host_form(estimator), np.asarray(vectors, float)
    if form is not None:
        return form.linearise(vectors, dwells)
    longer = padded(dwells)
    own = vectors[np.minimum(np.arange(longer.num_dwells), len(vectors) - 1)]
    parts = _compiled(estimator, own, longer)
    return LinearisedDwells(*(np.asarray(x)[: len(vectors)] for x in parts))


def _prepared(estimator: AbstractEstimator, dwells: Dwells) -> Dwells:
    """Dwells as NumPy arrays, those `valid` that the estimator may read; padded where a program is compiled for their
    number."""
    dwells = estimator.usable(jax.tree.map(np.asarray, dwells))
    if host_form(estimator) is None:
        return padded(dwells)
    return dwells


@eqx.filter_jit
def _compiled(estimator: AbstractEstimator, vectors: AnyArray, dwells: Dwells) -> tuple[Array, ...]:

    def one(vector: Array, dwell: Dwells) -> tuple[Array, ...]:
        def rows(v: Array) -> tuple[Array, tuple[Array, ...]]:
            residual = estimator.residual(v, dwell)
            return residual, (residual, *estimator.misfit(v, dwell))

        jacobian, (residual, misfit, sigma) = jax.jacfwd(rows, has_aux=True)(vector)
        kept = lambda x: jnp.where(dwell.valid, x, jnp.zeros_like(x))
        return kept(residual), kept(jacobian), misfit, sigma

    return jax.vmap(one)(jnp.asarray(vectors), dwells)


@eqx.filter_jit
def _compensate(estimator: AbstractEstimator, vectors: AnyArray, dwells: Dwells) -> Dwells:
    return jax.vmap(estimator.compensate)(vectors, dwells)


@eqx.filter_jit
def _compose(estimator: AbstractEstimator, first: AnyArray, second: AnyArray) -> Array:
    return jax.vmap(estimator.compose)(first, second)


@eqx.filter_jit
def _start_vector(estimator: AbstractEstimator, dwells: Dwells) -> Array:
    return estimator.start(dwells)


def compose_on_host(
    estimator: AbstractEstimator, first: np.ndarray, second: np.ndarray
) -> Float[np.ndarray, "sets parameter"]:
    """Equation (6) for sets of parameters, one a row."""
    form = host_form(estimator)
    return np.asarray(
        _compose(estimator, first, second) if form is None else form.compose(first, second)
    )


def _composed(
    problem: Problem, first: np.ndarray, second: np.ndarray
) -> Float[np.ndarray, "size parameter"]:
    """Equation (6) at the basis' nodes."""
    at_nodes = problem.at_nodes
    return problem.interpolated(
        compose_on_host(problem.estimator, at_nodes @ first, at_nodes @ second)
    )


def _solution(
    problem: Problem,
    coefficients: np.ndarray,
    *,
    converged: bool,
    history: np.ndarray,
    steps: np.ndarray,
    num_iterations: int,
    method: str,
) -> ThermalSolution:
    done = optx.RESULTS.successful if converged else optx.RESULTS.nonlinear_max_steps_reached
    return ThermalSolution(
        curve=Curve(problem.basis, coefficients),
        covariance=problem.covariance(coefficients),
        residuals=problem.at(coefficients).residual,
        result=done,
        num_iterations=np.asarray(num_iterations),
        history=history,
        step_sizes=steps,
        method=method,
    )


def _filled(values: list, length: int) -> np.ndarray:
    stacked = np.asarray(values)
    result = np.full((length, *stacked.shape[1:]), np.nan)
    result[: len(stacked)] = stacked
    return result
