"""A table written piece by piece, as CSV or Parquet."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO, TYPE_CHECKING

import polars as pl


if TYPE_CHECKING:
    import pyarrow.parquet as pq


class TableWriter:
    """Appends pieces with the same columns to a file; a context, at whose end the file is whole."""

    def __init__(self, path: Path, suffix: str):
        """`suffix` tells the format, ".csv" or else Parquet, for the name of an unfinished file tells nothing."""
        self._path = path
        self._as_text = suffix.lower() == ".csv"
        self._text: BinaryIO | None = None
        self._parquet: pq.ParquetWriter | None = None

    def __enter__(self) -> "TableWriter":
        return self

    def __exit__(self, *error: object) -> None:
        for file in (self._text, self._parquet):
            if file is not None:
                file.close()

    def append(self, table: pl.DataFrame) -> None:
        """Write further rows. Raises `OSError` where the disk is full."""
        if self._as_text:
            fresh = self._text is None
            if self._text is None:
                self._text = self._path.open("wb")
            self._text.write(table.write_csv(include_header=fresh).encode())
            return
        arrow = table.to_arrow(compat_level=pl.CompatLevel.oldest())
        if self._parquet is None:
            import pyarrow.parquet as pq

            # Numbers of sensors hardly ever repeat: a dictionary of them costs time and saves nothing.
            texts: Any = [n for n, kind in table.schema.items() if kind == pl.String]
            self._parquet = pq.ParquetWriter(
                self._path, arrow.schema, compression="zstd", use_dictionary=texts
            )
        self._parquet.write_table(arrow)


@contextmanager
def full_disk_told(path: Path) -> Iterator[None]:
    """One line where the file system refuses to take what is written."""
    try:
        yield
    except OSError as error:
        told = os.strerror(error.errno) if error.errno else str(error)
        raise ValueError(f"{path}: cannot be written: {told}.") from None
