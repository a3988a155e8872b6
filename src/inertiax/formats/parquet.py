"""Parquet files, through polars."""

from pathlib import Path

import polars as pl

from ..recordings import Recording
from .columns import AS_FOUND, ColumnMap, Layout
from .table import to_recordings


NAME = "parquet"
SUFFIXES = (".parquet", ".pq")
KEYS = ()
MAGIC = b"PAR1"


def read(path: Path, columns: ColumnMap, layout: Layout = AS_FOUND) -> tuple[Recording, ...]:
    """Recordings in a Parquet file, one per device. Raises `ValueError` naming file and column."""
    if layout.names is not None:
        raise ValueError(
            f"{path.name}: [recordings] names is for text without a header line, and a Parquet file "
            "names its columns itself; map them under [columns]."
        )
    return to_recordings(_read_table(path), columns, layout, name=path.name)


def _read_table(path: Path) -> pl.DataFrame:
    size = path.stat().st_size
    if size == 0:
        raise ValueError(f"{path.name}: the file is empty; at least one sample is needed.")
    with path.open("rb") as file:
        head = file.read(4)
        file.seek(max(0, size - 4))
        tail = file.read(4)
    if head != MAGIC:
        raise ValueError(f"{path.name}: not a Parquet file: it does not begin with PAR1.")
    if tail != MAGIC:
        raise ValueError(
            f"{path.name}: the Parquet file is cut off ({size} bytes, no PAR1 at the end); copy it again."
        )
    try:
        return pl.read_parquet(path, hive_partitioning=False, glob=False)
    except (pl.exceptions.PolarsError, OSError) as error:
        raise ValueError(
            f"{path.name}: the Parquet file is damaged: {str(error).splitlines()[0]}."
        ) from None
