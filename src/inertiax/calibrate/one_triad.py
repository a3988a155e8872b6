"""One triad's least squares over temperature: what it may use, whether that determines it, the estimate."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Bool, Float, Int

from .._jax import eqx, jax, optx
from ..data.recording import Rig
from ..estimators import AbstractEstimator, ESTIMATORS, NOMINAL_SIGMA
from ..model_selection.select_model import ChosenModel, polynomial_basis
from ..model_selection.temperature_degree import (
    biases_follow,
    choose_degree,
    SPARE,
    temperature_levels,
    UNDETERMINED,
)
from ..physics.temperature import AbstractBasis, Constant
from ..procedure.convergence import convergence_rate, rate_warning
from ..procedure.single_device import iterate_one, joint_fit_one, Problem
from ..procedure.thermal_iterations import iterate, PaperIteration, ThermalSolution
from ..reduction.dwells import Dwells
from .between_dwell_variance import (
    chi2_per_dof,
    judged,
    noise_is_untold,
    num_judged,
    with_provisional_scatter,
    with_scatter,
)
from .goodness_of_fit import LIMITS
from .misfit_pattern import misfit_pattern
from .observability import judge_normal, Observability
from .results import TriadResult
from .slow_noise import SlowNoise, with_slow_noise


Progress = Callable[[str], None]
FEW_TEMPERATURES = "too few temperatures"
NO_RIG = Rig()  # that promises nothing


class TooHighDegree(ValueError):
    """A degree over temperature that leaves nothing to judge the fit by."""


def estimate_triad(
    estimator: AbstractEstimator,
    dwells: Dwells,
    chosen: ChosenModel,
    method: str,
    progress: Progress,
    choices: list[str],
    warnings: list[str],
    *,
    rig: Rig = NO_RIG,
) -> TriadResult:
    """The estimate of a triad over temperature, weighted by the scatter between dwells.

    **Arguments:** `rig` is what the dwells' covariances hold of the rig's errors.

    What was chosen is added to `choices`, what gives doubt to `warnings`. Raises `ValueError` where the dwells do not
    determine the model, or the iteration does not converge.
    """
    estimator = with_provisional_scatter(estimator, dwells)
    dwells = jax.tree.map(np.asarray, dwells)
    degree = chosen.degree(estimator.triad)
    asked = (
        bool(degree) and not chosen.fixed
    )  # by `[model]`; what the tool takes has equations to spare
    reason = ""
    if degree is None:
        degree, reason = choose_degree(estimator, dwells)
        choices.append(f"{estimator.triad}: {reason}")
    basis = polynomial_basis(degree, dwells)
    seen = require_observable(estimator, basis, dwells, spare=SPARE if asked else 0)
    progress(f"estimating {estimator.triad} ({basis.size * estimator.num_parameters} unknowns)")
    try:
        settled = _settled(estimator, basis, dwells, method)
    except ValueError as error:
        if method != "gauss-newton":
            raise
        try:  # in smaller steps
            settled = _settled(estimator, basis, dwells, "joint")
        except ValueError:
            raise error from None
        choices.append(
            f"{estimator.triad}: estimated by the joint fit, because the procedure's iteration did not converge"
        )
    estimator, solution, misfit, own_sigma, own_chi2 = settled
    if method == "paper":
        procedure = PaperIteration.plan(estimator, basis, dwells)
        rate = convergence_rate(procedure, solution.curve.coefficients, dwells)
        warning = rate_warning(procedure, rate, dwells)
        warnings.extend([] if warning is None else [warning])
    if (
        reason == UNDETERMINED
        and own_chi2 > LIMITS.noise_ratio**2
        and biases_follow(estimator, dwells)
    ):
        warnings.append(_constants_beside_slopes(estimator, dwells, misfit, own_chi2))
    scatter = float(estimator.scatter)
    solution, slow = _with_slow_noise(estimator, solution, dwells, rig)
    kept = judged(dwells)
    return TriadResult(
        estimator=estimator,
        solution=solution,
        dwells=dwells[kept],
        misfit=misfit,
        sigma=np.sqrt(np.square(own_sigma) + scatter**2),
        observability=seen,
        scatter=scatter,
        chi2_per_dof=own_chi2,
        follows=misfit_pattern(estimator, basis, np.asarray(solution.curve.coefficients), dwells),
        slow_noise=slow,
        fitted=None if np.all(kept) else dwells,
    )


def _constants_beside_slopes(
    estimator: AbstractEstimator, dwells: Dwells, misfit: np.ndarray, chi2: float
) -> str:
    """What to do where biases follow temperature and only constants are determined."""
    low, high = float(np.min(dwells.temperature)), float(np.max(dwells.temperature))
    told = (
        f"{estimator.triad}: biases follow temperature, {low:.0f} to {high:.0f} °C, and the poses hardly tell so of "
        f"every parameter: constants leave {np.sqrt(chi2):.0f} times the noise, and may be off by more than is stated. "
        "Take more poses, the same cold and warm"
    )
    if misfit.size < 2 * estimator.num_parameters + SPARE:  # which degree 1 would be refused for
        return told
    return (
        f"{told}, or degree 1 (`temperature_degree = 1` under [model], `ModelChoice(temperature_degree=1)`), and "
        '`calibration.conditioned("*.matrix.c1")` for biases alone that follow it'
    )


def _with_slow_noise(
    estimator: AbstractEstimator, solution: ThermalSolution, dwells: Dwells, rig: Rig
) -> tuple[ThermalSolution, SlowNoise]:
    """The solution with the covariance of dwells that err alike, where they do."""
    if not np.all(np.asarray(dwells.valid)):
        return solution, SlowNoise()
    problem = Problem(estimator, solution.curve.basis, dwells)
    coefficients, own = np.asarray(solution.curve.coefficients), np.asarray(solution.covariance)
    whole, slow = with_slow_noise(problem, coefficients, own, rig)
    return eqx.tree_at(lambda s: s.covariance, solution, whole), slow


def _settled(
    estimator: AbstractEstimator, basis: AbstractBasis, dwells: Dwells, method: str
) -> tuple[AbstractEstimator, ThermalSolution, np.ndarray, np.ndarray, float]:
    """The estimator with its scatter between dwells, solution, misfit with its standard deviation, and χ² per degree of
    freedom before there was scatter.

    Raises `ValueError` where the iteration does not converge.
    """
    kept = judged(dwells)
    # Two passes settle the scatter between dwells: it changes the weights, hardly the answer.
    unknowns = basis.size * num_judged(estimator, dwells)
    solution = _solve(estimator, basis, dwells, method)
    misfit, own_sigma = _misfits(estimator, solution, dwells, kept)
    own_chi2 = chi2_per_dof(misfit, own_sigma, unknowns)
    for _ in range(2):
        if not np.all(np.isfinite(misfit)):
            raise ValueError(_failure(estimator, solution, dwells, method))
        settled = with_scatter(estimator, misfit, own_sigma, unknowns)
        if noise_is_untold(dwells, misfit.size - unknowns):  # but for rounding
            settled = eqx.tree_at(lambda e: e.scatter, settled, np.asarray(NOMINAL_SIGMA))
        if float(settled.scatter) == float(estimator.scatter):
            break
        estimator, before = settled, solution
        solution = _solve(estimator, basis, dwells, method, before)
        misfit, own_sigma = _misfits(estimator, solution, dwells, kept)
    if not bool(solution.succeeded):
        if bool(solution.result == optx.RESULTS.successful):
            # What the noise of the means determined may be too little beside the scatter between dwells.
            require_observable(estimator, basis, dwells)
        raise ValueError(_failure(estimator, solution, dwells, method))
    return estimator, solution, misfit, own_sigma, own_chi2


def require_observable(
    estimator: AbstractEstimator, basis: AbstractBasis, dwells: Dwells, *, spare: int = 0
) -> Observability:
    """What the dwells show of the model at the ideal triad.

    Raises `ValueError` where they do not determine all unknowns, with the combinations that are not seen;
    `TooHighDegree` where they do, with fewer than `spare` equations more.
    """
    problem = Problem(estimator, basis, dwells)
    ideal = problem.at(np.zeros((basis.size, estimator.num_parameters)))
    rows = int(judged(dwells).sum()) * ideal.misfit.shape[1]
    if dwells.motion is not None:
        rows += 3 * dwells.num_dwells  # the rates at rest
    unknowns = basis.size * estimator.num_parameters
    temperature = (
        "" if basis.size == 1 else f" ({estimator.num_parameters} at each of {basis.size} terms)"
    )
    if rows < unknowns:
        few = _too_few_for_the_degree(estimator, basis, dwells)
        raise ValueError(
            f"{estimator.triad}: {few[0]}: {dwells.num_dwells} dwells give {rows} equations "
            f"for {unknowns} unknowns{temperature}; {few[1]}."
        )
    if rows < unknowns + spare:
        raise TooHighDegree(
            f"{estimator.triad}: temperature_degree = {basis.size - 1} asks for {unknowns} unknowns{temperature}, and "
            f"{dwells.num_dwells} dwells give {rows} equations, so that nothing is left to judge the fit by; use a "
            "lower degree (0 for constants), or record more positions."
        )
    seen = judge_normal(problem.normal(ideal.jacobian), estimator.names, basis.size)
    if seen.rank < seen.unknowns:
        few = _too_few_for_the_degree(estimator, basis, dwells)
        if few[0] == FEW_TEMPERATURES:
            raise ValueError(
                f"{estimator.triad}: {few[0]} do not determine {seen.unknowns - seen.rank} of {seen.unknowns} "
                f"unknowns{temperature}; {few[1]}."
            )
        raise ValueError(
            f"{estimator.triad}: the positions do not determine {seen.unknowns - seen.rank} of "
            f"{seen.unknowns} unknowns{temperature}: {'; '.join(seen.unseen[:3])}; {_more(estimator, basis, dwells)}"
            f"{_biases_alone(estimator, problem, ideal.jacobian)}."
        )
    return seen


def _too_few_for_the_degree(
    estimator: AbstractEstimator, basis: AbstractBasis, dwells: Dwells
) -> tuple[str, str]:
    """What there is too little of, and what helps: temperatures or dwells where the positions by themselves determine a
    model without temperature, else positions."""
    problem = Problem(estimator, Constant(), dwells)
    ideal = problem.at(np.zeros((1, estimator.num_parameters)))
    alone = judge_normal(problem.normal(ideal.jacobian), estimator.names, 1)
    if basis.size == 1 or alone.rank < alone.unknowns:
        return "too few positions", "record more positions in different orientations"
    levels = temperature_levels(np.asarray(dwells.temperature)[np.asarray(dwells.valid)])
    degree, least = basis.size - 1, "use a lower degree (0 for constants)"
    if levels <= degree:
        many = f"at {levels} temperatures" if levels > 1 else "all at one temperature"
        return FEW_TEMPERATURES, (
            f"the positions suffice, but they are {many}, and temperature_degree = {degree} needs {basis.size}; "
            f"{least}, or record the positions at more temperatures"
        )
    return "too few dwells for the temperature_degree", (
        f"the positions suffice for constants, but not for temperature_degree = {degree}: {least}, or record more "
        "positions at each temperature"
    )


def _more(estimator: AbstractEstimator, basis: AbstractBasis, dwells: Dwells) -> str:
    """What would show more of a model, or take less: for gyros against known rates, rates."""
    rates = estimator.by_reference and estimator.triad == "gyro"
    ways = [
        f"add {'rates about other axes' if rates else 'positions in other orientations'} (or temperatures)"
    ]
    if basis.size > 1:
        ways.append("use a lower temperature_degree")
    if rates and dwells.accel is not None:
        ways.append(
            'write gyro_estimator = "gravity" under [model], by which turns between rests tell a matrix'
        )
    return ", or ".join(ways)


def _biases_alone(
    estimator: AbstractEstimator, problem: Problem, jacobian: Float[np.ndarray, "dwell row unknown"]
) -> str:
    """The way out where references are of too few poses for a matrix, and determine biases."""
    biases = [k for k, name in enumerate(estimator.names) if ".bias[" in name]
    names = tuple(estimator.names[k] for k in biases)
    if not estimator.by_reference or "static" not in ESTIMATORS[estimator.triad] or not biases:
        return ""
    normal = problem.normal(jacobian)
    size = len(normal) // estimator.num_parameters
    kept = np.ravel(np.arange(size)[:, None] * estimator.num_parameters + biases)
    alone = judge_normal(normal[np.ix_(kept, kept)], names, size)
    if alone.rank < alone.unknowns:
        return ""
    return (
        f', or write {estimator.triad}_estimator = "static" under [model], for biases against their references '
        "alone"
    )


def rows_for(triad: str, chosen: ChosenModel, dwells: Dwells) -> Dwells:
    """The dwells that the triad's estimator may read (`usable`).

    Raises `ValueError` where there are none.
    """
    name = chosen.accel_estimator if triad == "accel" else chosen.gyro_estimator
    kind = AbstractEstimator if name is None else ESTIMATORS[triad][name]
    kept = np.asarray(kind.usable(dwells).valid)
    if kept.any():
        return dwells if kept.all() else dwells[np.flatnonzero(kept)]
    if not kind.by_reference:
        return dwells[rests_of(dwells, triad)]
    raise ValueError(
        f"the reference_{triad} columns: zero or empty in every rest and plateau; give what an ideal triad would read "
        f"at rest, or leave the columns out."
    )


def rests_of(dwells: Dwells, triad: str) -> Int[np.ndarray, " rest"]:
    """Numbers of the dwells at rest. Raises `ValueError` where there are none."""
    rests = np.flatnonzero(np.asarray(dwells.position) >= 0)
    if len(rests) == 0:
        raise ValueError(
            f"the {triad} columns: no rests were found; calibration at rest needs the device to stand "
            f"still for several seconds in each position."
        )
    return rests


def with_refined_force(result: TriadResult, dwells: Dwells) -> Dwells:
    """Dwells with compensated accelerometer outputs, for the gyros' D term."""
    return Problem(result.estimator, result.solution.curve.basis, dwells).compensated(
        result.solution.curve.coefficients
    )


def _solve(
    estimator: AbstractEstimator,
    basis: AbstractBasis,
    dwells: Dwells,
    method: str,
    before: ThermalSolution | None = None,
) -> ThermalSolution:
    """The solution, by the default method from one under other weights, with the iterations of both."""
    if method == "joint":
        return joint_fit_one(estimator, basis, dwells)
    if method == "paper":
        solution = iterate(PaperIteration.plan(estimator, basis, dwells), dwells)
        return _with_shared_errors(solution, Problem(estimator, basis, dwells))
    if before is None or not bool(before.succeeded):
        return iterate_one(estimator, basis, dwells)
    start = np.asarray(before.curve.coefficients)
    found = iterate_one(estimator, basis, dwells, start=start)
    taken = before.num_iterations + found.num_iterations
    return eqx.tree_at(lambda s: s.num_iterations, found, taken)


def _with_shared_errors(solution: ThermalSolution, problem: Problem) -> ThermalSolution:
    """The paper's procedure weighs dwells one by one: what they share passes into its covariance P as P JᵀUUᵀJ P."""
    if problem.shared is None:
        return solution
    own = np.asarray(solution.covariance)
    jacobian = problem.at(solution.curve.coefficients).jacobian
    moved = own @ problem.design(jacobian).T @ problem.shared.signatures
    return eqx.tree_at(lambda s: s.covariance, solution, own + moved @ moved.T)


def _misfits(
    estimator: AbstractEstimator,
    solution: ThermalSolution,
    dwells: Dwells,
    kept: Bool[np.ndarray, " dwell"],
) -> tuple[np.ndarray, np.ndarray]:
    """Misfit and its standard deviation by the dwells' own noise, of the dwells that are judged."""
    problem = Problem(estimator, solution.curve.basis, dwells)
    now = problem.at(solution.curve.coefficients)
    return problem.judged_misfit(now)[kept], now.sigma[kept]


def _failure(
    estimator: AbstractEstimator, solution: ThermalSolution, dwells: Dwells, method: str
) -> str:
    text = (
        f"{estimator.triad}: the '{method}' estimation did not converge "
        f"({int(solution.num_iterations)} iterations)"
    )
    if method != "paper":
        return text + "; look for wrong units, a saturated axis or rests that are not at rest."
    procedure = PaperIteration.plan(estimator, solution.curve.basis, dwells)
    exact = joint_fit_one(estimator, solution.curve.basis, dwells)
    rate = convergence_rate(procedure, exact.curve.coefficients, dwells)
    return f"{text}: {rate_warning(procedure, rate, dwells) or 'use the default method'}."
