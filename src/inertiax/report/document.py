"""Results as documents for scripts: plain dictionaries of numbers and text, SI throughout."""

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ..calibrate.fit_quality import judge, Quality
from ..calibrate.pipeline import DeviceFailure, DeviceResult, TriadResult
from ..calibration.calibration import TriadCalibration
from ..calibration.quantities import middle_temperature, si_unit
from .judge import triads
from .magnetometers import magnetometer_document
from .values import Value


def calibration_document(
    results: Sequence[DeviceResult | DeviceFailure], folders: dict[str, str], output: Path
) -> dict[str, Value]:
    """The outcome of every device, schema `inertiax.calibrations/1`."""
    failed = sum(isinstance(r, DeviceFailure) for r in results)
    return {
        "schema": "inertiax.calibrations/1",
        "num_devices": len(results),
        "num_failed": failed,
        "devices": [_device(r, folders, output) for r in results],
    }


def _device(
    result: DeviceResult | DeviceFailure, folders: dict[str, str], output: Path
) -> dict[str, Value]:
    if isinstance(result, DeviceFailure):
        return {"device": result.device, "status": "failed", "reason": result.reason}
    calibration = result.calibration
    folder = output / folders[calibration.device]
    at = middle_temperature(calibration)
    known = calibration.temperature_range is not None
    return {
        "device": calibration.device,
        "status": "calibrated",
        "calibration": str(folder / "calibration.json"),
        "report": str(folder / "report.html"),
        "temperature_range": [float(t) for t in calibration.temperature_range or ()] or None,
        "temperature": at if known else None,
        "model": result.model.document(),
        "choices": list(result.choices),
        "warnings": list(result.warnings),
        "plausibility": [f.as_dict() for f in result.plausibility],
        "handling": [d.as_dict() for d in result.handling],
        "quality": _quality(judge(result)),
        **{name: _triad(c, r, at) for name, (c, r) in triads(result).items()},
        **magnetometer_document(result),
    }


def _quality(quality: Quality) -> dict[str, Value]:
    return {
        "verdict": quality.verdict,
        "answer": quality.answer,
        "findings": [{"topic": f.topic, "fine": f.fine, "text": f.text} for f in quality.findings],
        "next": list(quality.next),
        "triads": [{"verdict": t.verdict, "text": t.text} for t in quality.triads],
    }


def _triad(triad: TriadCalibration, result: TriadResult, temperature: float) -> dict[str, Value]:
    (values,), (sigmas,) = (rows.tolist() for rows in triad.over(np.array([temperature])))
    chi2 = result.chi2_per_dof
    return {
        "estimator": triad.estimator,
        "method": result.solution.method,
        "terms_over_temperature": triad.curve.basis.size,
        "num_dwells": result.dwells.num_dwells,
        "num_iterations": int(result.solution.num_iterations),
        "rms": result.rms,
        "scatter": result.scatter,
        "unit": result.misfit_unit,
        "chi2_per_dof": chi2 if math.isfinite(chi2) else None,
        "condition": result.observability.condition,
        "parameters": [
            {"name": name, "value": value, "std": sigma, "unit": si_unit(name)}
            for name, value, sigma in zip(triad.names, values, sigmas, strict=True)
        ],
    }
