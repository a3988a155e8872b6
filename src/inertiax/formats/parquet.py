"""Parquet files, through polars."""

import contextlib
import os
import sys
from collections.abc import Iterator
from pathlib import Path

import polars as pl

from ..recordings import Recording
from .columns import AS_FOUND, ColumnMap, Layout
from .expansion import require_plausible
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
    return decode(path)


def decode(path: Path) -> pl.DataFrame:
    """The table in a Parquet file. Raises `ValueError` where it is damaged, or unpacks to more than a
    recording can."""
    try:
        with _quiet():
            lazy = pl.scan_parquet(path, hive_partitioning=False, glob=False)
            rows = int(lazy.select(pl.len()).collect().item())
            require_plausible(8 * rows * len(lazy.collect_schema()), path.stat().st_size, path.name)
            return lazy.collect()
    except (pl.exceptions.PolarsError, OSError, pl.exceptions.PanicException) as error:
        reason = " ".join(str(error).split())[:200].rstrip(".")
        raise ValueError(f"{path.name}: the Parquet file is damaged: {reason}.") from None


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Nothing on standard error: there polars' Rust side tells of panics before they are raised."""
    sys.stderr.flush()
    kept = os.dup(2)
    try:
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, 2)
        os.close(nowhere)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
