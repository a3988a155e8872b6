"""The temperature: by its range, its rate and the way it stands still."""

import numpy as np
from jaxtyping import Float

from ..data.stored_recording import StoredRecording
from ..reduction.rounded_temperature import hidden_by_steps, temperature_step
from . import remedies
from .evidence import DeviceLogs, Log
from .finding import Finding, finding, Severity
from .thresholds import Thresholds


# Chips whose temperature is often logged as raw counts: °C = count / counts per degree + degrees at zero.
CHIPS = (
    ("MPU-6050 or MPU-9150", 340.0, 36.53),
    ("MPU-6500, MPU-9250 or ICM-20948", 333.87, 21.0),
    ("LSM6DS", 256.0, 25.0),
    ("BMI160 or BMI270", 512.0, 23.0),
    ("ICM-42688", 132.48, 25.0),
    ("BNO or a register of 0.01 °C", 100.0, 0.0),
)
_ON_A_DESK = 30.0  # °C of a chip in a room


def check_temperature(device: DeviceLogs, limits: Thresholds) -> list[Finding]:
    """Range and rate of the device's probe in each recording."""
    found: list[Finding] = []
    for log in device.logs:
        if log.recording.temperature is None:
            continue
        probe = log.recording.temperature[:, 0]
        found += _range(device, log, probe, limits)
        if not found or found[-1].severity != "error":
            found += _rate(log, probe, limits)
            found += _stuck(log, probe)
            found += _stepped(log, probe)
    return found


def _range(
    device: DeviceLogs, log: Log, probe: Float[np.ndarray, " time"], limits: Thresholds
) -> list[Finding]:
    low, high = (float(v) for v in np.quantile(probe, (0.001, 0.999)))
    span = f"{log.name}: the temperature goes from {low:.4g} to {high:.4g} °C"
    if low > limits.kelvin and high < limits.kelvin + 210.0:
        remedy = remedies.temperature(device.columns, 'unit = "K"')
        text = f"{span}, hotter than any inertial sensor works; likely kelvin."
        return [_told("error", text, remedy, low, high)]
    if low < limits.coldest or high > limits.kelvin:
        return [_counts(device, span, low, high, limits)]
    by_hand = not log.labelled and log.recording.reference_accel is None
    start = float(np.median(probe[: max(8, len(probe) // 50)]))
    if high > limits.hottest_part or (
        by_hand and start > limits.hottest_on_a_desk and log.num_rests > 1
    ):
        why = (
            "above what parts are specified for"
            if high > limits.hottest_part
            else f"and starts at {start:.3g} °C, hotter than a hand that turns it bears"
        )
        remedy = remedies.temperature(device.columns, 'unit = "degF"')
        text = f"{span}, {why}; are they degrees Fahrenheit?"
        return [_told("warning", text, remedy, low, high)]
    return []


def _counts(device: DeviceLogs, span: str, low: float, high: float, limits: Thresholds) -> Finding:
    """Raw counts, and the data sheet's formula that makes the most ordinary temperature of them."""
    why = "below absolute zero" if low < limits.absolute_zero else "where no inertial sensor works"
    fits = [
        (abs(0.5 * (low + high) / per + zero - _ON_A_DESK), chip, per, zero)
        for chip, per, zero in CHIPS
        if -55 < low / per + zero and high / per + zero < 125
    ]
    if not fits:
        text = f"{span}, {why}; look at unit, scale and offset of the temperature."
        return _told("error", text, None, low, high)
    said = [
        f"{chip}: {low / per + zero:.3g} to {high / per + zero:.3g} °C"
        for _, chip, per, zero in sorted(fits)
    ]
    _, _, per, zero = min(fits)
    keys = f'unit = "count", scale = {per:g}, scale_unit = "count per degC", offset = {-zero * per:.10g}'
    text = f"{span}, {why}; likely raw counts ({'; '.join(said)}; the first is taken, see the data sheet)."
    return _told("error", text, remedies.temperature(device.columns, keys), low, high)


def _told(severity: Severity, text: str, remedy: str | None, low: float, high: float) -> Finding:
    return finding("temperature", severity, "temperature", text, remedy=remedy, low=low, high=high)


def _rate(log: Log, probe: Float[np.ndarray, " time"], limits: Thresholds) -> list[Finding]:
    """Jumps that no thermal mass follows; not over gaps in the stamps."""
    if log.step <= 0 or log.step > limits.longest_step or len(probe) < 32:
        return []
    over = max(int(round(1.0 / log.step)), 1)
    if len(probe) <= 2 * over:
        return []
    sums = np.cumsum(np.append(0.0, probe))
    means = (sums[over:] - sums[:-over]) / over
    change = np.abs(means[over:] - means[:-over])
    elapsed = log.recording.time[2 * over - 1 :] - log.recording.time[: len(change)]
    rate = np.where(elapsed < 4.0 * over * log.step, change, 0.0)
    worst = int(np.argmax(rate))
    if rate[worst] < limits.temperature_rate:
        return []
    at = float(log.recording.time[worst + over])
    return [
        finding(
            "temperature",
            "warning",
            "temperature",
            f"{log.name}: the temperature changes by {rate[worst]:.3g} °C within a second (at {log.moment(at)}); no "
            "device does: a glitch of the probe, another unit, or raw counts.",
            rate=float(rate[worst]),
            time=at,
        )
    ]


def _stuck(log: Log, probe: Float[np.ndarray, " time"]) -> list[Finding]:
    """One value for far longer than the probe's own habit, in the midst of a change; or never any other."""
    if len(probe) < 500:
        return []
    changes = np.flatnonzero(np.diff(probe)) + 1
    if not len(changes):
        return [
            finding(
                "constant_channel",
                "note",
                "temperature",
                f"{log.name}: the temperature never changes ({probe[0]:.4g} °C); is it measured?",
                value=float(probe[0]),
            )
        ]
    edges = np.concatenate([[0], changes, [len(probe)]])
    holds = np.diff(edges)
    longest = int(np.argmax(holds))
    others = np.delete(holds, longest)
    if len(others) < 20 or holds[longest] < max(0.1 * len(probe), 20 * np.quantile(others, 0.98)):
        return []
    start = float(log.recording.time[edges[longest]])
    return [
        finding(
            "temperature",
            "warning",
            "temperature",
            f"{log.name}: the temperature stands still at {probe[edges[longest]]:.4g} °C for {holds[longest]} rows "
            f"(from {log.moment(start)}), although it changes every {np.mean(others):.3g} rows otherwise: the probe "
            "hangs.",
            rows=int(holds[longest]),
            time=start,
        )
    ]


def _stepped(log: Log, probe: Float[np.ndarray, " time"]) -> list[Finding]:
    """A probe whose whole steps hide the course in between."""
    step = 0.0 if isinstance(log.recording, StoredRecording) else temperature_step(probe)
    if step == 0.0:
        return []
    left = hidden_by_steps([log.recording])
    return [
        finding(
            "temperature_step",
            "note",
            "temperature",
            f"{log.name}: the temperature is read in steps of {step:.3g} °C; between them it is put by the moments at "
            f"which it changes, which leaves {left:.2g} °C unknown (1 sigma), counted in what depends on temperature. "
            "Whether readings are rounded or cut off nobody knows: cut off, all of them are half a step too low.",
            step=step,
            left=left,
        )
    ]
