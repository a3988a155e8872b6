"""Where in a Parquet file the rows of one device end and those of the next begin, by its column of serial numbers.

A column of few serial numbers is stored as numbers of a dictionary. Read as such, changes are found in a third of the
time that texts take.
"""

from collections.abc import Callable, Iterator
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
import polars as pl

from .locations import is_address, scan


if TYPE_CHECKING:
    import pyarrow.parquet as pq


_READ_AT_ONCE = 500_000  # rows: what stays in a core's cache
Run = tuple[str | None, int, int]  # serial number, first row, rows


def runs_of(file: str, column: str, height: int) -> Iterator[Run]:
    """Consecutive rows with one serial number; `None` where it is empty.

    **Arguments:** `height` is the number of the file's rows.
    """
    opened = None if is_address(file) else _with_dictionary(file, column)
    texts = partial(_by_texts, file, column, height)
    found = texts(0) if opened is None else _by_numbers(opened, column, texts)
    name, first, rows = next(found, (None, 0, 0))
    for serial, start, count in found:
        if serial == name:
            rows += count  # of a row group, or what was read at once
            continue
        yield name, first, rows
        name, first, rows = serial, start, count
    if rows:
        yield name, first, rows


def _with_dictionary(file: str, column: str) -> "pq.ParquetFile | None":
    """A file whose serial numbers are texts, kept in dictionaries; `None` for any other."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        opened = pq.ParquetFile(file, read_dictionary=[column])
        numbered = pa.types.is_dictionary(opened.schema_arrow.field(column).type)
    except (pa.ArrowException, OSError, KeyError):
        return None
    meta = opened.metadata
    paths = [meta.schema.column(k).path for k in range(meta.num_columns)]
    if not numbered or column not in paths:
        return None
    where = paths.index(column)
    kept = all(
        {"RLE_DICTIONARY", "PLAIN_DICTIONARY"} & set(meta.row_group(k).column(where).encodings)
        for k in range(meta.num_row_groups)
    )
    return opened if kept else None


def _by_numbers(
    opened: "pq.ParquetFile", column: str, texts: Callable[[int], Iterator[Run]]
) -> Iterator[Run]:
    """**Arguments:** `texts` gives what follows from a row on, where a serial number is missing."""
    first = 0
    for group in range(opened.num_row_groups):
        table = opened.read_row_group(group, columns=[column], use_threads=False)
        for piece in table.column(column).chunks:
            if piece.null_count:
                yield from texts(first)
                return
            if not len(piece):
                continue
            number = np.from_dlpack(piece.indices)  # `to_numpy` would import pandas
            starts = np.append(0, np.flatnonzero(number[1:] != number[:-1]) + 1)
            names = piece.dictionary.to_pylist()
            for start, count in zip(starts.tolist(), np.diff(starts, append=len(number)).tolist()):
                yield names[number[start]], first + start, count
            first += len(number)


def _by_texts(file: str, column: str, height: int, begin: int) -> Iterator[Run]:
    rows = scan(file)
    for first in range(begin, height, _READ_AT_ONCE):
        serial = rows.select(pl.col(column).cast(pl.String)).slice(first, _READ_AT_ONCE).collect()
        at = first
        for count, name in serial.get_column(column).rle().struct.unnest().iter_rows():
            yield name, at, count
            at += count
