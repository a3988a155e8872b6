"""A device's result judged in plain words: misfit against noise, coverage, the weakest parameter."""

import math

import numpy as np

from ..calibrate.fit_quality import TRIAD_NAMES as TRIAD_NAMES, Weakest, weakest as weakest
from ..calibrate.pipeline import DeviceResult, TriadResult
from ..calibration.calibration import Calibration, TriadCalibration
from ..calibration.quantities import rms_text


def triads(result: DeviceResult) -> dict[str, tuple[TriadCalibration, TriadResult]]:
    """The calibrated triads with their results, accelerometers first."""
    both = {
        "accel": (result.calibration.accel, result.accel),
        "gyro": (result.calibration.gyro, result.gyro),
    }
    return {k: (c, r) for k, (c, r) in both.items() if c is not None and r is not None}


def misfit_verdict(result: TriadResult) -> tuple[bool, str]:
    """Whether the misfit is what the dwells' own noise predicts, and a sentence that says so.

    Judged as the estimation did: it adds scatter between dwells where χ² is beyond its 99 % point.
    """
    name = TRIAD_NAMES[result.estimator.triad]
    rms = rms_text(result.misfit_unit, result.rms)
    scatter = rms_text(result.misfit_unit, result.scatter)
    chi2 = result.chi2_per_dof
    if not math.isfinite(chi2):
        return True, (
            f"{name}: the misfit is {rms} rms. The dwells' own noise is not known, so the misfit itself "
            f"sets the uncertainties."
        )
    if result.scatter == 0.0:
        return True, (
            f"{name}: the misfit is {rms} rms, which is what the noise of the dwells predicts "
            f"(χ² per degree of freedom {chi2:.2f})."
        )
    return False, (
        f"{name}: the misfit is {rms} rms, {math.sqrt(chi2):.1f} times what the noise of the dwells "
        f"predicts. Something differs from dwell to dwell by {scatter} "
        f"(1 sigma): re-positioning, drift, or physics that the model leaves out. The uncertainties "
        f"include it; 'inertiax diagnose' looks for the cause."
    )


def weakest_sentence(triad: str, found: Weakest) -> str:
    """The weakest parameter in words."""
    where = "" if found.temperature is None else f" (at {found.temperature:.0f} °C)"
    return f"{TRIAD_NAMES[triad]}: least certain is {found.label}, ± {found.sigma}{where}."


def coverage_sentence(calibration: Calibration, result: TriadResult) -> str:
    """What the data covered: dwells, experiments, positions, temperatures."""
    dwells = result.dwells
    rests = np.asarray(dwells.position) >= 0
    num_turns = int(np.sum(~rests))
    parts = [f"{int(np.sum(rests))} rests"]
    if num_turns:
        parts.append(f"{num_turns} turns at constant rate")
    experiments = len(np.unique(np.asarray(dwells.experiment)))
    text = f"{TRIAD_NAMES[result.estimator.triad]}: {' and '.join(parts)}"
    text += f" in {experiments} experiments" if experiments > 1 else ""
    if calibration.temperature_range is None:
        return text + ", without temperature."
    low, high = calibration.temperature_range
    return f"{text}, {low:.1f} to {high:.1f} °C."
