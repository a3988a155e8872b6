"""Stamps in two columns of a text without names: whole seconds since 1970 and nanoseconds, as ROS prints a header."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from .raw_log import RawLog


EPOCH = (0.9e9, 2.5e9)  # s since 1970: 1998 to 2049
_TICKS = (
    1e6,
    1e9,
)  # ns: a second holds no more, and a log of more than a moment reaches a thousandth


class SplitStamps(NamedTuple):
    """Times in two columns, and all columns of such times."""

    seconds: Float[np.ndarray, " rows"]
    columns: tuple[str, ...]


def split_stamps(log: RawLog) -> SplitStamps | None:
    """The first pair of such columns that rises throughout; `None` where there is none."""
    names, found, columns = list(log.names), None, []
    for first, second in zip(names, names[1:], strict=False):
        whole, rest = log.numbers[first], log.numbers[second]
        if not (_whole(whole) and _whole(rest)):
            continue
        epoch = EPOCH[0] < whole.min() and whole.max() < EPOCH[1]
        if not epoch or rest.min() < 0 or not _TICKS[0] < rest.max() < _TICKS[1]:
            continue
        columns += [first, second]
        seconds = (whole - whole[0]) + 1e-9 * rest
        if found is None and np.all(np.diff(seconds) > 0):
            found = seconds
    return None if found is None else SplitStamps(found, tuple(columns))


def _whole(values: Float[np.ndarray, " rows"]) -> bool:
    return len(values) > 1 and bool(np.all(values == np.round(values)))


def is_since_1970(values: Float[np.ndarray, " rows"]) -> bool:
    """Whether all numbers are times of our years in s, ms, µs or ns, though some repeat; whole seconds are none that
    tell a step."""
    told = values[np.isfinite(values)]
    if not len(told) or len(np.unique(told)) < len(told) / 2:
        return False
    ends = np.array([told.min(), told.max()])
    return any(
        EPOCH[0] < x[0] and x[1] < EPOCH[1] for x in (ends / f for f in (1.0, 1e3, 1e6, 1e9))
    )
