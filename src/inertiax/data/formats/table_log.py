"""The log of a table that writes one of its own."""

from pathlib import Path

import msgspec
import numpy as np

from . import csv, parquet
from .columns import ColumnMap
from .detect import detect
from .numeric_columns import numbers
from .table import stamps_of
from .table_motion import table_motion, TableMotion
from .turntable import Turntable


def read_table_log(path: Path, columns: ColumnMap, table: Turntable) -> TableMotion:
    """The motion in a delimited text or a Parquet file, whose clock is `[columns] table_time`, else `time`.

    A row that repeats a stamp is left out.

    Raises `ValueError` for another format, for a missing column, and as `table_motion` does.
    """
    chosen = detect(path)
    if chosen not in (csv, parquet):
        raise ValueError(
            f"{path.name}: a table's log must be delimited text or Parquet; this is {chosen.NAME}."
        )
    rows = csv.read_table(path) if chosen is csv else parquet.decode(path)
    clock = columns.table_time or columns.time
    time = stamps_of(rows, msgspec.structs.replace(columns, time=clock), path.name)
    later = np.r_[True, time[1:] > np.maximum.accumulate(time)[:-1]]
    read = lambda names, scale: (
        scale * np.stack([numbers(rows, n, path.name)[later] for n in names], axis=1)
    )
    return table_motion(read, columns, table, time[later])
