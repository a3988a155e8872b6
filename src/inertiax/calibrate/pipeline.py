"""From a campaign to calibrations: reduce, choose, estimate, judge; one device at a time."""

import dataclasses
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from .._typing import AnyArray
from ..calibration.calibration import Calibration, TriadCalibration
from ..calibration.fitted_effects import FittedEffect
from ..calibration.probe_error import probe_covariance
from ..data.recording import Campaign, Recording, Rig
from ..estimators import (
    AbstractEstimator,
    GravityRotation,
    Invariant,
    JointImu,
    ReferenceAccel,
    ReferenceGyro,
)
from ..model_selection.model_spec import describe, ModelSpec, TriadSpec
from ..model_selection.select_model import (
    build_estimators,
    choose_degree,
    choose_model,
    ChosenModel,
    fixed_model,
    polynomial_basis,
    settle_accel,
    settle_gyro,
)
from ..physics.error_model import compensate_accel
from ..physics.temperature import AbstractBasis, Constant, Curve
from ..plausibility import require_plausible, statements
from ..procedure.convergence import convergence_rate, rate_warning
from ..procedure.single_device import iterate_one, joint_fit_one, Problem
from ..procedure.thermal_iterations import iterate, PaperIteration, ThermalSolution
from ..reduction.dwell_means import reduce_to_dwells
from ..reduction.dwells import Dwells
from ..reduction.handling import kept_sentence, left_out_sentence
from ..reduction.rig_errors import with_rig_errors
from ..reduction.rotations_between_rests import Turns, with_motions
from ..reduction.segments import segment_all
from .between_dwell_variance import (
    chi2_per_dof,
    judged,
    num_judged,
    with_provisional_scatter,
    with_scatter,
)
from .joint_imu_fit import fit_together, Together
from .observability import judge_normal, Observability
from .results import (
    DeviceFailure as DeviceFailure,
    DeviceResult as DeviceResult,
    TriadResult as TriadResult,
)


# Usual size of a misalignment, rad (from MEMS data sheets): rests that tell it no better than that tell
# nothing of it, and it only bends the other parameters.
MISALIGNED = 0.02
METHODS = ("gauss-newton", "joint", "paper")

Progress = Callable[[str], None]


def calibrate(
    campaign: Campaign,
    *,
    method: str = "gauss-newton",
    robust: float | None = None,
    force: bool = False,
    progress: Progress | None = None,
) -> tuple[DeviceResult | DeviceFailure, ...]:
    """Calibrate every device of a campaign. A bad device becomes a `DeviceFailure`, not an error.

    **Arguments:** `method` is "gauss-newton" (the procedure as a Gauss-Newton method), "joint" or
    "paper"; `robust` a pseudo-Huber threshold in standard deviations; `force` goes on where a plausibility
    check finds an error; `progress` is called with a line of text at each stage.
    """
    if method not in METHODS:
        raise ValueError(f"`calibrate(method={method!r})`: method must be one of {list(METHODS)}.")
    tell = progress if progress is not None else lambda _: None
    results: list[DeviceResult | DeviceFailure] = []
    for device in campaign.devices:
        name = f"device {device}" if device else "the device"
        try:
            result = calibrate_device(
                campaign.of_device(device), method=method, robust=robust, force=force, progress=tell
            )
        except ValueError as error:
            results.append(DeviceFailure(device, str(error)))
            tell(f"{name}: failed")
        else:
            results.append(result)
            tell(f"{name}: done")
    return tuple(results)


def calibrate_device(
    campaign: Campaign,
    *,
    method: str = "gauss-newton",
    robust: float | None = None,
    progress: Progress = lambda _: None,
    model: ModelSpec | None = None,
    force: bool = False,
    checked: bool = False,
) -> DeviceResult:
    """Calibrate the one device of a campaign.

    **Arguments:** `model` is one that was fitted before and is to be fitted again, whatever `[model]` says; with
    `force` data that cannot be right are calibrated all the same; `checked` says that their plausibility was asked
    before.

    Raises `ValueError` with the reason where the data do not determine the model, or cannot be right.
    """
    found_odd = () if checked else require_plausible(campaign, force=force)
    fixed = None if model is None else fixed_model(model)
    chosen = choose_model(campaign, campaign.recordings) if fixed is None else fixed
    progress("reducing recordings to dwells")
    segments = segment_all(campaign.recordings)
    handling = tuple(d for s in segments for d in s.disturbances)
    dwells = reduce_to_dwells(campaign.recordings, segments=segments)
    dwells = with_rig_errors(dwells, campaign.rig)
    warning = None
    if chosen.accel_estimator is not None:
        chosen, warning = settle_accel(campaign, chosen, dwells)
    choices = [*chosen.reasons, *(s for s in [left_out_sentence(handling)] if s)]
    warnings = [*campaign.notes, *statements(found_odd)]
    warnings.extend(s for s in (warning, kept_sentence(handling)) if s is not None)
    accel_result, raw = None, dwells
    if chosen.accel_estimator is not None:
        accel_result, chosen = _calibrate_accel(
            campaign, chosen, dwells, method, robust, progress, choices, warnings
        )
        dwells = _with_refined_force(accel_result, dwells)
    gyro_result, chosen = _calibrate_gyro(
        campaign, chosen, accel_result, dwells, method, robust, progress, choices, warnings
    )
    effects: tuple[FittedEffect, ...] = ()
    if chosen.together:
        assert accel_result is not None and gyro_result is not None  # `choose_model` saw both
        progress("estimating both triads together")
        found = _together(campaign, chosen, raw, accel_result, gyro_result, robust)
        accel_result, gyro_result = found.accel, found.gyro
        choices.extend(found.statements)
        specific_force = np.asarray(accel_result.dwells.accel) / campaign.site.gravity
        effects = found.effects(float(np.abs(specific_force).max()))
    spec = _described(campaign, chosen, accel_result, gyro_result, model)
    calibration = Calibration(
        gravity=campaign.site.gravity,
        accel=_triad(accel_result, chosen.accel_estimator, campaign.rig),
        gyro=_triad(gyro_result, chosen.gyro_estimator, campaign.rig),
        device=campaign.devices[0],
        temperature_range=_temperature_range(campaign, accel_result, gyro_result),
        notes=tuple(choices),
        effects=effects,
        model=spec,
    )
    return DeviceResult(
        calibration,
        accel_result,
        gyro_result,
        spec,
        tuple(choices),
        tuple(warnings),
        found_odd,
        handling,
    )


def _described(
    campaign: Campaign,
    chosen: ChosenModel,
    accel: TriadResult | None,
    gyro: TriadResult | None,
    model: ModelSpec | None,
) -> ModelSpec:
    """The model that was fitted."""
    if model is not None:
        return model

    def triad(result: TriadResult | None, name: str | None) -> TriadSpec | None:
        if result is None or name is None:
            return None
        names = result.estimator.names
        by_force = any("g_sensitivity" in n for n in names)
        return TriadSpec(name, result.solution.curve.basis.size - 1, names, by_force)

    return describe(
        campaign.model,
        triad(accel, chosen.accel_estimator),
        triad(gyro, chosen.gyro_estimator),
        together=chosen.together,
        lever_arms=chosen.lever_arms,
        misalignment=chosen.misalignment,
    )


def _calibrate_accel(
    campaign: Campaign,
    chosen: ChosenModel,
    dwells: Dwells,
    method: str,
    robust: float | None,
    progress: Progress,
    choices: list[str],
    warnings: list[str],
) -> tuple[TriadResult, ChosenModel]:
    """The accelerometers' estimate, and the model without misalignments where the rests do not determine them."""
    used = _rows_for("accel", chosen, dwells)

    def estimate(model: ChosenModel, said: list[str]) -> TriadResult:
        accel, _ = build_estimators(model, campaign.site.gravity, dwells, robust=robust)
        assert accel is not None
        return _estimate(accel, used, model, method, progress, said, warnings)

    if chosen.fixed or chosen.accel_estimator != "invariant":
        return estimate(chosen, choices), chosen
    said: list[str] = []
    first, found, why = _misalignments(campaign, chosen, used, robust), None, ""
    if first:
        found = estimate(chosen, said)
        known = _known_misalignments(found)
        if known <= MISALIGNED:
            choices.extend(said)
            return found, chosen
        why = f"no better than {1e3 * known:.2g} mrad"
    reason = (
        "accelerometers: biases and scale factors only, because the positions determine the misalignments "
        f"{why or 'not at all'}; add positions between the axes"
    )
    smaller = dataclasses.replace(chosen, accel_misalignments=False)
    try:
        found = estimate(smaller, said := [])
    except ValueError:
        if found is None:
            return estimate(chosen, choices), chosen  # whose reason says what is missing
        smaller = chosen
    else:
        warnings.append(reason)
    choices.extend(said)
    return found, smaller


def _misalignments(
    campaign: Campaign, chosen: ChosenModel, dwells: Dwells, robust: float | None
) -> bool:
    """Whether the rests determine all of an invariant model at one temperature."""
    accel, _ = build_estimators(chosen, campaign.site.gravity, dwells, robust=robust)
    assert accel is not None
    try:
        _check_observable(with_provisional_scatter(accel, dwells), Constant(), dwells)
    except ValueError:
        return False
    return True


def _known_misalignments(found: TriadResult) -> float:
    """The largest standard deviation of a misalignment, rad, over the temperatures of the dwells."""
    own = [k for k, n in enumerate(found.estimator.names) if _is_misalignment(n)]
    phi = Problem(found.estimator, found.solution.curve.basis, found.dwells).phi
    size, count = phi.shape[1], found.estimator.num_parameters
    blocks = np.asarray(found.solution.covariance).reshape(size, count, size, count)
    variance = np.einsum("ta,aibi,tb->ti", phi, blocks[:, own][:, :, :, own], phi)
    return float(np.sqrt(variance.max()))


def _is_misalignment(name: str) -> bool:
    return ".matrix[" in name and name[-4] != name[-2]


def _calibrate_gyro(
    campaign: Campaign,
    chosen: ChosenModel,
    accel: TriadResult | None,
    dwells: Dwells,
    method: str,
    robust: float | None,
    progress: Progress,
    choices: list[str],
    warnings: list[str],
) -> tuple[TriadResult | None, ChosenModel]:
    """The gyros' estimate, and the model with the estimator that was used in the end.

    Where the choice was left open and the rotation of gravity does not determine the model, the rests
    still tell the bias; a warning says so.
    """

    def estimate(model: ChosenModel, used: Dwells) -> TriadResult:
        _, gyro = build_estimators(model, campaign.site.gravity, dwells, robust=robust)
        assert gyro is not None
        return _estimate(gyro, used, model, method, progress, choices, warnings)

    if chosen.gyro_estimator is None:
        return None, chosen
    if chosen.gyro_estimator == "gravity":
        assert accel is not None  # `choose_model` saw accelerometers
        turns = _turns(campaign, accel, dwells, g_sensitivity=chosen.g_sensitivity)
        name, reason = ("gravity", None) if chosen.fixed else settle_gyro(campaign, turns)
        choices.extend([] if reason is None else [reason])
        try:
            if name == "gravity":
                return estimate(chosen, turns.dwells), chosen
        except ValueError as error:
            if chosen.fixed or campaign.model.gyro_estimator == "gravity":
                raise
            warnings.append(f"gyros: 'static' instead of 'gravity', which failed: {error}")
        chosen = dataclasses.replace(chosen, gyro_estimator="static")
    return estimate(chosen, _rows_for("gyro", chosen, dwells)), chosen


def _together(
    campaign: Campaign,
    chosen: ChosenModel,
    raw: Dwells,
    accel: TriadResult,
    gyro: TriadResult,
    robust: float | None,
) -> Together:
    """Both triads in one least squares, each with the degree over temperature that it had alone."""
    first, second = build_estimators(chosen, campaign.site.gravity, raw, robust=robust)
    if not isinstance(first, Invariant | ReferenceAccel) or not isinstance(
        second, ReferenceGyro | GravityRotation
    ):
        raise ValueError(
            "accel and gyro together: the motions do not tell the gyros' matrix, only their bias; leave out "
            "[model] together, or tilt the device between rests."
        )
    estimator = JointImu(
        first, second, lever_arms=chosen.lever_arms, misalignment=chosen.misalignment
    )
    used = raw
    if chosen.gyro_estimator == "gravity":
        force = [r.accel for r in campaign.recordings if r.accel is not None]
        by_force = chosen.g_sensitivity
        used = with_motions(campaign.recordings, raw, force=force if by_force else None).dwells
    degrees = accel.solution.curve.basis.size - 1, gyro.solution.curve.basis.size - 1
    found = fit_together(estimator, jax.tree.map(np.asarray, used), degrees=degrees)
    if not found.converged:
        raise ValueError(
            "accel and gyro together: the estimation did not converge; leave out [model] together to see "
            "which triad is at fault."
        )
    return found


def _turns(campaign: Campaign, accel: TriadResult, dwells: Dwells, *, g_sensitivity: bool) -> Turns:
    """The rests with the motions between them, as the calibrated accelerometers saw both."""
    _rests(dwells, "gyro")
    # What the accelerometers' model leaves at a rest is an error of that rest's direction too.
    left = accel.scatter**2 * np.eye(3)
    dwells = eqx.tree_at(
        lambda d: d.accel_covariance, dwells, np.asarray(dwells.accel_covariance) + left
    )
    force = [_force(accel, r) for r in campaign.recordings] if g_sensitivity else None
    return with_motions(campaign.recordings, dwells, force=force)


def _force(accel: TriadResult, recording: Recording) -> Float[np.ndarray, "time 3"]:
    """Compensated specific force of every sample, m/s²."""
    assert recording.accel is not None
    probe = recording.temperature
    temperature = np.zeros(recording.num_samples) if probe is None else probe[:, 0]
    curve = accel.solution.curve
    return np.asarray(_compensated_force(accel.estimator, curve, temperature, recording.accel))


@eqx.filter_jit
def _compensated_force(
    estimator: AbstractEstimator, curve: Curve, temperature: AnyArray, accel: AnyArray
) -> Float[Array, "time 3"]:
    one = lambda t, a: compensate_accel(estimator.unpack(curve(t)), a)
    return jax.vmap(one)(temperature, accel)


def _rows_for(triad: str, chosen: ChosenModel, dwells: Dwells) -> Dwells:
    """The dwells an estimator may use: at rest, unless it has a reference for the motion."""
    by_reference = {"accel": chosen.accel_estimator, "gyro": chosen.gyro_estimator}
    if by_reference[triad] == "reference":
        return dwells
    return dwells[_rests(dwells, triad)]


def _rests(dwells: Dwells, triad: str) -> Int[np.ndarray, " rest"]:
    rests = np.flatnonzero(np.asarray(dwells.position) >= 0)
    if len(rests) == 0:
        raise ValueError(
            f"the {triad} columns: no rests were found; calibration at rest needs the device to stand "
            f"still for several seconds in each position."
        )
    return rests


def _estimate(
    estimator: AbstractEstimator,
    dwells: Dwells,
    chosen: ChosenModel,
    method: str,
    progress: Progress,
    choices: list[str],
    warnings: list[str],
) -> TriadResult:
    estimator = with_provisional_scatter(estimator, dwells)
    dwells = jax.tree.map(np.asarray, dwells)
    degree = chosen.degree(estimator.triad)
    if degree is None:
        degree, reason = choose_degree(estimator, dwells)
        choices.append(f"{estimator.triad}: {reason}")
    basis = polynomial_basis(degree, dwells)
    seen = _check_observable(estimator, basis, dwells)
    progress(f"estimating {estimator.triad} ({basis.size * estimator.num_parameters} unknowns)")
    kept = judged(dwells)
    # Two passes settle the scatter between dwells: it changes the weights, hardly the answer.
    unknowns = basis.size * num_judged(estimator, dwells)
    solution = _solve(estimator, basis, dwells, method)
    misfit, own_sigma = _misfits(estimator, solution, dwells, kept)
    own_chi2 = chi2_per_dof(misfit, own_sigma, unknowns)
    for _ in range(2):
        settled = with_scatter(estimator, misfit, own_sigma, unknowns)
        if float(settled.scatter) == float(estimator.scatter):
            break
        estimator = settled
        solution = _solve(estimator, basis, dwells, method)
        misfit, own_sigma = _misfits(estimator, solution, dwells, kept)
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
        dwells=dwells[kept],
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
        return joint_fit_one(estimator, basis, dwells)
    if method == "paper":
        return iterate(PaperIteration.plan(estimator, basis, dwells), dwells)
    return iterate_one(estimator, basis, dwells)


def _misfits(
    estimator: AbstractEstimator,
    solution: ThermalSolution,
    dwells: Dwells,
    kept: Bool[np.ndarray, " dwell"],
) -> tuple[np.ndarray, np.ndarray]:
    """Misfit and its standard deviation by the dwells' own noise, of the dwells that are judged."""
    now = Problem(estimator, solution.curve.basis, dwells).at(solution.curve.coefficients)
    return now.misfit[kept], now.sigma[kept]


def _check_observable(
    estimator: AbstractEstimator, basis: AbstractBasis, dwells: Dwells
) -> Observability:
    per_dwell = eqx.filter_eval_shape(
        lambda d: estimator.misfit(jnp.zeros(estimator.num_parameters), d)[0], dwells[0]
    )
    rows = int(judged(dwells).sum()) * per_dwell.shape[0]
    if dwells.motion is not None:
        rows += 3 * dwells.num_dwells  # the rates at rest
    unknowns = basis.size * estimator.num_parameters
    temperature = (
        "" if basis.size == 1 else f" ({estimator.num_parameters} at each of {basis.size} terms)"
    )
    if rows < unknowns:
        raise ValueError(
            f"{estimator.triad}: too few positions: {dwells.num_dwells} dwells give {rows} equations "
            f"for {unknowns} unknowns{temperature}; record more positions in different orientations."
        )
    problem = Problem(estimator, basis, dwells)
    normal = problem.normal(problem.at(np.zeros((basis.size, estimator.num_parameters))).jacobian)
    seen = judge_normal(normal, estimator.names, basis.size)
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
    exact = joint_fit_one(estimator, solution.curve.basis, dwells)
    rate = convergence_rate(procedure, exact.curve.coefficients, dwells)
    return f"{text}: {rate_warning(procedure, rate, dwells) or 'use the default method'}."


def _with_refined_force(result: TriadResult, dwells: Dwells) -> Dwells:
    """Dwells with compensated accelerometer outputs, for the gyros' D term."""
    return Problem(result.estimator, result.solution.curve.basis, dwells).compensated(
        result.solution.curve.coefficients
    )


def _triad(result: TriadResult | None, estimator: str | None, rig: Rig) -> TriadCalibration | None:
    if result is None or estimator is None:
        return None
    curve, covariance = result.solution.curve, np.asarray(result.solution.covariance)
    sigma = rig.temperature_uncertainty or 0.0
    covariance = covariance + probe_covariance(curve.coefficients, curve.basis, sigma)
    return TriadCalibration(curve, covariance, result.estimator.names, estimator)


def _temperature_range(
    campaign: Campaign, accel: TriadResult | None, gyro: TriadResult | None
) -> tuple[float, float] | None:
    if any(r.temperature is None for r in campaign.recordings):
        return None
    used = [np.asarray(t.dwells.temperature) for t in (accel, gyro) if t is not None]
    together = np.concatenate(used)
    return float(together.min()), float(together.max())
