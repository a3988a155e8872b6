"""Settings that stand as rows of numbers above the samples: a start and a rate, as Empatica's E4 writes them."""

import numpy as np

from ..data.formats.array_notes import ArrayNotes
from .raw_log import RawLog
from .split_stamps import EPOCH


_RATES = (1.0, 1000.0)  # Hz, of what is worn on a body
_ROWS = 2


def without_settings(log: RawLog) -> RawLog:
    """The samples of a text without a header whose first row is one time since 1970 in all columns, and whose second
    is one rate; any other log as it is. `unit_rows` then counts the two rows, and `notes` hold the rate."""
    columns = list(log.numbers.values())
    if log.layout is None or log.layout.names is not None or log.stamps or not columns:
        return log
    top = np.stack([c[: _ROWS + 1] for c in columns], axis=1)
    if len(top) <= _ROWS or not np.all(top[:_ROWS] == top[:_ROWS, :1]):
        return log
    start, rate = top[:_ROWS, 0]
    if not (EPOCH[0] < start < EPOCH[1] and _RATES[0] <= rate <= _RATES[1]):
        return log
    if len(columns) == 1 or np.max(np.abs(top[_ROWS])) >= EPOCH[0]:
        return log
    notes = ArrayNotes(float(rate), "row 2, under the start's time in row 1,", sure=True)
    numbers = {n: c[_ROWS:] for n, c in log.numbers.items()}
    return log._replace(numbers=numbers, unit_rows=_ROWS, notes=notes)
