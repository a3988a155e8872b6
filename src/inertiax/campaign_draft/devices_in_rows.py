"""Rows of several devices in one file, told by a label that changes from row to row, whatever its column is called."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from .column_roles import Roles
from .raw_log import RawLog


_MOST_DEVICES = 64  # different labels: more are a counter or a measured quantity
_FIRST_ROWS = 10_000  # that show whether labels are few
_FEWEST_ROWS = 20  # of one device: fewer tell neither its steps nor its outputs
_ALTERNATES = 0.1  # of the rows differ in their label from the one before; a pose's or a chamber's label stays
# Leaps of a label's rows from their neighbours, in sigmas of one row. A column that a logger makes of the outputs
# themselves (a flag above a threshold) shifts the middle of its rows by less than 1.5; biases of two MEMS devices
# differ by ten and more.
_APART = 3.0
# The same where the stamps show the devices, too. Of 1000 rows it is three standard errors of their middle.
_APART_BY_STAMPS = 0.1
# Of the spread of all steps that of a label's own may be: stamps that each jitter by themselves keep it (1), those of
# a device that is read at a rate of its own lose it.
_REGULAR = 0.5
_IN_MIDDLE = 1.4826  # a normal distribution's sigma over its median deviation


class _Interleaved(NamedTuple):
    """The column that tells devices, and the rows of the first one."""

    name: str
    labels: int
    rows: Bool[np.ndarray, " rows"]


def _by_name(log: RawLog, name: str | None) -> _Interleaved | None:
    """The devices of a column that is known to name them; `None` where each device's rows stand in one block."""
    codes = None if name is None else _codes(log, name)
    return None if name is None or codes is None else _found(name, codes)


def _by_rows(
    log: RawLog, time: str | None, triads: tuple[tuple[str, str, str] | None, ...]
) -> _Interleaved | None:
    """The devices of a column of few labels that change from row to row, where each label's rows have outputs of
    their own: other than those of the rows before and behind them, by much more than the noise; or by less, where
    each label's stamps are regular and all together are not."""
    outputs = [n for t in triads if t is not None for n in t if n in log.numbers]
    stamps = None if time is None else (log.stamps | log.numbers).get(time)
    for name in (*log.labels, *log.names):
        if name in outputs or name == time:
            continue
        codes = _codes(log, name)
        found = None if codes is None else _found(name, codes)
        if codes is None or found is None:
            continue
        apart = max((_leap(log.numbers[n], codes) for n in outputs), default=0.0)
        regular = stamps is not None and _regular_alone(stamps, codes)
        if apart > (_APART_BY_STAMPS if regular else _APART):
            return found
    return None


def with_devices(log: RawLog, roles: Roles) -> Roles:
    """The same with the column that tells devices whose rows alternate, whatever it is called."""
    if roles.device is not None:
        return roles
    found = _by_rows(log, roles.time, (roles.accel, roles.gyro, roles.mag))
    if found is None or found.name in (roles.position, roles.experiment, roles.temperature):
        return roles
    by = (
        f"it changes from row to row, and the rows of each of its {found.labels} labels have outputs of their own; "
        "the clock, the units and the rests are those of one"
    )
    notes = tuple(n for n in roles.notes if not n.startswith(f"{found.name}:"))  # "left aside"
    return roles._replace(device=found.name, device_by=by, notes=notes)


def of_first_device(log: RawLog, name: str | None) -> RawLog:
    """The rows of one device where those of several alternate: its clock, its rests and its motions are whole."""
    found = _by_name(log, name)
    if found is None:
        return log
    only = lambda columns: {n: v[found.rows] for n, v in columns.items()}
    return log._replace(numbers=only(log.numbers), stamps=only(log.stamps), labels=only(log.labels))


def _codes(log: RawLog, name: str) -> Int[np.ndarray, " rows"] | None:
    """The labels of a column as numbers from 0; `None` where it holds none."""
    values = log.labels.get(name)
    if values is None:
        values = log.numbers.get(name)
    if (
        values is None
        or len(values) < 2 * _FEWEST_ROWS
        or not np.array_equal(values, np.round(values))
    ):
        return None
    if np.ptp(values) == 0.0 or np.mean(np.diff(values) != 0.0) < _ALTERNATES:
        return None
    if len(np.unique(values[:_FIRST_ROWS])) > _MOST_DEVICES:
        return None
    distinct, codes = np.unique(values, return_inverse=True)
    return codes if len(distinct) <= _MOST_DEVICES else None


def _found(name: str, codes: Int[np.ndarray, " rows"]) -> _Interleaved | None:
    rows = np.bincount(codes)
    if rows.min() < _FEWEST_ROWS:
        return None
    first = int(np.flatnonzero(2 * rows >= rows.max())[0])  # a slow device tells less
    return _Interleaved(name, len(rows), codes == first)


def _leap(values: Float[np.ndarray, " rows"], codes: Int[np.ndarray, " rows"]) -> float:
    """How far the rows of a label lie from the middle between their neighbours of other labels, in sigmas."""
    between = values[1:-1] - 0.5 * (values[:-2] + values[2:])
    alone = (codes[1:-1] != codes[:-2]) & (codes[1:-1] != codes[2:]) & np.isfinite(between)
    most = 0.0
    for label in np.unique(codes):
        own = between[alone & (codes[1:-1] == label)]
        if len(own) < _FEWEST_ROWS:
            continue
        middle = float(np.median(own))
        spread = _IN_MIDDLE * float(np.median(np.abs(own - middle)))
        most = max(most, abs(middle) / spread if spread > 0.0 else 0.0)
    return most


def _regular_alone(stamps: Float[np.ndarray, " rows"], codes: Int[np.ndarray, " rows"]) -> bool:
    """Whether each label's stamps have more regular steps than all stamps together."""
    spread = lambda t: float(np.subtract(*np.nanpercentile(np.diff(t), (75.0, 25.0))))
    together = spread(stamps)
    return all(spread(stamps[codes == c]) < _REGULAR * together for c in np.unique(codes))
