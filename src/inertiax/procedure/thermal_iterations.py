"""The calibration procedures over temperature: figure 1 of the paper, and what it grew into.

All of them estimate curves θ(T) = φ(T) C of one triad's parameters from the dwells of several
experiments in which the temperature need not be held.

* `PaperIteration`: refine every dwell with the curve at its own temperature (block 3), estimate
  each experiment as if its remaining parameters were constant (block 4), attribute the result to the
  experiment's mean temperature, compose by equation (6) (block 5), refit the curves. Faithful, but on
  some plans it crawls, stalls or diverges while the curves look harmless.
* `GaussNewtonIteration` (default): block 4 estimates the *curves'* correction from all experiments at once.
* `joint_fit`: one least squares with the coefficients C as unknowns.

`iterate` runs the first two as an optimistix fixed-point solve (init / step / terminate), so that
derivatives of the answer come from the implicit function theorem.
"""

import abc
from typing import ClassVar

import numpy as np
from jaxtyping import Bool, Float, Int

from .._jax import Array, eqx, jax, jnp, lx, optx
from .._typing import AnyArray
from ..estimators import AbstractEstimator, ReferenceAccel, ReferenceGyro
from ..estimators.base import check_estimator
from ..numerics.least_squares import least_squares, minimiser, outcome, without_derivatives
from ..numerics.linear_algebra import spd_inverse
from ..numerics.wide_arithmetic import in_64_bits
from ..physics.leaves import is_traced
from ..physics.temperature import AbstractBasis, Curve, interpolate
from ..reduction.dwells import by_experiment, check_dwells, Dwells, experiment_rows
from .rank import determines_all


class ThermalSolution(eqx.Module):
    """Curves with their covariance, and how they were reached."""

    curve: Curve
    covariance: Float[AnyArray, "unknowns unknowns"]  # of coefficients, row-major
    residuals: Float[AnyArray, "*batch dwells rows"]  # whitened; zero where the dwell was not used
    result: "optx.RESULTS"  # outcome as data; `outcome` in words
    num_iterations: Int[AnyArray, " *batch"]
    history: Float[AnyArray, "*batch iterations size parameters"]  # NaN beyond `num_iterations`
    step_sizes: Float[AnyArray, "*batch iterations"]  # largest change, in standard deviations
    method: str = eqx.field(static=True)

    @property
    def succeeded(self) -> Bool[AnyArray, " *batch"]:
        """Whether it converged with finite numbers and a Jacobian of full rank by the rule of `rank`."""
        xp = np if isinstance(self.covariance, np.ndarray) else jnp
        regular = xp.all(xp.isfinite(xp.diagonal(self.covariance, axis1=-2, axis2=-1)), axis=-1)
        return (self.result == optx.RESULTS.successful) & regular

    @property
    def outcome(self) -> str:
        """How one solve ended, in words. Raises `ValueError` for many or in traced code."""
        return outcome("solution.outcome", self.result, self.succeeded)


def dwell_residuals(
    estimator: AbstractEstimator, curve: Curve, dwells: Dwells
) -> Float[Array, "dwells rows"]:
    """Whitened residuals of all dwells at the curve's parameters; those that the estimator may not read (`usable`)
    give zeros."""

    def one(dwell: Dwells) -> Array:
        return estimator.residual(curve(dwell.temperature), dwell)

    rows = jax.vmap(one)(dwells)
    kept = jnp.asarray(estimator.usable(dwells).valid)
    return jnp.where(kept[:, None], rows, jnp.zeros_like(rows))


def _flat_residual(coefficients: Array, args: tuple) -> Array:
    estimator, basis, dwells = args
    curve = Curve(basis, coefficients.reshape(basis.size, -1))
    return dwell_residuals(estimator, curve, dwells).reshape(-1)


def normal_matrix(
    estimator: AbstractEstimator, curve: Curve, dwells: Dwells
) -> Float[Array, "unknowns unknowns"]:
    """JᵀJ of the whitened residuals with respect to the coefficients, row-major (size, parameters).

    A dwell's Jacobian is the Kronecker product of φ(T) and its parameter Jacobian, so the normal
    matrix is a sum of Kronecker products and the tall Jacobian is never built.
    """

    def one(dwell: Dwells) -> tuple[Array, Array]:
        phi = curve.basis(dwell.temperature)
        jacobian = jax.jacfwd(estimator.residual)(curve(dwell.temperature), dwell)
        weight = jnp.asarray(dwell.valid, phi.dtype)
        return phi, weight * (jacobian.T @ jacobian)

    phis, normals = jax.vmap(one)(estimator.usable(dwells))
    unknowns = curve.basis.size * estimator.num_parameters
    normal = jnp.einsum("na,nb,nij->aibj", phis, phis, normals)
    return normal.reshape(unknowns, unknowns)


def curve_covariance(
    estimator: AbstractEstimator, curve: Curve, dwells: Dwells
) -> Float[Array, "unknowns unknowns"]:
    """(JᵀJ)⁻¹ of the coefficients, row-major (size, parameters); NaN where the dwells do not determine all of them
    (`rank`)."""
    normal = normal_matrix(estimator, curve, dwells)
    known = determines_all(normal, estimator.names, curve.basis.size)
    return jnp.where(known, spd_inverse(normal), jnp.full_like(normal, jnp.nan))


class AbstractIteration(eqx.Module):
    """One pass of a procedure: coefficients to refined coefficients."""

    method: eqx.AbstractClassVar[str]
    estimator: eqx.AbstractVar[AbstractEstimator]
    basis: eqx.AbstractVar[AbstractBasis]

    @abc.abstractmethod
    def refine(
        self, coefficients: Float[AnyArray, "size parameters"], dwells: Dwells
    ) -> Float[Array, "size parameters"]:
        """Blocks 3 to 6 of figure 1: the next coefficients. A pure function."""


def _compensated(estimator: AbstractEstimator, curve: Curve, dwells: Dwells) -> Dwells:
    """Block 3: refine every dwell with the parameters at its own temperature."""
    return jax.vmap(lambda d: estimator.compensate(curve(d.temperature), d))(dwells)


def _constant_residual(vector: Array, args: tuple) -> Array:
    estimator, dwells = args
    rows = jax.vmap(lambda d: estimator.residual(vector, d))(dwells)
    kept = jnp.asarray(dwells.valid)[:, None]
    return jnp.where(kept, rows, jnp.zeros_like(rows)).reshape(-1)


class PaperIteration(AbstractIteration):
    """The paper's iteration, with its attribution of each experiment to one temperature.

    `rows` and `kept` list each experiment's dwells, as `experiment_rows` gives them.
    """

    method: ClassVar[str] = "paper"

    estimator: AbstractEstimator  # of one triad
    basis: AbstractBasis  # of the curves
    rows: Int[AnyArray, "experiments longest"]  # of the dwells in each experiment
    kept: Bool[AnyArray, "experiments longest"]  # False: a row that only pads

    def __init__(
        self,
        estimator: AbstractEstimator,
        basis: AbstractBasis,
        rows: Int[AnyArray, "experiments longest"] | None = None,
        kept: Bool[AnyArray, "experiments longest"] | None = None,
    ):
        """Raises `ValueError` without the rows of each experiment, which `plan` finds in dwells."""
        if rows is None or kept is None:
            raise ValueError(
                "`PaperIteration(estimator, basis)`: which dwells belong to which experiment is missing; "
                "`PaperIteration.plan(estimator, basis, dwells)` finds it."
            )
        self.estimator, self.basis, self.rows, self.kept = estimator, basis, rows, kept

    @classmethod
    def plan(
        cls, estimator: AbstractEstimator, basis: AbstractBasis, dwells: Dwells
    ) -> "PaperIteration":
        """Group the dwells by experiment. Raises `ValueError` with fewer experiments than basis
        functions, because the refit of the curves would have no unique answer."""
        used = estimator.usable(dwells)
        _check_rests("PaperIteration.plan(...)", estimator, used)
        rows, kept = experiment_rows(used)
        if len(rows) < basis.size:
            raise ValueError(
                f"`PaperIteration.plan(...)`: {len(rows)} experiments cannot determine curves with "
                f"{basis.size} coefficients; lower the temperature degree to {len(rows) - 1} or "
                f"record more experiments."
            )
        return cls(estimator, basis, rows, kept)

    def refine(
        self, coefficients: Float[AnyArray, "size parameters"], dwells: Dwells
    ) -> Float[Array, "size parameters"]:
        from ..numerics.dense_normal import DenseNormal

        temperature, composed = self.experiments(coefficients, dwells)
        design = lx.MatrixLinearOperator(jax.vmap(self.basis)(temperature))
        solve = lambda column: lx.linear_solve(design, column, DenseNormal(), throw=False).value
        return jax.vmap(solve, in_axes=1, out_axes=1)(composed)

    def experiments(
        self, coefficients: Float[AnyArray, "size parameters"], dwells: Dwells
    ) -> tuple[Float[Array, " experiments"], Float[Array, "experiments parameters"]]:
        """Blocks 3 to 5: each experiment's mean temperature (°C) and its refined parameters."""
        curve = Curve(self.basis, jnp.asarray(coefficients))
        stacked = by_experiment(_compensated(self.estimator, curve, dwells), self.rows, self.kept)
        zero = jnp.zeros(self.estimator.num_parameters, curve.coefficients.dtype)

        def block4(experiment: Dwells) -> Array:
            return minimiser(_constant_residual, zero, (self.estimator, experiment))

        weights = jnp.asarray(stacked.valid, zero.dtype)
        temperature = jnp.sum(weights * stacked.temperature, axis=1) / jnp.sum(weights, axis=1)
        corrections = jax.vmap(block4)(stacked)
        composed = jax.vmap(lambda t, c: self.estimator.compose(curve(t), c))(
            temperature, corrections
        )
        return temperature, composed


class GaussNewtonIteration(AbstractIteration):
    """The procedure with block 4 estimating the curves' corrections from all experiments at once.

    The correction curves are composed with the present ones by equation (6) at the basis' nodes;
    the composition of two curves has a higher degree, but as the corrections vanish nothing is lost.
    """

    method: ClassVar[str] = "gauss-newton"

    estimator: AbstractEstimator  # of one triad
    basis: AbstractBasis  # of the curves

    def refine(
        self, coefficients: Float[AnyArray, "size parameters"], dwells: Dwells
    ) -> Float[Array, "size parameters"]:
        curve = Curve(self.basis, jnp.asarray(coefficients))
        refined = _compensated(self.estimator, curve, dwells)
        zero = jnp.zeros(curve.coefficients.size, curve.coefficients.dtype)
        found = minimiser(_flat_residual, zero, (self.estimator, self.basis, refined))
        correction = Curve(self.basis, found.reshape(curve.coefficients.shape))
        nodes = jnp.asarray(self.basis.nodes, zero.dtype)
        composed = jax.vmap(lambda t: self.estimator.compose(curve(t), correction(t)))(nodes)
        return interpolate(self.basis, composed)


def start_curve(
    estimator: AbstractEstimator, basis: AbstractBasis, dwells: Dwells
) -> Float[Array, "size parameters"]:
    """Block 2: coefficients of a curve constant over temperature at the closed-form start."""
    vector = estimator.start(estimator.usable(dwells))
    return interpolate(basis, jnp.tile(vector[None, :], (basis.size, 1)))


def _refine_flat(coefficients: Array, args: tuple) -> Array:
    procedure, dwells, _ = args
    shape = (procedure.basis.size, -1)
    return procedure.refine(coefficients.reshape(shape), dwells).reshape(-1)


def _check(
    call: str,
    estimator: AbstractEstimator,
    basis: AbstractBasis,
    dwells: Dwells,
    start: AnyArray | None,
) -> None:
    """Raise `ValueError` for dwells that the estimator cannot read, or a start that is none of the basis."""
    check_estimator(call, estimator)
    check_dwells(call, dwells)
    shape = jnp.shape(dwells.valid)
    if len(shape) != 1:
        raise ValueError(
            f"`{call}`: the dwells have leading axes {shape[:-1]}, but this is for one device; `jax.vmap` it, or use "
            f"`ix.fit`."
        )
    for triad in ("accel", "gyro") if estimator.triad == "imu" else (estimator.triad,):
        by_reference = isinstance(estimator, ReferenceAccel | ReferenceGyro)
        wanted = (triad, f"reference_{triad}") if by_reference else (triad,)
        missing = [k for k in wanted if getattr(dwells, k) is None]
        if missing:
            raise ValueError(
                f"`{call}`: {type(estimator).__name__} reads {missing[0]}, which the dwells do not have."
            )
    _check_rests(call, estimator, estimator.usable(dwells))
    size = (basis.size, estimator.num_parameters)
    if start is not None and jnp.shape(start) != size:
        raise ValueError(f"`{call}`: start has shape {jnp.shape(start)}; it must be {size}.")


def _check_rests(call: str, estimator: AbstractEstimator, used: Dwells) -> None:
    """Raise `ValueError` where an estimator may read none of the dwells."""
    if is_traced(used.valid) or np.any(used.valid):
        return
    raise ValueError(
        f"`{call}`: {type(estimator).__name__} uses rests only, and none of the {used.num_dwells} dwells is one "
        f"(`position` -1 is a constant rate)."
    )


def iterate(
    procedure: AbstractIteration,
    dwells: Dwells,
    *,
    start: Float[AnyArray, "size parameters"] | None = None,
    max_iterations: int = 20,
    tolerance: float = 1e-6,
) -> ThermalSolution:
    """Run a procedure until the largest change is below `tolerance` standard deviations.

    For `PaperIteration` the first pass, from a curve constant over temperature, is the traditional
    thermostatted calibration; `history[1]` holds it, `history[3]` the paper's two iterations.
    Never raises for numerical reasons: see `result`. Derivatives of the curve's coefficients with
    respect to dwells and estimator fields are those of the fixed point.

    Computes in 64 bits whatever JAX is set to, as 32 do not reach the tolerance. Raises `ValueError` in code that
    was traced in 32, for dwells of several devices or without the triad, and for a `start` of another shape.
    """
    _check("iterate(procedure, dwells)", procedure.estimator, procedure.basis, dwells, start)
    run = lambda p, d, s: _iterate(p, d, s, max_iterations, tolerance)
    return in_64_bits("iterate(procedure, dwells)", run, procedure, dwells, start)


@eqx.filter_jit
def _iterate(
    procedure: AbstractIteration,
    dwells: Dwells,
    start: Float[AnyArray, "size parameters"] | None,
    max_iterations: int,
    tolerance: float,
) -> ThermalSolution:
    # Made of optimistix' solvers, for which a solve on the host need not wait.
    from ..numerics.dense_normal import DenseNormal
    from .recorded_iteration import RecordedIteration

    estimator, basis = procedure.estimator, procedure.basis
    given = without_derivatives((estimator, basis, dwells))
    first = start_curve(*given) if start is None else jax.lax.stop_gradient(jnp.asarray(start))
    variance = jnp.diagonal(curve_covariance(given[0], Curve(given[1], first), given[2]))
    sigma = jnp.sqrt(variance).reshape(first.shape)
    # A singular plan has NaN there; measure steps absolutely then and let the outcome tell.
    sigma = jnp.where(jnp.isfinite(sigma), sigma, jnp.ones_like(sigma))
    solution = optx.fixed_point(
        _refine_flat,
        RecordedIteration(atol=tolerance, max_iterations=max_iterations),
        first.reshape(-1),
        (procedure, dwells, sigma.reshape(-1)),
        max_steps=max_iterations,
        adjoint=optx.ImplicitAdjoint(linear_solver=DenseNormal()),
        throw=False,
    )
    curve = Curve(basis, solution.value.reshape(first.shape))
    return ThermalSolution(
        curve=curve,
        covariance=curve_covariance(estimator, curve, dwells),
        residuals=dwell_residuals(estimator, curve, dwells),
        result=solution.result,
        num_iterations=solution.stats["num_steps"],
        history=solution.stats["history"].reshape(-1, *first.shape),
        step_sizes=solution.stats["step_sizes"],
        method=procedure.method,
    )


def joint_fit(
    estimator: AbstractEstimator,
    basis: AbstractBasis,
    dwells: Dwells,
    *,
    start: Float[AnyArray, "size parameters"] | None = None,
    solver: "optx.AbstractLeastSquaresSolver | None" = None,
) -> ThermalSolution:
    """Least squares over all dwells with the curves' coefficients as the unknowns.

    Never raises for numerical reasons: see `result`. Derivatives of the coefficients with respect to
    the dwells and the estimator's fields follow from the implicit function theorem.

    Computes in 64 bits whatever JAX is set to, as 32 do not reach the tolerance. Raises `ValueError` in code that
    was traced in 32, for dwells of several devices or without the triad, and for a `start` of another shape.
    """
    _check("joint_fit(estimator, basis, dwells)", estimator, basis, dwells, start)
    run = lambda e, b, d, s: _joint_fit(e, b, d, s, solver)
    return in_64_bits("joint_fit(estimator, basis, dwells)", run, estimator, basis, dwells, start)


@eqx.filter_jit
def _joint_fit(
    estimator: AbstractEstimator,
    basis: AbstractBasis,
    dwells: Dwells,
    start: Float[AnyArray, "size parameters"] | None,
    solver: "optx.AbstractLeastSquaresSolver | None",
) -> ThermalSolution:
    given = without_derivatives((estimator, basis, dwells))
    first = start_curve(*given) if start is None else jnp.asarray(start)
    solution = least_squares(
        _flat_residual, first.reshape(-1), (estimator, basis, dwells), solver=solver
    )
    curve = Curve(basis, solution.parameters.reshape(first.shape))
    return ThermalSolution(
        curve=curve,
        covariance=curve_covariance(estimator, curve, dwells),
        residuals=dwell_residuals(estimator, curve, dwells),
        result=solution.result,
        num_iterations=solution.num_steps,
        history=jnp.stack([first, curve.coefficients]),
        step_sizes=jnp.full(2, jnp.nan, first.dtype),
        method="joint",
    )
