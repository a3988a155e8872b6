"""The clock of a table against the device's: how late the stamps of its angles, or references in columns, are."""

import dataclasses

import numpy as np
from jaxtyping import Float

from ..data.formats.delay import delay_of, evened, misfit_with
from .evidence import DeviceLogs, Log
from .finding import Finding, finding
from .table_drift import drift_of_table
from .thresholds import Thresholds


# Of the misfit is left at the most by a delay of less than a row, and by any of references in columns, which may be
# the rates that the table was told: a delay of its control, or of a low-pass, leaves more.
_EXPLAINED = 0.25
_MEANS = 0.75  # rows; outputs that are means over their row are half of one late, by no clock
_RAMP = 3  # rows at least of a change that is a motion; a rate that was told jumps
_CHANGES = 1e-3  # of the largest speed, from one row to the next


def check_table_delay(device: DeviceLogs, limits: Thresholds) -> list[Finding]:
    """A warning where the gyros turn earlier or later than the angles say, with the delay that mends it, or with delay
    and drift where that changes from the first row to the last; the same of references in columns, in words.

    At 100 °/s a tenth of a second is 10° of gravity's direction.
    """
    if "gyro" in device.left_alone:
        return []
    if device.columns.table_angles is None:
        late = {k: f for k, log in enumerate(device.logs) if (f := _in_columns(log, limits))}
        return [_with_remedy(f, device, late, limits) for f in late.values()]
    told = {k: found for k, log in enumerate(device.logs) if (found := _late(log)) is not None}
    drifts = drift_of_table(device, {k: sigma for k, (_, sigma) in told.items()}, limits)
    if drifts is not None:  # its lines hold the delay, too
        return [drifts]
    least = lambda sigma: max(limits.table_delay, limits.table_delay_sigmas * sigma)
    each = isinstance(device.delay, tuple)
    if each:  # each log has its own, and is judged by it
        told = {k: (late, sigma) for k, (late, sigma) in told.items() if abs(late) >= least(sigma)}
    if not told:
        return []
    number = min(told, key=lambda k: told[k][1])
    late, sigma = told[number]
    if abs(late) < least(sigma):
        return []
    right = _right(device, {k: d for k, (d, _) in told.items()}, late)
    name, side = device.logs[number if each else 0].name, "late" if late > 0 else "early"
    text = (
        f"{name}: the table's angles are {abs(late):.3f} s {side}, as the gyros turn: two clocks. References are wrong "
        "while the table turns."
    )
    return [
        finding(
            "delay", "warning", "table_angles", text, remedy=right,
            seconds=late, std=sigma,
        )
    ]  # fmt: skip


def _late(log: Log, always: bool = False) -> tuple[float, float] | None:
    """By how much the reference of a log is late, s, and its standard error; `always` only where that explains it."""
    gyro, reference, time = log.recording.gyro, log.recording.reference_gyro, log.recording.time
    if gyro is None or reference is None:
        return None
    one, other = (evened(time, _speed(x)) for x in (gyro, reference))
    found = delay_of(time, one, time, other)
    if found is None or (abs(found[0]) >= log.step and not always):
        return found
    # A part of a row is resolved where turns last several rows: else rows that are means over their step seem late.
    left, given = (misfit_with(time, one, other, d) for d in (found[0], 0.0))
    return found if left < _EXPLAINED * given else None


def _in_columns(log: Log, limits: Thresholds) -> Finding | None:
    """A warning where the references beside the outputs move at other moments than the gyros turn."""
    reference = log.recording.reference_gyro
    if reference is None or not _moves(_speed(reference)):
        return None
    found = _late(log, always=True)
    least = max(limits.table_delay, _MEANS * log.step)
    if found is None or abs(found[0]) < max(least, limits.table_delay_sigmas * found[1]):
        return None
    late, sigma = found
    side = "late" if late > 0 else "early"
    text = (
        f"{log.name}: the reference columns are {abs(late):.3f} s {side}, as the gyros turn: two clocks. References "
        f"are wrong while the table turns. Move reference_accel, reference_gyro and position by that "
        f"({abs(late) / log.step:.3g} rows) towards the {'beginning' if late > 0 else 'end'} of the log, as [table] "
        "delay does."
    )
    return finding("delay", "warning", "reference_gyro", text, seconds=late, std=sigma)


def _with_remedy(
    found: Finding, device: DeviceLogs, late: dict[int, Finding], limits: Thresholds
) -> Finding:
    """The finding with the line of `[table]` that mends it, where one number does for all logs of the device."""
    each = [float(dict(f.evidence)["seconds"]) for f in late.values()]  # pyright: ignore[reportArgumentType]
    alike = len(late) == len(device.logs) and np.ptp(each) < limits.table_delay
    if not alike or isinstance(device.delay, tuple):
        return found
    line = f"[table]\ndelay = {device.delay + float(np.mean(each)):.3f}"
    return dataclasses.replace(found, remedy=line)


def _moves(speed: Float[np.ndarray, " rows"]) -> bool:
    """Whether most of a reference's changes of speed last several rows, as motions do."""
    steps = np.abs(np.diff(speed))
    changing = steps > _CHANGES * speed.max(initial=0.0)
    edges = np.flatnonzero(np.diff(np.r_[False, changing, False]))
    lasts = [(a, b) for a, b in zip(edges[::2], edges[1::2]) if b - a >= _RAMP]
    return bool(sum(steps[a:b].sum() for a, b in lasts) > 0.5 * steps[changing].sum())


def _right(device: DeviceLogs, late: dict[int, float], one: float) -> str | None:
    """The line of `[table]` that mends it: `one` later for all files, or each what is late in it; none where the
    delays are those of other devices' files, too."""
    said = device.delay
    if not isinstance(said, tuple):
        return f"[table]\ndelay = {said + one:.3f}"
    if len(said) != len(device.logs):
        return None
    return (
        f"[table]\ndelay = [{', '.join(f'{d + late.get(k, 0.0):.3f}' for k, d in enumerate(said))}]"
    )


def _speed(rates: Float[np.ndarray, "rows 3"]) -> Float[np.ndarray, " rows"]:
    return np.linalg.norm(rates, axis=1)
