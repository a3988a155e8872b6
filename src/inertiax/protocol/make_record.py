"""From a calibrated device to its record."""

import datetime
import functools
import math
import platform
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path

import numpy as np

from ..calibrate.earth_rate import HEADING, heading_covariance
from ..calibrate.fit_quality import judge, Quality, TRIAD_NAMES
from ..calibrate.goodness_of_fit import undecidable
from ..calibrate.results import DeviceResult, MagnetometerResult, TriadResult
from ..calibrate.split_covariance import fit_of, Part, residual_degrees, split
from ..calibration.calibration import Calibration, TriadCalibration
from ..calibration.probe_error import probe_covariance
from ..data.inputs import imu_topic, InputFile, sensor_ids
from ..data.recorded import recorded
from ..data.recording import Campaign, Rig
from ..reduction.earth_at_rest import is_known
from ..reduction.handling import left_out_sentence
from ..reduction.rounded_temperature import probe_sigma, with_rounding
from .record import (
    ConditionsRecord,
    digest_of,
    Record,
    SCHEMA,
    SourceRecord,
    StationRecord,
    TriadRecord,
)


_SOFTWARE = ("inertiax", "jax", "jaxlib", "equinox", "optimistix", "numpy", "scipy")
_ROUNDING = 1e-6  # of a variance, by which a difference of covariances may be negative
EFFECTS = "named effects"  # fitted beside the calibration
KNOWN = "known calibration"  # that was taken away before


def record_of(
    result: DeviceResult,
    campaign: Campaign,
    folder: Path,
    command: str,
    inputs: Sequence[InputFile],
    *,
    calibration: Calibration | None = None,
    beside: str = EFFECTS,
) -> Record:
    """The record of one device, whose `calibration.json` lies in `folder`.

    **Arguments:** `campaign` is the device's own; `calibration` is the one that was written where it is not the
    result's own, and `beside` names what its covariance has beyond the fit's.
    """
    written = result.calibration if calibration is None else calibration
    quality = judge(result)
    handling = left_out_sentence(result.handling)
    rig = campaign.rig
    return Record(
        schema=SCHEMA,
        created=time_text(datetime.datetime.now(datetime.UTC)),
        command=command,
        software=software(),
        calibration_sha256=digest_of(folder / "calibration.json"),
        inputs=tuple(inputs),
        station=StationRecord(
            gravity=float(campaign.site.gravity),
            latitude=campaign.site.latitude,
            position_uncertainty=rig.position_uncertainty,
            rate_uncertainty=rig.rate_uncertainty,
            temperature_uncertainty=rig.temperature_uncertainty,
            level_uncertainty=rig.level_uncertainty,
            orthogonality_uncertainty=rig.orthogonality_uncertainty,
            unused=_unused(result, rig),
        ),
        conditions=_conditions(campaign, written),
        method=_method(result),
        verdict=quality.verdict,
        # The judge begins a warning with a capital letter and counts it among its findings.
        findings=tuple(
            f.text
            for f in sorted(quality.findings, key=lambda f: -f.grade)
            if not f.fine and f.text.casefold() not in {w.casefold() for w in result.warnings}
        ),
        choices=tuple(result.choices),
        warnings=tuple(result.warnings),
        left_out=() if handling is None else (handling,),
        accel=_triad(
            result.accel, campaign, result.calibration.accel, written.accel, beside, quality
        ),
        gyro=_triad(result.gyro, campaign, result.calibration.gyro, written.gyro, beside, quality),
        mag=None if result.mag is None or written.mag is None else _magnetometers(result.mag),
    )


def _unused(result: DeviceResult, rig: Rig) -> tuple[str, ...]:
    """The table's stated errors that no dwell's attitude could be used for."""
    triads = [t for t in (result.accel, result.gyro) if t is not None and t.estimator.by_reference]
    used = any(t.dwells.table_accel is not None for t in triads)
    return tuple(
        key
        for key, known in (("level", used), ("orthogonality", used and rig.axes is not None))
        if getattr(rig, f"{key}_uncertainty") and not known
    )


def time_text(moment: datetime.datetime) -> str:
    """A time of UTC to the second, such as 2026-01-31T12:00:00Z."""
    return f"{moment:%Y-%m-%dT%H:%M:%SZ}"


@functools.cache
def software() -> dict[str, str]:
    """Versions that a result depends on."""
    return {**{name: version(name) for name in _SOFTWARE}, "python": platform.python_version()}


def _method(result: DeviceResult) -> str:
    triads = [t for t in (result.accel, result.gyro) if t is not None]
    return ", ".join(dict.fromkeys(t.solution.method for t in triads))


def _conditions(campaign: Campaign, calibration: Calibration) -> ConditionsRecord:
    known, found = recorded(campaign.recordings), calibration.temperature_range
    begin, end = days_of(known.begin, known.end)
    return ConditionsRecord(
        recordings=known.recordings,
        samples=known.samples,
        seconds=known.seconds,
        experiments=known.experiments,
        temperature_range=None if found is None else (float(found[0]), float(found[1])),
        begin=begin,
        end=end,
        sample_rate=known.sample_rate,
        topic=imu_topic(campaign.path),
        sensor_ids=sensor_ids(campaign.path, calibration.device),
    )


def days_of(begin: float | None, end: float | None) -> tuple[str | None, str | None]:
    """Moments of s since 1970 as the record writes them."""
    utc = lambda s: time_text(datetime.datetime.fromtimestamp(s, datetime.UTC))
    return (None, None) if begin is None or end is None else (utc(begin), utc(end))


def _triad(
    result: TriadResult | None,
    campaign: Campaign,
    fitted: TriadCalibration | None,
    written: TriadCalibration | None,
    beside: str,
    quality: Quality,
) -> TriadRecord | None:
    if result is None or fitted is None or written is None:
        return None
    fit = fit_of(result)
    rig = with_rounding(campaign.rig, campaign.recordings)
    parts = split(fit, rig)
    if parts and result.estimator.triad == "gyro" and is_known(result.dwells, campaign.site):
        heading = heading_covariance(fitted, result.dwells, campaign.site)
        parts = (*parts, Part(HEADING, math.inf, heading))
    if parts and written is not fitted:
        parts = _with_rest(parts, written, probe_sigma(rig), beside)
    return TriadRecord(
        dwells=result.dwells.num_dwells,
        turns=int(np.sum(np.asarray(result.dwells.position) < 0)),
        rms=result.rms,
        scatter=result.scatter,
        unit=result.misfit_unit,
        degrees_of_freedom=residual_degrees(fit),
        sources=tuple(source_record(p) for p in parts),
        undecidable=_undecidable(result, quality),
        hidden_by_steps=rig.hidden_by_steps,
    )


def _undecidable(result: TriadResult, quality: Quality) -> str | None:
    """Why no requirement on a triad is decided: its misfit, or another sign of a mistake."""
    ratio = math.sqrt(result.chi2_per_dof)  # NaN stays NaN
    name = TRIAD_NAMES[result.estimator.triad]
    own = next((t for t in quality.triads if t.name == name), None)
    found = undecidable(result.misfit_unit, result.rms, ratio)
    if found is None and own is not None and own.verdict == "doubtful":
        return own.text.removeprefix(f"{name}: ").rstrip(".")
    return found


def _magnetometers(result: MagnetometerResult) -> TriadRecord:
    rows = int(np.count_nonzero(np.asarray(result.misfit)))  # zero where there is no row
    return TriadRecord(
        dwells=result.num_rests,
        turns=None,
        rms=result.rms,
        scatter=result.scatter,
        unit="T",
        degrees_of_freedom=max(rows - int(np.sum(result.free)), 1),
        sources=(),
    )


def _with_rest(
    parts: tuple[Part, ...], written: TriadCalibration, probe: float, beside: str
) -> tuple[Part, ...]:
    """The parts, and under the name `beside` what the written covariance has more; none where that is no covariance."""
    total = np.asarray(written.covariance, float)
    known = sum(p.covariance for p in parts)
    if (
        np.shape(known) != total.shape
    ):  # one that composes two calibrations may have more parameters
        return ()
    known = known + probe_covariance(written.curve.coefficients, written.curve.basis, probe)
    rest = total - known
    scale = 1.0 / np.sqrt(np.diagonal(total))
    alike = scale[:, None] * rest * scale[None, :]  # biases and scale factors have other units
    values = np.linalg.eigvalsh(0.5 * (alike + alike.T))
    if values.min() < -_ROUNDING:
        return ()
    if values.max() < _ROUNDING:  # no effect on this triad
        return parts
    return (*parts, Part(beside, math.inf, rest))


def source_record(part: Part) -> SourceRecord:
    """A part of a covariance as the record writes it."""
    lower = part.covariance[np.tril_indices(len(part.covariance))]
    degrees = part.degrees if math.isfinite(part.degrees) else None
    return SourceRecord(part.source, degrees, tuple(lower.tolist()))
