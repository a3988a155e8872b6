"""Parquet files, through Arrow's C++ reader.

polars' own reader is as quick, but ends the process on some damaged files where Arrow's raises an error.
"""

import contextlib
import os
import sys
from collections.abc import Iterator
from pathlib import Path

import polars as pl

from ..recording import Recording
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
    import pyarrow.parquet as pq  # slow to import, and only needed here

    with contextlib.ExitStack() as stack:
        with _damage_told(path.name):
            file = stack.enter_context(pq.ParquetFile(path, memory_map=False))
            values = file.metadata.num_rows * len(file.schema_arrow)
        require_plausible(8 * values, path.stat().st_size, path.name)
        with _damage_told(path.name), _quiet():
            return pl.DataFrame(pl.from_arrow(file.read()))


@contextlib.contextmanager
def _damage_told(name: str) -> Iterator[None]:
    """One line for whatever a reader of damaged bytes may raise: names that are no text, types that clash."""
    import pyarrow as pa

    try:
        yield
    except (
        ArithmeticError, LookupError, MemoryError, NotImplementedError, OSError, TypeError, ValueError,
        pa.ArrowException, pl.exceptions.PolarsError, pl.exceptions.PanicException,
    ) as error:  # fmt: skip
        reason = " ".join(str(error).split())[:200].rstrip(".")
        raise ValueError(f"{name}: the Parquet file is damaged: {reason}.") from None


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
