"""Parquet files, through Arrow's C++ reader.

polars' own reader is as quick, but ends the process on some damaged files where Arrow's raises an error.
"""

import contextlib
import os
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import polars as pl

from ..recording import Recording
from .columns import AS_FOUND, ColumnMap, Layout
from .expansion import require_plausible
from .table import to_recordings


if TYPE_CHECKING:
    import pyarrow as pa
    import pyarrow.parquet as pq

NAME = "parquet"
SUFFIXES = (".parquet", ".pq")
KEYS = ()
MAGIC = b"PAR1"
_BUFFER = 1 << 20  # bytes
_BATCHES = 4  # that are read in one iteration


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
    with _opened(path) as file:
        texts = _texts(file)
        if not texts:
            with _damage_told(path.name), _quiet():
                return pl.DataFrame(pl.from_arrow(file.read()))
        table = _with_texts(path, texts, file)
        with _damage_told(path.name), _quiet():
            return pl.DataFrame(pl.from_arrow(table))


def batches(path: Path, rows: int) -> Iterator[pl.DataFrame]:
    """The table of `decode`, at most so many rows at a time. Raises as it does, at the latest with the last rows."""
    # Buffered, so that a group of all rows need not be in memory as it is stored.
    with _opened(path, buffer=_BUFFER) as file:
        texts = _texts(file)
        if texts and _stores_differences(file):  # Arrow reads those by few rows at a time alone
            yield from decode(path).iter_slices(rows)
            return
        pieces = _text_batches(path, texts, rows) if texts else _batches(path, file, rows)
        for piece in pieces:
            with _damage_told(path.name), _quiet():
                table = pl.DataFrame(pl.from_arrow(_plain_texts(piece, texts)))
            yield table


@contextlib.contextmanager
def _opened(path: Path, buffer: int = 0) -> "Iterator[pq.ParquetFile]":
    """A file that unpacks to no more than a recording can."""
    import pyarrow.parquet as pq  # slow to import, and only needed here

    with contextlib.ExitStack() as stack:
        with _damage_told(path.name):
            opened = pq.ParquetFile(path, memory_map=False, buffer_size=buffer)
            file = stack.enter_context(opened)
            values, unpacked = _claimed(file)
        require_plausible(max(8 * values, unpacked), path.stat().st_size, path.name)
        yield file


def _texts(file: "pq.ParquetFile") -> list[str]:
    return [f.name for f in file.schema_arrow if _is_text(f.type)]


def _claimed(file: "pq.ParquetFile") -> tuple[int, int]:
    """Values in the file, those of lists within a row included, and bytes of its unpacked pages."""
    described = file.metadata
    values, unpacked = described.num_rows * len(file.schema_arrow), 0
    for group in map(described.row_group, range(described.num_row_groups)):
        chunks = [group.column(k) for k in range(group.num_columns)]
        values = max(values, sum(c.num_values for c in chunks))
        unpacked += sum(c.total_uncompressed_size for c in chunks)
    return values, unpacked


def _is_text(kind: "pa.DataType") -> bool:
    import pyarrow as pa

    tests = (
        pa.types.is_string,
        pa.types.is_large_string,
        pa.types.is_binary,
        pa.types.is_large_binary,
    )
    return any(test(kind) for test in tests)


def _with_texts(path: Path, texts: list[str], plain: "pq.ParquetFile") -> "pa.Table":
    """The table of a file with columns of text, of which a few bytes can mean any length.

    Text is read as the file's dictionary of distinct values, and written out only where its length is plausible. Arrow
    cannot do so where values are stored as differences from the one before; such files are read by few rows at a time.
    """
    import pyarrow as pa

    rows = 256 if _stores_differences(plain) else 1 << 16
    batches = list(_text_batches(path, texts, rows, as_dictionary=rows > 256))
    with _damage_told(path.name):
        schema = batches[0].schema if batches else plain.schema_arrow
        return _plain_texts(pa.Table.from_batches(batches, schema=schema), texts)


def _text_batches(
    path: Path, texts: list[str], rows: int, *, as_dictionary: bool = True
) -> "Iterator[pa.RecordBatch]":
    """Rows of a file with columns of text, as long as what the text unpacks to is plausible."""
    import pyarrow.parquet as pq

    size, held = path.stat().st_size, 0
    with _damage_told(path.name):
        kept = texts if as_dictionary else []
        file = pq.ParquetFile(path, memory_map=False, read_dictionary=kept)
    with contextlib.closing(file):
        for batch in _batches(path, file, rows):
            held += batch.nbytes + sum(_written_out(batch.column(n)) for n in texts)
            require_plausible(held, size, path.name)
            yield batch


def _batches(path: Path, file: "pq.ParquetFile", rows: int) -> "Iterator[pa.RecordBatch]":
    for groups in _runs_of_groups(file, rows):
        batches = file.iter_batches(batch_size=rows, row_groups=groups)
        while True:
            with _damage_told(path.name), _quiet():
                batch = next(batches, None)
            if batch is None:
                break
            yield batch


def _runs_of_groups(file: "pq.ParquetFile", rows: int) -> Iterator[list[int]]:
    """Neighbouring row groups, each time some batches long: Arrow keeps what it read until an iteration ends."""
    groups, held = [], 0
    for k in range(file.metadata.num_row_groups):
        groups.append(k)
        held += file.metadata.row_group(k).num_rows
        if held >= _BATCHES * rows:
            yield groups
            groups, held = [], 0
    if groups:
        yield groups


def _plain_texts(table: "pa.Table | pa.RecordBatch", texts: list[str]) -> "pa.Table":
    """The table with its text written out."""
    import pyarrow as pa

    made = pa.Table.from_batches([table]) if isinstance(table, pa.RecordBatch) else table
    for name in texts:
        at = made.schema.get_field_index(name)
        made = made.set_column(at, name, made.column(name).cast(pa.large_string()))
    return made


def _stores_differences(file: "pq.ParquetFile") -> bool:
    described = file.metadata
    groups = map(described.row_group, range(described.num_row_groups))
    encodings = {e for g in groups for k in range(g.num_columns) for e in g.column(k).encodings}
    return "DELTA_BYTE_ARRAY" in encodings


def _written_out(column: "pa.Array") -> int:
    """Bytes of the text that a dictionary's indices stand for; 0 where the text is written out already."""
    import pyarrow as pa
    import pyarrow.compute as pc

    if not isinstance(column, pa.DictionaryArray):
        return 0
    lengths = pc.call_function("binary_length", [column.dictionary])
    return int(pc.call_function("sum", [lengths.take(column.indices)]).as_py() or 0)


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
