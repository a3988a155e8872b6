"""The table of a CSV or Parquet file in pieces, so that a long log need not be in memory as a whole."""

from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import polars as pl

from . import csv, parquet, text_batches
from .columns import ColumnMap, Layout, TimeColumn


ROWS = 1 << 17  # of a piece of Parquet
BYTES = 1 << 24  # of a piece of text


def can_be_cut(chosen: ModuleType) -> bool:
    """Whether a file of that format can be read in pieces."""
    return chosen in (csv, parquet)


def pieces(
    path: Path, chosen: ModuleType, layout: Layout, *, rows: int = ROWS, size: int = BYTES
) -> Iterator[pl.DataFrame]:
    """The file's table, without the first `layout.start_row` rows; fields of text as text.

    **Arguments:** `rows` (of Parquet) and `size` (bytes of text) are those of a piece.

    Raises `ValueError` where the table is damaged, or is a text that only `csv.read_table` reads.
    """
    if chosen is parquet:
        tables = parquet.batches(path, rows)
    else:
        tables = text_batches.batches(
            path, layout.said_names, header_line=layout.header_line, size=size
        )
    skip = layout.start_row
    for table in tables:
        left = table.slice(skip)
        skip = max(skip - table.height, 0)
        if left.height:
            yield left


def counts_rows(columns: ColumnMap) -> bool:
    """Whether a row's number is its time, so that pieces have no clock that tells their order."""
    rate = columns.time.rate if isinstance(columns.time, TimeColumn) else None
    return rate is not None or columns.each_row_is_a_pose


def mends_stamps(columns: ColumnMap) -> bool:
    """Whether stamps are put between their neighbours, which may be those of another piece."""
    return isinstance(columns.time, TimeColumn) and columns.time.mend
