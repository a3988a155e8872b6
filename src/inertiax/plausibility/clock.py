"""The clock: unit by the usual step, stamps in bursts, gaps, restarts, recordings that overlap."""

import numpy as np
from jaxtyping import Float

from ..data.recording_order import clocks_overlap
from ..reduction.host_stamps import host_stamps
from . import remedies
from .evidence import DeviceLogs, Log
from .finding import Finding, finding
from .thresholds import Thresholds


_GAP = 20.0  # usual steps
_LOST = 0.02  # share of rows
# Usual steps from a whole number, in the median: rows that are missing leave 0, stamps that scatter evenly 1/4.
_NEAR_WHOLE = 1.0 / 8.0
_RESTART = 60.0  # s, a gap after which a device may have been switched off
_COOLED = 1.0  # °C across such a gap


def check_clock(device: DeviceLogs, limits: Thresholds) -> list[Finding]:
    """Every recording's stamps, and their order."""
    found: list[Finding] = []
    for log in device.logs:
        if log.recording.num_samples < 11:
            continue
        steps = np.diff(log.recording.time)
        found += _unit(device, log, steps, limits)
        found += _bursts(log)
        found += _gaps(log, steps)
        found += _restarts(log, steps)
    return found + _overlaps(device)


def _unit(device: DeviceLogs, log: Log, steps: np.ndarray, limits: Thresholds) -> list[Finding]:
    """A step that no IMU has. Whole numbers of a few to some tens are milliseconds."""
    usual = log.step
    text = f"{log.name}: the usual step in time is {usual:.4g} s"
    if usual < limits.shortest_step:
        remedy = remedies.time_unit(device.columns, 1e3)
        said = "likely seconds or milliseconds read as a smaller unit"
        return [
            finding("time_unit", "error", "time", f"{text}; {said}.", remedy=remedy, step=usual)
        ]
    whole = bool(np.all(np.abs(log.recording.time - np.round(log.recording.time)) < 1e-6))
    if usual > 1000.0 * limits.longest_step and log.recording.num_samples > 100:
        remedy = remedies.time_unit(device.columns, 1e-6)
        said = "likely microseconds read as seconds"
        return [
            finding("time_unit", "error", "time", f"{text}; {said}.", remedy=remedy, step=usual)
        ]
    if usual > 3.0 * limits.longest_step and whole and log.recording.num_samples > 500:
        remedy = remedies.time_unit(device.columns, 1e-3)
        said = "all stamps are whole; likely milliseconds read as seconds"
        return [
            finding("time_unit", "warning", "time", f"{text}; {said}.", remedy=remedy, step=usual)
        ]
    return []


def _bursts(log: Log) -> list[Finding]:
    """Stamps made by a host when it reads: several rows at once, then a pause."""
    seen = host_stamps(log.recording.time)
    if seen is None:
        return []
    if seen.rate is None:
        mend = "No constant rate fits them, so rows seem lost; log the sensor's own stamps."
    else:
        mend = f"Count rows at the sensor's own rate, {seen.rate:g} Hz."
    return [
        finding(
            "clock",
            "warning",
            "time",
            f"{log.name}: stamps come in bursts: {seen.pauses} of {seen.steps} steps are more than 3 times the usual "
            f"{1e3 * seen.usual:.3g} ms, and their mean is {1e3 * seen.mean:.3g} ms. {mend}",
            remedy=None if seen.rate is None else remedies.rows_at(seen.rate),
            median_step=seen.usual,
            mean_step=seen.mean,
            irregular=seen.pauses,
        )
    ]


def _gaps(log: Log, steps: np.ndarray) -> list[Finding]:
    gaps = np.flatnonzero(steps > _GAP * log.step)
    lost = _share_lost(steps[steps < _GAP * log.step] / log.step)
    if lost > _LOST and host_stamps(log.recording.time) is None:
        return [_lost(log, lost)]
    if not len(gaps) or len(gaps) > 0.02 * len(steps):
        return []
    widest = int(gaps[np.argmax(steps[gaps])])
    return [
        finding(
            "gap",
            "note",
            "time",
            f"{log.name}: {len(gaps)} gap(s) in time of more than 20 usual steps ({log.step:.4g} s); the longest "
            f"is {steps[widest]:.4g} s after row {widest} ({log.moment(log.recording.time[widest])}).",
            gaps=len(gaps),
            longest=float(steps[widest]),
            row=widest,
        )
    ]


def _share_lost(steps: Float[np.ndarray, " step"]) -> float:
    """The share of rows that are missing, by steps in units of the usual one: what their sum has beyond their number.

    None where long steps are no whole numbers of the usual one. Stamps that scatter make long steps as well, and as
    many short ones; and where they scatter to one side the usual step is not the mean one, and nothing is missing.
    """
    long = steps[steps > 1.5]
    if not len(long) or np.median(np.abs(long - np.round(long))) > _NEAR_WHOLE:
        return 0.0
    return float(steps.sum()) / len(steps) - 1.0


def _lost(log: Log, share: float) -> Finding:
    text = f"{log.name}: by the stamps {share:.1%} of the rows are missing, a few here and there."
    return finding("gap", "note", "time", text, share=share)


def _restarts(log: Log, steps: np.ndarray) -> list[Finding]:
    """A long gap over which the temperature jumps: the device was off, and its bias may be another one."""
    probe = log.recording.temperature
    gaps = np.flatnonzero(steps > max(_RESTART, _GAP * log.step))
    if probe is None or not len(gaps):
        return []
    jumps = [
        k
        for k in gaps
        if abs(np.median(probe[max(k - 8, 0) : k + 1, 0]) - np.median(probe[k + 1 : k + 10, 0]))
        > _COOLED
    ]
    if not jumps:
        return []
    times = ", ".join(log.moment(log.recording.time[k]) for k in jumps[:4])
    return [
        finding(
            "restart",
            "note",
            "time",
            f"{log.name}: {len(jumps)} gap(s) of a minute or more over which the temperature jumps (at {times}): "
            "the device may have been off, and its bias another one since.",
            restarts=len(jumps),
        )
    ]


def _overlaps(device: DeviceLogs) -> list[Finding]:
    pairs = clocks_overlap(sorted(device.recordings, key=lambda r: float(r.time[0])))
    if not pairs:
        return []
    before, after = pairs[0]
    what = f"{before.name} and {after.name} overlap in time"
    if all(abs(log.recording.time[0]) <= log.step for log in device.logs):
        what = f"the clocks of {before.name} and the others begin at 0"
    return [
        finding(
            "clock",
            "note",
            "time",
            f"{what}: recordings are taken one after the other as they are listed, and a drift "
            "over the campaign is judged in that order.",
            overlaps=len(pairs),
        )
    ]
