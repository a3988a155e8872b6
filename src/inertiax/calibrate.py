"""From a campaign to calibrations: reduce, choose, estimate, judge; one device at a time."""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from scipy.stats import chi2

from ._typing import AnyArray
from .calibration import Calibration, TriadCalibration
from .choose import build_estimators, choose_degree, choose_model, ChosenModel, polynomial_basis
from .dwells import Dwells
from .estimators import AbstractEstimator, NOMINAL_SIGMA
from .intervals import reduce_to_dwells
from .procedure import (
    convergence_rate,
    extra_scatter,
    GaussNewtonIteration,
    iterate,
    joint_fit,
    PaperIteration,
    rate_warning,
    ThermalSolution,
)
from .recordings import Campaign
from .temperature import AbstractBasis
from .uncertainty import observability, Observability


METHODS = ("gauss-newton", "joint", "paper")

Progress = Callable[[str], None]


class TriadResult(eqx.Module):
    """One triad's estimate with what is needed to judge and draw it."""

    estimator: AbstractEstimator
    solution: ThermalSolution
    dwells: Dwells  # those that were used
    misfit: Float[AnyArray, "dwells rows"]  # m/s² or rad/s, after the fit
    sigma: Float[AnyArray, "dwells rows"]  # of each misfit, dwell noise and scatter together
    observability: Observability
    scatter: float = eqx.field(static=True)  # m/s² or rad/s, found between dwells
    chi2_per_dof: float = eqx.field(static=True)  # with the dwells' own noise only; NaN if unknown

    @property
    def rms(self) -> float:
        """Root mean square of the misfit, m/s² or rad/s."""
        return float(np.sqrt(np.mean(np.square(np.asarray(self.misfit)))))


class DeviceResult(eqx.Module):
    """A calibrated device."""

    calibration: Calibration
    accel: TriadResult | None
    gyro: TriadResult | None
    choices: tuple[str, ...] = eqx.field(static=True)
    warnings: tuple[str, ...] = eqx.field(static=True)


class DeviceFailure(eqx.Module):
    """A device that could not be calibrated, and why, in one line."""

    device: str = eqx.field(static=True)
    reason: str = eqx.field(static=True)


def calibrate(
    campaign: Campaign,
    *,
    method: str = "gauss-newton",
    robust: float | None = None,
    progress: Progress | None = None,
) -> tuple[DeviceResult | DeviceFailure, ...]:
    """Calibrate every device of a campaign. A bad device becomes a `DeviceFailure`, not an error.

    **Arguments:** `method` is "gauss-newton" (the procedure as a Gauss-Newton method), "joint" or
    "paper"; `robust` a pseudo-Huber threshold in standard deviations; `progress` is called with a
    line of text at each stage.
    """
    if method not in METHODS:
        raise ValueError(f"`calibrate(method={method!r})`: method must be one of {list(METHODS)}.")
    tell = progress if progress is not None else lambda _: None
    results: list[DeviceResult | DeviceFailure] = []
    for device in campaign.devices:
        name = f"device {device}" if device else "the device"
        try:
            result = calibrate_device(
                campaign.of_device(device), method=method, robust=robust, progress=tell
            )
        except ValueError as error:
            results.append(DeviceFailure(device, str(error)))
            tell(f"{name}: failed")
        else:
            results.append(result)
            tell(f"{name}: done")
    return tuple(results)


def calibrate_device(
    campaign: Campaign, *, method: str, robust: float | None, progress: Progress
) -> DeviceResult:
    """Calibrate the one device of a campaign. Raises `ValueError` with the reason where the data do
    not determine the model."""
    chosen = choose_model(campaign, campaign.recordings)
    progress("reducing recordings to dwells")
    dwells = reduce_to_dwells(campaign.recordings)
    accel, gyro = build_estimators(chosen, campaign.site.gravity, dwells, robust=robust)
    choices, warnings = list(chosen.reasons), list(campaign.notes)
    accel_result = gyro_result = None
    if accel is not None:
        used = _rows_for(accel, chosen, dwells)
        accel_result = _estimate(accel, used, chosen, method, progress, choices, warnings)
        dwells = _with_refined_force(accel_result, dwells)
    if gyro is not None:
        used = _rows_for(gyro, chosen, dwells)
        gyro_result = _estimate(gyro, used, chosen, method, progress, choices, warnings)
    calibration = Calibration(
        gravity=campaign.site.gravity,
        accel=_triad(accel_result, chosen.accel_estimator),
        gyro=_triad(gyro_result, chosen.gyro_estimator),
        device=campaign.devices[0],
        temperature_range=_temperature_range(campaign, accel_result, gyro_result),
        notes=tuple(choices),
    )
    return DeviceResult(calibration, accel_result, gyro_result, tuple(choices), tuple(warnings))


def _rows_for(estimator: AbstractEstimator, chosen: ChosenModel, dwells: Dwells) -> Dwells:
    """The dwells an estimator may use: at rest, unless it has a reference for the motion."""
    by_reference = {"accel": chosen.accel_estimator, "gyro": chosen.gyro_estimator}
    if by_reference[estimator.triad] == "reference":
        return dwells
    rests = np.flatnonzero(np.asarray(dwells.position) >= 0)
    if len(rests) == 0:
        raise ValueError(
            f"the {estimator.triad} columns: no rests were found; calibration at rest needs the "
            f"device to stand still for several seconds in each position."
        )
    return dwells[rests]


def _estimate(
    estimator: AbstractEstimator,
    dwells: Dwells,
    chosen: ChosenModel,
    method: str,
    progress: Progress,
    choices: list[str],
    warnings: list[str],
) -> TriadResult:
    estimator = _with_provisional_scatter(estimator, dwells)
    dwells = jax.tree.map(jnp.asarray, dwells)
    if chosen.degree is None:
        degree, reason = choose_degree(estimator, dwells)
        choices.append(f"{estimator.triad}: {reason}")
    else:
        degree = chosen.degree
    basis = polynomial_basis(degree, dwells)
    seen = _check_observable(estimator, basis, dwells)
    progress(f"estimating {estimator.triad} ({basis.size * estimator.num_parameters} unknowns)")
    # Two passes settle the scatter between dwells: it changes the weights, hardly the answer.
    own_chi2 = float("nan")
    for attempt in range(3):
        solution = _solve(estimator, basis, dwells, method)
        misfit, own_sigma = _misfits(estimator, solution, dwells)
        unknowns = basis.size * estimator.num_parameters
        if attempt == 0:
            own_chi2 = _chi2_per_dof(misfit, own_sigma, unknowns)
        if attempt < 2:
            estimator = _with_scatter(estimator, misfit, own_sigma, unknowns)
    if not bool(solution.succeeded):
        raise ValueError(_failure(estimator, solution, dwells, method))
    if method == "paper":
        procedure = PaperIteration.plan(estimator, basis, dwells)
        rate = convergence_rate(procedure, solution.curve.coefficients, dwells)
        warning = rate_warning(procedure, rate, dwells)
        warnings.extend([] if warning is None else [warning])
    scatter = float(estimator.scatter)
    return TriadResult(
        estimator=estimator,
        solution=solution,
        dwells=dwells,
        misfit=misfit,
        sigma=np.sqrt(np.square(own_sigma) + scatter**2),
        observability=seen,
        scatter=scatter,
        chi2_per_dof=own_chi2,
    )


def _solve(
    estimator: AbstractEstimator, basis: AbstractBasis, dwells: Dwells, method: str
) -> ThermalSolution:
    if method == "joint":
        return joint_fit(estimator, basis, dwells)
    if method == "paper":
        return iterate(PaperIteration.plan(estimator, basis, dwells), dwells)
    return iterate(GaussNewtonIteration(estimator, basis), dwells)


@eqx.filter_jit
def _misfit_rows(estimator: AbstractEstimator, solution: ThermalSolution, dwells: Dwells):
    at = lambda d: estimator.misfit(solution.curve(d.temperature), d)
    return jax.vmap(at)(dwells)


def _misfits(
    estimator: AbstractEstimator, solution: ThermalSolution, dwells: Dwells
) -> tuple[np.ndarray, np.ndarray]:
    misfit, sigma = _misfit_rows(estimator, solution, dwells)
    return np.asarray(misfit), np.asarray(sigma)


def _with_provisional_scatter(estimator: AbstractEstimator, dwells: Dwells) -> AbstractEstimator:
    """Equal weights for a start where some dwell has no noise figure of its own."""
    covariance = np.asarray(getattr(dwells, f"{estimator.triad}_covariance"))
    if np.all(np.trace(covariance, axis1=-2, axis2=-1) > 0.0):
        return estimator
    return eqx.tree_at(lambda e: e.scatter, estimator, jnp.asarray(NOMINAL_SIGMA))


def _with_scatter(
    estimator: AbstractEstimator, misfit: np.ndarray, sigma: np.ndarray, unknowns: int
) -> AbstractEstimator:
    """Scatter between dwells by Paule and Mandel where χ² is beyond its 99 % point, else none."""
    dof = misfit.size - unknowns
    if np.all(sigma > 0) and dof > 0:
        total = float(np.sum(np.square(misfit / sigma)))
        if total <= chi2.ppf(0.99, dof):
            return eqx.tree_at(lambda e: e.scatter, estimator, jnp.asarray(0.0))
    scatter = extra_scatter(misfit.ravel(), sigma.ravel(), unknowns)
    if scatter == 0.0 and not np.all(sigma > 0):
        return estimator  # exact data without a noise figure: keep the provisional weights
    return eqx.tree_at(lambda e: e.scatter, estimator, jnp.asarray(float(scatter)))


def _chi2_per_dof(misfit: np.ndarray, sigma: np.ndarray, unknowns: int) -> float:
    dof = misfit.size - unknowns
    if dof <= 0 or not np.all(sigma > 0):
        return float("nan")
    return float(np.sum(np.square(misfit / sigma)) / dof)


def _check_observable(
    estimator: AbstractEstimator, basis: AbstractBasis, dwells: Dwells
) -> Observability:
    rows = dwells.num_dwells * (1 if len(estimator.names) == 9 else 3)
    unknowns = basis.size * estimator.num_parameters
    temperature = "" if basis.size == 1 else f" ({estimator.num_parameters} at each of {basis.size} terms)"
    if rows < unknowns:
        raise ValueError(
            f"{estimator.triad}: too few positions: {dwells.num_dwells} dwells give {rows} equations "
            f"for {unknowns} unknowns{temperature}; record more positions in different orientations."
        )
    seen = observability(estimator, basis, dwells)
    if seen.rank < seen.unknowns:
        raise ValueError(
            f"{estimator.triad}: the positions do not determine {seen.unknowns - seen.rank} of "
            f"{seen.unknowns} unknowns{temperature}: {'; '.join(seen.unseen[:3])}; add positions in "
            f"other orientations (or temperatures)."
        )
    return seen


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
    exact = joint_fit(estimator, solution.curve.basis, dwells)
    rate = convergence_rate(procedure, exact.curve.coefficients, dwells)
    return f"{text}: {rate_warning(procedure, rate, dwells) or 'use the default method'}."


def _with_refined_force(result: TriadResult, dwells: Dwells) -> Dwells:
    """Dwells with compensated accelerometer outputs, for the gyros' D term."""
    curve, estimator = result.solution.curve, result.estimator
    refine = lambda d: estimator.compensate(curve(d.temperature), d)
    return eqx.filter_jit(jax.vmap(refine))(jax.tree.map(jnp.asarray, dwells))


def _triad(result: TriadResult | None, estimator: str | None) -> TriadCalibration | None:
    if result is None or estimator is None:
        return None
    return TriadCalibration(
        result.solution.curve, result.solution.covariance, result.estimator.names, estimator
    )


def _temperature_range(
    campaign: Campaign, accel: TriadResult | None, gyro: TriadResult | None
) -> tuple[float, float] | None:
    if any(r.temperature is None for r in campaign.recordings):
        return None
    used = [np.asarray(t.dwells.temperature) for t in (accel, gyro) if t is not None]
    together = np.concatenate(used)
    return float(together.min()), float(together.max())
