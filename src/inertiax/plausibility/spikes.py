"""Single samples far off in the midst of quiet ones, also where no rest is left because of them."""

import numpy as np
from jaxtyping import Bool, Float, Int

from ..data.recording import Recording
from .dead_channels import triads
from .evidence import DeviceLogs, Log
from .finding import Finding, finding
from .thresholds import Thresholds


_AROUND = 10  # rows to either side
_NEIGHBOURS = np.delete(np.arange(-_AROUND, _AROUND + 1), _AROUND)
_TIMES = 12.0  # of the neighbours' standard deviation: a tap rings for several rows
_OF_ALL = 6.0  # of the 98 % quantile of all rows' distances from their neighbours
_LEAST = {"accel": 0.5, "gyro": 0.05}  # m/s², rad/s
_FEWEST = 3
_A_MOTION = 0.2  # s: a table indexes, and a hand knocks, in one row of so slow a log
_ENOUGH = 50_000  # rows, from which a quantile is told to some hundredths


def check_spikes(device: DeviceLogs, limits: Thresholds) -> list[Finding]:
    """Rows that differ from both neighbours alike, while the rows around are quiet."""
    del limits
    found = []
    for log in device.logs:
        if log.step >= _A_MOTION:
            continue
        for name, values in triads(log):
            rows = _rows(values, _LEAST[name])
            rows = rows[~_moves(log.recording, rows)]
            if len(rows) >= _FEWEST:
                found.append(_told(log, name, rows))
    return found


def _rows(values: Float[np.ndarray, "time 3"], least: float) -> Int[np.ndarray, " spike"]:
    if len(values) < 100:
        return np.zeros(0, np.int64)
    off = np.zeros_like(values)
    off[1:-1] = np.abs(values[1:-1] - 0.5 * (values[2:] + values[:-2]))
    limit = np.maximum(_OF_ALL * np.quantile(off[:: len(off) // _ENOUGH + 1], 0.98, axis=0), least)
    hits = []
    for axis in range(values.shape[1]):
        rows = np.flatnonzero(off[:, axis] > limit[axis])
        rows = rows[(rows > _AROUND) & (rows < len(values) - _AROUND)]
        around = values[rows[:, None] + _NEIGHBOURS, axis]
        middle = np.median(around, axis=1)
        distance = np.median(np.abs(around - middle[:, None]), axis=1)
        quiet = 1.4826 * distance + around.std(axis=1)
        hits.append(rows[np.abs(values[rows, axis] - middle) > _TIMES * quiet])
    return np.unique(np.concatenate(hits))


def _moves(recording: Recording, rows: Int[np.ndarray, " spike"]) -> Bool[np.ndarray, " spike"]:
    """Whether a reference moves about these rows, or is not told there."""
    moves = np.zeros(len(rows), bool)
    for name, least in _LEAST.items():
        reference = getattr(recording, f"reference_{name}")
        if reference is not None:
            still = np.abs(reference[rows + 1] - reference[rows - 1]) <= least
            moves |= ~(still & (np.abs(reference[rows] - reference[rows - 1]) <= least)).all(axis=1)
    return moves


def _told(log: Log, name: str, rows: Int[np.ndarray, " spike"]) -> Finding:
    times = ", ".join(log.moment(log.recording.time[k]) for k in rows[:4])
    return finding(
        "spikes",
        "warning",
        name,
        f"{log.name}: {len(rows)} single samples of {name} are far off while their neighbours are quiet (at {times}): "
        "transmission errors, not motion. Take them out.",
        rows=len(rows),
    )
