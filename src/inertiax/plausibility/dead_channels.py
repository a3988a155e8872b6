"""Channels that never change, or hold one value for long while the others of their triad live."""

import numpy as np
from jaxtyping import Float

from ..data.formats.columns import AXES
from .evidence import DeviceLogs, Log
from .finding import Finding, finding
from .thresholds import Thresholds


_FEWEST_ROWS = 100
# Different values from which a channel lives: one that stands still in coarse steps shows a few.
_LIVES = 50
_WAY = 20  # rows in which a channel shows how it goes
_HELD = 0.1  # of a log; shorter freezes are matters of single rows


def triads(log: Log) -> list[tuple[str, Float[np.ndarray, "time 3"]]]:
    """The triads that were recorded, by name."""
    pairs = (("accel", log.recording.accel), ("gyro", log.recording.gyro))
    return [(name, values) for name, values in pairs if values is not None]


def check_dead_channels(device: DeviceLogs, limits: Thresholds) -> list[Finding]:
    """A channel that never changes or is held.

    It is certain to be dead where the two beside it live, and a whole triad where the other one lives.
    """
    found = []
    for log in device.logs:
        if log.recording.num_samples < _FEWEST_ROWS:
            continue
        noisy = any(np.all(np.ptp(v, axis=0) > 0) for _, v in triads(log))
        for name, values in triads(log):
            still = np.ptp(values, axis=0) == 0
            if still.all():
                told = ", ".join(f"{v:.6g}" for v in values[0])
                found.append(
                    finding(
                        "constant_channel",
                        "error" if noisy else "warning",
                        name,
                        f"{log.name}: {name}_x, _y and _z never change ({told}): nothing was measured. Leave the "
                        "columns out.",
                        axes=3,
                    )
                )
                continue
            for k in range(3):
                told = _one(device, log, name, k, limits)
                found += [] if told is None else [told]
    return found


def is_dead(device: DeviceLogs, triad: str, limits: Thresholds) -> bool:
    """Whether a channel of a triad is certain to be dead or held in some log; nothing more can be told by it."""
    for log in device.logs:
        values = dict(triads(log)).get(triad)
        if values is None or len(values) < _FEWEST_ROWS:
            continue
        if any(_held_rows(log, values, k, limits) is not None for k in range(3)):
            return True
    return False


def _one(device: DeviceLogs, log: Log, name: str, axis: int, limits: Thresholds) -> Finding | None:
    values = dict(triads(log))[name]
    x = values[:, axis]
    never = bool(np.ptp(x) == 0)
    rows = _held_rows(log, values, axis, limits)
    if rows is None and not never:
        return None
    if never:
        said = f"{name}_{AXES[axis]} never changes ({x[0]:.6g}); the channel looks dead, or at the end of its range."
    else:
        assert rows is not None
        start, stop = rows
        said = (
            f"{name}_{AXES[axis]} holds {x[start]:.6g} for {stop - start} rows from "
            f"{log.moment(log.recording.time[start])} while the axes beside it change; the channel was dead there."
        )
    certain = rows is not None and name not in device.left_alone
    if certain:
        said += f' Mend it, or calibrate without this triad: [model] {name}_estimator = "none".'
    return finding(
        "constant_channel",
        "error" if certain else "warning",
        f"{name}_{AXES[axis]}",
        f"{log.name}: {said}",
        value=float(x[0] if rows is None else x[rows[0]]),
        rows=len(x) if rows is None else rows[1] - rows[0],
    )


def _held_rows(
    log: Log, values: Float[np.ndarray, "time 3"], axis: int, limits: Thresholds
) -> tuple[int, int] | None:
    """Rows of the longest stretch in which a channel holds one value although both others live there; `None` where
    it is shorter than a tenth of the log."""
    x = values[:, axis]
    if np.count_nonzero(x[1:] == x[:-1]) < max(_HELD * len(x), _FEWEST_ROWS) - 1:
        return None  # as a channel that lives: quicker than its runs
    edges = np.flatnonzero(np.concatenate([[True], np.diff(x) != 0, [True]]))
    lengths = np.diff(edges)
    longest = int(np.argmax(lengths))
    start, rows = int(edges[longest]), int(lengths[longest])
    if rows < max(_HELD * len(x), _FEWEST_ROWS) or rows * log.step < limits.frozen:
        return None
    never = rows == len(x)
    if not never and (_ends_range(x, x[start], rows) or _runs_into_end(x, start, rows)):
        return None
    if not never and not lives(np.delete(x, np.s_[start : start + rows])):
        return None
    beside = np.delete(values[start : start + rows], axis, axis=1)
    return (start, start + rows) if lives(beside[:, 0]) and lives(beside[:, 1]) else None


def _ends_range(x: Float[np.ndarray, " time"], value: float, rows: int) -> bool:
    """Whether a channel comes back to the value that it held, and goes beyond it nowhere: the end of its range, which
    `check_saturation` tells. A channel that died holds a value that is one of many before or behind."""
    extreme = value in (x.max(), x.min())
    return bool(extreme and np.count_nonzero(x == value) - rows >= _FEWEST_ROWS)


def _runs_into_end(x: Float[np.ndarray, " time"], start: int, rows: int) -> bool:
    """Whether a channel holds its extreme, went there by steps as it goes and comes back by such: it was driven beyond
    the end of its range once. One that died leaves what it held with a jump, and seldom holds its extreme."""
    value, stop = x[start], start + rows
    if value not in (x.max(), x.min()) or start < _WAY or stop + _WAY > len(x):
        return False
    before, after = x[start - _WAY : start], x[stop : stop + _WAY]
    on_its_way = abs(before[-1] - value) <= np.ptp(before), abs(after[0] - value) <= np.ptp(after)
    return all(on_its_way)


def lives(x: Float[np.ndarray, " time"]) -> bool:
    """Whether a channel shows so many different values that it moves."""
    return len(np.unique(x)) >= _LIVES
