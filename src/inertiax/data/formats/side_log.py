"""A log of its own beside the device's: a table's, or a temperature's."""

from pathlib import Path
from typing import NamedTuple

import msgspec
import numpy as np
import polars as pl
from jaxtyping import Bool, Float

from . import csv, hdf5, matlab, parquet
from .columns import ColumnMap, TimeColumn
from .detect import detect
from .table import stamps_of


class SideLog(NamedTuple):
    """The rows of a side log as they lie in its file."""

    rows: pl.DataFrame
    time: Float[np.ndarray, " rows"]  # s, on its own clock
    later: Bool[np.ndarray, " rows"]  # whether a row comes after all before it


def read_side_log(
    path: Path, columns: ColumnMap, clock: TimeColumn | str | None, what: str
) -> SideLog:
    """The rows of a delimited text, or of a Parquet, HDF5 or MATLAB file, whose clock is `clock`, else
    `[columns] time`, else a column `time`: the rate at which a device's rows are counted is no other log's.

    Raises `ValueError` for another format, of `what` ("a table's log"), and where there are no stamps.
    """
    chosen = detect(path)
    if chosen not in (csv, parquet, hdf5, matlab):
        raise ValueError(
            f"{path.name}: {what} must be delimited text or Parquet; this is {chosen.NAME}."
        )
    rows = csv.read_table(path) if chosen is csv else chosen.decode(path)
    counted = isinstance(columns.time, TimeColumn) and columns.time.rate is not None
    clock = clock or (None if counted else columns.time)
    time = stamps_of(rows, msgspec.structs.replace(columns, time=clock), path.name)
    return SideLog(rows, time, np.r_[True, time[1:] > np.maximum.accumulate(time)[:-1]])
