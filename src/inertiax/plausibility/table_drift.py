"""The clock of a table's own log that runs faster or slower than the device's."""

import itertools

import numpy as np
from jaxtyping import Float

from ..data.formats.delay import Clocks, compared, delay_of, evened
from .evidence import DeviceLogs, Log
from .finding import Finding, finding
from .thresholds import Thresholds


# Sigmas of a log's delay that those of its halves make over all of it: √2 each, a difference, half a log apart.
_HALVES = 4.0
_PARTS, _FEWEST = 6, 4  # of a log whose delays are put on a line, and those that must have one
_CHANGES = 1e-3  # of the largest speed, from one row to the next


def drift_of_table(
    device: DeviceLogs, sigmas: dict[int, float], limits: Thresholds
) -> Finding | None:
    """A warning where the table's angles are late by more at one end of a log than at the other, with both lines.

    Clocks of computers and devices run differently by tens of ppm: 30 ppm are 0.1 s in an hour.

    **Arguments:** `sigmas` are standard deviations of each log's delay, s, by its number.
    """
    if device.drift is None:
        return None
    found = {k: c for k, s in sigmas.items() if (c := _drifting(device, k, s, limits)) is not None}
    if not found:
        return None
    worst = max(found, key=lambda k: abs(_grows(device, k, found[k])))
    log, grows = device.logs[worst], _grows(device, worst, found[worst])
    text = (
        f"{log.name}: the table's angles get {abs(grows):.3f} s {'later' if grows > 0 else 'earlier'} from the first "
        f"row to the last, as the gyros turn: its clock runs {abs(grows) / _span(log) * 1e6:.1f} ppm "
        f"{'faster' if grows > 0 else 'slower'} than [table] says. References are wrong while the table turns."
    )
    return finding(
        "delay", "warning", "table_angles", text, remedy=_right(device, found),
        seconds=grows, ppm=found[worst].drift,
    )  # fmt: skip


def _drifting(device: DeviceLogs, number: int, sigma: float, limits: Thresholds) -> Clocks | None:
    """The clocks of a log whose drift is not the stated one."""
    log, known = device.logs[number], _known(device, number)
    recording = log.recording
    assert recording.gyro is not None and recording.reference_gyro is not None
    time = recording.time
    one, other = (
        evened(time, np.linalg.norm(x, axis=1)) for x in (recording.gyro, recording.reference_gyro)
    )
    found = compared(time, one, known.on_other(time), other, known)
    least = max(limits.table_delay, limits.table_delay_sigmas * _HALVES * sigma)
    if abs(_grows(device, number, found)) < least:
        return None
    return found if _goes_with_time(time, one, other, limits.table_delay_sigmas) else None


def _goes_with_time(
    time: Float[np.ndarray, " rows"],
    speed: Float[np.ndarray, " rows"],
    reference: Float[np.ndarray, " rows"],
    sigmas: float,
) -> bool:
    """Whether delays of parts of a log lie on a line beyond their scatter.

    Where rows of the table repeat the one before, each part has a delay of its own, and its standard deviation, which
    takes rows for independent, says less.
    """
    changing = time[1:][np.abs(np.diff(reference)) > _CHANGES * reference.max(initial=0.0)]
    edges = np.quantile(changing, np.linspace(0.0, 1.0, _PARTS + 1))
    moments, late = [], []
    for low, high in itertools.pairwise(edges):
        rows = (time >= low) & (time <= high)
        found = delay_of(time[rows], speed[rows], time, reference)
        if found is not None:
            moments.append(0.5 * (low + high))
            late.append(found[0])
    if len(late) < _FEWEST:
        return False
    (slope, _), covariance = np.polyfit(np.array(moments) - np.mean(moments), late, 1, cov=True)
    return bool(abs(slope) > sigmas * np.sqrt(covariance[0, 0]))


def _known(device: DeviceLogs, number: int) -> Clocks:
    """What `[table]` says, the table's log taken to begin with the device's: another beginning changes the delay alone,
    by its distance times the drift."""
    one = lambda said: float(said[number] if isinstance(said, tuple) else said)
    drift = 0.0 if device.drift is None else one(device.drift)
    delay, start = one(device.delay), float(device.logs[number].recording.time[0])
    return Clocks(delay, drift, start + delay)


def _grows(device: DeviceLogs, number: int, found: Clocks) -> float:
    """By how much later the table's stamps get over a log than is stated, s."""
    return 1e-6 * (found.drift - _known(device, number).drift) * _span(device.logs[number])


def _span(log: Log) -> float:
    return float(log.recording.time[-1] - log.recording.time[0])


def _right(device: DeviceLogs, found: dict[int, Clocks]) -> str | None:
    """The lines of `[table]` that mend it; none where those in the file are of other devices' files, too."""
    count = len(device.logs)
    said = (device.delay, device.drift)
    if any(isinstance(v, tuple) and len(v) != count for v in said):
        return None
    clocks = [found.get(k, _known(device, k)) for k in range(count)]
    listed = lambda values: values[0] if count == 1 else f"[{', '.join(values)}]"
    delays = listed([f"{c.delay:.4f}" for c in clocks])
    return f"[table]\ndelay = {delays}\ndrift = {listed([f'{c.drift:.2f}' for c in clocks])}"
