"""The log of a table that writes one of its own."""

from pathlib import Path

import numpy as np

from .columns import ColumnMap
from .numeric_columns import numbers
from .side_log import read_side_log
from .table_motion import table_motion, TableMotion
from .turntable import Turntable


def read_table_log(path: Path, columns: ColumnMap, table: Turntable) -> TableMotion:
    """The motion in a side log, whose clock is `[columns] table_time`, else `time`.

    A row that repeats a stamp is left out.

    Raises `ValueError` for a missing column, and as `read_side_log` and `table_motion` do.
    """
    rows, time, later = read_side_log(path, columns, columns.table_time, "a table's log")
    read = lambda names, scale: (
        scale * np.stack([numbers(rows, n, path.name)[later] for n in names], axis=1)
    )
    return table_motion(read, columns, table, time[later])
