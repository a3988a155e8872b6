"""From a campaign to calibrations: reduce, choose, estimate, judge; one device at a time."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from .._jax import jax
from ..calibration.calibration import Calibration, TriadCalibration
from ..calibration.fitted_effects import FittedEffect
from ..calibration.probe_error import probe_covariance
from ..data.recording import Campaign, check_given_campaign, Recording, Rig
from ..data.stored_recording import log_numbers
from ..estimators import (
    GravityRotation,
    Invariant,
    JointImu,
    ReferenceAccel,
    ReferenceGyro,
    StaticAccel,
)
from ..model_selection.model_spec import ModelSpec
from ..model_selection.select_model import (
    build_estimators,
    choose_model,
    ChosenModel,
    fixed_model,
    settle_accel,
)
from ..numerics.blas_threads import one_blas_thread
from ..numerics.wide_arithmetic import whole_in_64_bits
from ..plausibility import statements
from ..plausibility.aside import Asked
from ..plausibility.settled_rests import without_settled_rests
from ..plausibility.stated_rates import ramps_sentence
from ..reduction.device_segments import of_one_device
from ..reduction.dwell_means import reduce_to_dwells
from ..reduction.dwells import Dwells, without_held
from ..reduction.handling import handling_words, kept_sentence, with_force_counted
from ..reduction.known_moves import move_words, take_moves
from ..reduction.rig_errors import rate_words, table_words, with_rig_errors
from ..reduction.rotations_between_rests import with_motions
from ..reduction.rounded_temperature import probe_sigma, with_rounding
from ..reduction.segments import (
    each_without_disturbances,
    segment_each,
    Segments,
)
from .accelerometers import calibrate_accelerometers
from .attitudes_over_temperature import one_attitude_over_temperature
from .barometer import barometer_beside
from .bias_moment import moment_words
from .described_model import described_model
from .earth_rate import earth_taken_away, with_earth_rate
from .gyros import calibrate_gyros
from .joint_imu_fit import fit_together, Together
from .level_by_recording import triad_words
from .magnetometers_of_device import calibrate_mag, has_magnetometers, magnetometer_calibration
from .mean_output import about_the_mean, told_of_the_sensor, words_of_the_mean
from .one_triad import Progress, with_refined_force
from .results import (
    DeviceFailure as DeviceFailure,
    DeviceResult as DeviceResult,
    MagnetometerResult as MagnetometerResult,
    TriadResult as TriadResult,
)
from .rounding_in_common import with_common_rounding
from .wanted_sensors import require_something


METHODS = ("gauss-newton", "joint", "paper")
Seen = Callable[[Sequence[Segments] | TriadResult], None]


def calibrate(
    campaign: Campaign,
    *,
    method: str = "gauss-newton",
    robust: float | None = None,
    force: bool = False,
    progress: Progress | None = None,
    seen: Seen | None = None,
) -> tuple[DeviceResult | DeviceFailure, ...]:
    """Calibrate every device of a campaign. A bad device becomes a `DeviceFailure`, not an error.

    **Arguments:** `method` is "gauss-newton" (the procedure as a Gauss-Newton method), "joint" or
    "paper"; `robust` a pseudo-Huber threshold in standard deviations; `force` goes on where a plausibility
    check finds an error; `progress` is called with a line of text at each stage, `seen` with what is settled of the
    device: its segments, then each triad's result, unless both triads are estimated together in the end.

    Raises `ValueError` for another method, and for what is no campaign.

    **Example:** a log by hand, whose motions between rests calibrate the gyros:

        (result,) = calibrate(Campaign(recording, Site(gravity=9.81)))
        result.calibration.covariance    # (21, 21), both triads
    """
    if method not in METHODS:
        raise ValueError(f"`calibrate(method={method!r})`: method must be one of {list(METHODS)}.")
    check_given_campaign("calibrate(campaign)", campaign)
    tell = progress if progress is not None else lambda _: None
    results: list[DeviceResult | DeviceFailure] = []
    for device in campaign.devices:
        name = f"device {device}" if device else "the device"
        try:
            result = calibrate_device(
                campaign.of_device(device),
                method=method,
                robust=robust,
                force=force,
                progress=tell,
                seen=seen,
            )
        except ValueError as error:
            results.append(DeviceFailure(device, str(error)))
            tell(f"{name}: failed")
        else:
            results.append(result)
            tell(f"{name}: done")
    return tuple(results)


@one_blas_thread()
def calibrate_device(
    campaign: Campaign,
    *,
    method: str = "gauss-newton",
    robust: float | None = None,
    progress: Progress = lambda _: None,
    model: ModelSpec | None = None,
    force: bool = False,
    checked: bool = False,
    segments: Sequence[Segments] | None = None,
    seen: Seen | None = None,
) -> DeviceResult:
    """Calibrate the one device of a campaign.

    **Arguments:** `model` is one that was fitted before and is to be fitted again, whatever `[model]` says; with
    `force` data that cannot be right are calibrated all the same; `checked` says that their plausibility was asked
    before; `segments` are rests and plateaus that were found before, one entry a recording, where the outputs have been
    changed since: a rest is one of the device, whatever is taken away from its outputs.

    Raises `ValueError` with the reason where the data do not determine the model, or cannot be right.
    """
    check_given_campaign("calibrate_device(campaign)", campaign)
    as_recorded = segment_each(campaign.recordings, handling=False) if segments is None else None
    seen = seen if seen is not None else lambda _: None
    if checked:
        return _estimated(campaign, method, robust, progress, model, as_recorded, segments, seen)
    asked = Asked(campaign, force=force, as_recorded=as_recorded)
    try:
        try:
            result = _estimated(
                campaign, method, robust, progress, model, as_recorded, segments, seen
            )
        except Exception:
            asked.findings()  # an error of the data is the reason of whatever failed
            raise
        found = asked.findings()
    finally:
        asked.end()
    found = without_settled_rests(found, result.handling)
    warnings = (*statements(found), *result.warnings)
    return replace(result, warnings=warnings, plausibility=found)


@whole_in_64_bits  # many curves beside lever arms do not converge in 32
def _estimated(
    campaign: Campaign,
    method: str,
    robust: float | None,
    progress: Progress,
    model: ModelSpec | None,
    as_recorded: Sequence[Segments] | None,
    segments: Sequence[Segments] | None,
    seen: Seen,
) -> DeviceResult:
    """The result without what plausibility finds."""
    recordings = campaign.recordings
    fixed = None if model is None else fixed_model(model)
    chosen = choose_model(campaign, campaign.recordings) if fixed is None else fixed
    require_something(campaign, chosen)
    progress("reducing recordings to dwells")
    if as_recorded is not None:
        undisturbed = each_without_disturbances(recordings, as_recorded, held=True)
        segments = of_one_device(recordings, undisturbed, moves=take_moves(campaign.model))
    assert segments is not None  # given, or just found
    seen(segments := tuple(segments))
    try:
        dwells = reduce_to_dwells(campaign.recordings, segments=segments)
    except ValueError as error:
        if not has_magnetometers(campaign):
            raise
        alone = chosen.accel_estimator is None and chosen.gyro_estimator is None
        why = (
            ()
            if alone
            else (f"accelerometers and gyros are not calibrated: {str(error).rstrip('.')}",)
        )
        return _magnetometers_alone(campaign, chosen, robust, progress, why)
    dwells = with_rig_errors(dwells, campaign.rig)
    dwells, of_earth = earth_taken_away(dwells, campaign)
    warning = None
    if chosen.accel_estimator is not None:
        chosen, warning = settle_accel(campaign, chosen, dwells)
    handling = tuple(d for s in segments for d in s.disturbances)
    handling = with_force_counted(handling, chosen.accel_estimator == "invariant")
    choices = [*chosen.reasons, *handling_words(handling)]
    ramps = sum(s.ramps for s in segments)
    choices += [f"plateaus: {ramps_sentence(ramps)}"] if ramps else []
    choices += move_words(recordings, segments) if chosen.gyro_estimator == "reference" else ()
    warnings = [*_of_turning(campaign, segments)]
    warnings.extend(s for s in (warning, kept_sentence(handling)) if s is not None)
    accel_result, raw = None, dwells
    if chosen.accel_estimator is not None:
        accel_result, chosen = calibrate_accelerometers(
            campaign, chosen, dwells, method, robust, progress, choices, warnings
        )
        if not chosen.together:
            seen(accel_result)
        dwells = with_refined_force(accel_result, dwells)
        warnings.extend(words_of_the_mean(accel_result))
        warnings.extend(_of_levels(accel_result, campaign))
        one = one_attitude_over_temperature(raw)
        warnings.extend([] if one is None else [one])
    gyro_result, chosen, cross = calibrate_gyros(
        campaign, chosen, accel_result, dwells, method, robust, progress, choices, warnings
    )
    if gyro_result is not None and not chosen.together:
        gyro_result = with_common_rounding(gyro_result, recordings)
        seen(gyro_result)
    warnings.extend(_of_levels(gyro_result, campaign))
    choices.extend(w for r in (accel_result, gyro_result) for w in moment_words(r))
    effects: tuple[FittedEffect, ...] = ()
    if chosen.together:
        assert accel_result is not None and gyro_result is not None  # `choose_model` saw both
        progress("estimating both triads together")
        found = _together(campaign, chosen, raw, accel_result, gyro_result, robust)
        accel_result, gyro_result, cross = found.accel, found.gyro, None
        choices.extend(found.statements)
        specific_force = np.asarray(accel_result.dwells.accel) / campaign.site.gravity
        effects = found.effects(float(np.abs(specific_force).max()))
    mag, failed = calibrate_mag(campaign, chosen, accel_result, dwells, segments, robust, progress)
    warnings.extend(failed)
    choices.extend(() if mag is None else mag.statements)
    baro, failed = barometer_beside(campaign.recordings)
    warnings.extend(failed)
    choices.extend(() if baro is None else baro.statements)
    choices.extend(of_earth if gyro_result is not None else ())
    if gyro_result is not None and chosen.gyro_estimator is not None:
        choices.extend(f"gyros: {w}" for w in rate_words(chosen.gyro_estimator, campaign.rig))
    estimators = (chosen.accel_estimator, chosen.gyro_estimator)
    warnings.extend(table_words(raw, campaign.rig, estimators))
    # How files were read: behind what the data themselves say. Rests and the turns between them are the same on stamps
    # of either triad, and a delay between the two changes neither.
    warnings.extend(campaign.reservations)
    choices.extend(campaign.pairings)
    spec = described_model(campaign, chosen, accel_result, gyro_result, model)
    rig = with_rounding(campaign.rig, recordings)
    calibration = Calibration(
        gravity=campaign.site.gravity,
        accel=_triad(told_of_the_sensor(accel_result), chosen.accel_estimator, rig),
        gyro=with_earth_rate(_triad(gyro_result, chosen.gyro_estimator, rig), raw, campaign.site),
        device=campaign.devices[0],
        temperature_range=_temperature_range(campaign, accel_result, gyro_result, mag),
        notes=tuple(choices),
        effects=effects,
        cross_covariance=cross,
        model=spec,
        mag=None if mag is None else magnetometer_calibration(mag, campaign.rig),
        baro=None if baro is None else baro.calibration,
    )
    return DeviceResult(
        calibration,
        accel_result,
        gyro_result,
        spec,
        tuple(choices),
        tuple(warnings),
        (),
        handling,
        segments,
        mag,
        baro,
    )


def _of_levels(estimate: TriadResult | None, campaign: Campaign) -> list[str]:
    """That a triad's biases differ from recording to recording, where they do."""
    words = triad_words(estimate, campaign.site.gravity, log_numbers(campaign.recordings))
    return [] if words is None else [words]


def _magnetometers_alone(
    campaign: Campaign,
    chosen: ChosenModel,
    robust: float | None,
    progress: Progress,
    why: tuple[str, ...],
) -> DeviceResult:
    """A device that is turned all ways without a rest: its magnetometers, in their own frame.

    Raises `ValueError` where they are not determined either.
    """
    mag, failed = calibrate_mag(campaign, chosen, None, None, (), robust, progress)
    warnings = (*campaign.reservations, *why, *failed)
    statements = (*(() if mag is None else mag.statements), *campaign.pairings)
    if mag is None:
        raise ValueError("; ".join((*why, *failed)))
    spec = described_model(campaign, chosen, None, None, None)
    calibration = Calibration(
        gravity=campaign.site.gravity,
        device=campaign.devices[0],
        temperature_range=_temperature_range(campaign, None, None, mag),
        notes=statements,
        model=spec,
        mag=magnetometer_calibration(mag, campaign.rig),
    )
    return DeviceResult(calibration, None, None, spec, statements, warnings, (), mag=mag)


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
    used = without_held(raw)
    if chosen.gyro_estimator == "gravity":
        force = _raw_force if chosen.g_sensitivity else None
        used = with_motions(campaign.recordings, raw, force=force).dwells
    degrees = accel.solution.curve.basis.size - 1, gyro.solution.curve.basis.size - 1
    found = fit_together(
        estimator, jax.tree.map(np.asarray, used), degrees=degrees, rig=campaign.rig
    )
    if not found.converged:
        raise ValueError(
            "accel and gyro together: the estimation did not converge; leave out [model] together to see "
            "which triad is at fault."
        )
    return found


def _raw_force(recording: Recording) -> Float[np.ndarray, "time 3"]:
    assert recording.accel is not None  # gravity's rotation needs both triads
    return recording.accel


def _of_turning(campaign: Campaign, segments: Sequence[Segments]) -> list[str]:
    """What is to be said of recordings that turn slowly all along."""
    return [
        f"{recording.name or 'the recording'}: {part.statement}. A force that turning about a point beside it adds all "
        "along is not in that: let it lie for seconds in each of nine orientations."
        for recording, part in zip(campaign.recordings, segments, strict=True)
        if part.turning is not None
    ]


def _triad(result: TriadResult | None, estimator: str | None, rig: Rig) -> TriadCalibration | None:
    if result is None or estimator is None:
        return None
    curve, covariance = result.solution.curve, np.asarray(result.solution.covariance)
    covariance = covariance + probe_covariance(curve.coefficients, curve.basis, probe_sigma(rig))
    mean = None
    if isinstance(result.estimator, StaticAccel) and about_the_mean(result):
        mean = np.asarray(result.estimator.nominal, float)
    return TriadCalibration(curve, covariance, result.estimator.names, estimator, mean)


def _temperature_range(
    campaign: Campaign,
    accel: TriadResult | None,
    gyro: TriadResult | None,
    mag: MagnetometerResult | None,
) -> tuple[float, float] | None:
    """Temperatures that accelerometers and gyros were calibrated over, or the magnetometers where they are alone."""
    if any(r.temperature is None for r in campaign.recordings):
        return None
    used = [np.asarray(t.dwells.temperature) for t in (accel, gyro) if t is not None]
    if not used and mag is not None:
        used = [np.asarray(mag.dwells.temperature)]
    together = np.concatenate(used)
    return float(together.min()), float(together.max())
