"""What the report says of a device's data: triads with results, and what the dwells cover."""

import numpy as np

from ..calibrate.fit_quality import Quality, TRIAD_NAMES as TRIAD_NAMES, weakest as weakest
from ..calibrate.pipeline import DeviceResult, TriadResult
from ..calibration.calibration import Calibration, TriadCalibration


def triads(result: DeviceResult) -> dict[str, tuple[TriadCalibration, TriadResult]]:
    """The calibrated triads with their results, accelerometers first."""
    both = {
        "accel": (result.calibration.accel, result.accel),
        "gyro": (result.calibration.gyro, result.gyro),
    }
    return {k: (c, r) for k, (c, r) in both.items() if c is not None and r is not None}


def further_warnings(result: DeviceResult, quality: Quality) -> tuple[str, ...]:
    """The warnings that the answer itself does not say; it begins them with a letter of its own size."""
    said = quality.answer.casefold()
    return tuple(w for w in result.warnings if w.casefold() not in said)


def coverage_sentence(calibration: Calibration, result: TriadResult) -> str:
    """What the data covered: dwells, experiments, positions, temperatures."""
    dwells = result.dwells
    rests = np.asarray(dwells.position) >= 0
    moves = np.zeros(len(rests), bool) if dwells.move is None else np.asarray(dwells.move)
    parts = [f"{int(np.sum(rests))} rests"]
    for count, what in (
        (int(np.sum(~rests & ~moves)), "turns at constant rate"),
        (int(np.sum(moves)), "moves between rests"),
    ):
        parts += [f"{count} {what}"] if count else []
    experiments = len(np.unique(np.asarray(dwells.experiment)))
    text = f"{TRIAD_NAMES[result.estimator.triad]}: {' and '.join(parts)}"
    text += f" in {experiments} experiments" if experiments > 1 else ""
    if calibration.temperature_range is None:
        return text + ", without temperature."
    low, high = calibration.temperature_range
    return f"{text}, {low:.1f} to {high:.1f} °C."
