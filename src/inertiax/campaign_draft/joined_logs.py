"""Further recordings of a campaign behind its first one: a station often writes a file for each step of its plan."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float

from .clock import ALL_UNITS, Clock
from .devices_in_rows import of_first_device
from .raw_log import RawLog, read_logs
from .raw_triads import columns, in_rows, RawTriads
from .settings_rows import without_settings


# Usual steps between two recordings: more than what ends a rest.
_APART = 30


def alike(log: RawLog, others: Sequence[Path], device: str | None = None) -> tuple[RawLog, ...]:
    """The further recordings; where rows of several devices alternate, by the column `device`, those of one.

    Raises `ValueError` where one lacks a column of numbers that the first one has.
    """
    wanted = {*log.stamps, *log.names}
    found = []
    for path in others:
        # Of several lengths those with the same columns
        held = [without_settings(x) for x in read_logs(path)]
        found.append(next((x for x in held if wanted <= {*x.stamps, *x.names}), held[0]))
    for other in found:
        names = (*other.stamps, *other.names)
        missing = [n for n in (*log.stamps, *log.names) if n not in names]
        if missing:
            raise ValueError(
                f"{other.path}: has no column {', '.join(map(repr, missing[:4]))}, which {log.path.name} has; give "
                "logs of the same columns together, a table's own logs as --table FILE, which goes before each of "
                "them, a temperature's as --temperature FILE, and the others a campaign of their own."
            )
    return tuple(of_first_device(other, device) for other in found)


def followed_by(first: RawTriads, others: Sequence[RawLog]) -> RawTriads:
    """All recordings as one, the clock going on from each to the next, as the first one's columns and clock say."""
    if not others or first.gyro_log is not None:
        return first
    logs = (first.log, *others)
    log = first.log._replace(
        numbers={n: np.concatenate([x.numbers[n] for x in logs]) for n in first.log.numbers},
        stamps={n: np.concatenate([x.stamps[n] for x in logs]) for n in first.log.stamps},
        labels={},  # other files may number other words
        texts={
            n: tuple(sorted({w for x in logs for w in x.texts.get(n, ())})) for n in first.log.texts
        },
    )
    apart = _APART * float(np.median(np.diff(first.clock.seconds)))
    seconds, end = [], 0.0
    for one in (first.clock.seconds, *(_seconds(x, first.clock) for x in others)):
        seconds.append(end + one - one[0])
        end = seconds[-1][-1] + apart
    accel, gyro = columns(log, first.roles.accel), columns(log, first.roles.gyro)
    return in_rows(first._replace(log=log), np.concatenate(seconds), accel, gyro)


def _seconds(log: RawLog, clock: Clock) -> Float[np.ndarray, " rows"]:
    if clock.name is None:
        return np.arange(len(next(iter(log.numbers.values())))) / (clock.rate or 1.0)
    if clock.name in log.stamps:
        return log.stamps[clock.name]
    return ALL_UNITS[clock.unit or "s"] * log.numbers[clock.name]
