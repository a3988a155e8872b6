"""Delimited text: CSV and its relatives, with comma, semicolon, tab or blanks between fields.

The first lines decide: comment lines start with `#`, `%` or `//`; a comment with as many fields as the
data is the header (EuRoC's `#timestamp [ns],...`); a line with a field that is no number is the header.
A file without one takes its names from `[recordings] names`. Decimal commas are read where fields
are separated by semicolons.
"""

import csv
import statistics
from pathlib import Path
from typing import NoReturn

import polars as pl

from ..recording import Recording
from .columns import AS_FOUND, ColumnMap, Layout, short, shown
from .table import to_recordings


NAME = "csv"
SUFFIXES = (".csv", ".tsv", ".txt", ".log", ".dat")
KEYS = ()  # of `Layout`, beyond those that all formats know
_COMMENTS = ("#", "%", "//")
_DELIMITERS = ("\t", ";", ",", " ")


def read(path: Path, columns: ColumnMap, layout: Layout = AS_FOUND) -> tuple[Recording, ...]:
    """Recordings in a text file, one per device. Raises `ValueError` naming file, row and column."""
    table = read_table(path, layout.names)
    return to_recordings(table, columns, layout, name=path.name)


def read_table(path: Path, names: tuple[str, ...] | None = None) -> pl.DataFrame:
    """All fields as text, under their column names."""
    data = _text_bytes(path)
    lines, offset = _first_lines(data)
    body = [line for line in lines if not line.startswith(_COMMENTS)]
    if not body:
        raise ValueError(f"{path.name}: the file has no rows of data, only comments.")
    delimiter = sniff_delimiter(body)
    header, skipped = _header(lines, body, delimiter)
    if header is None and names is None:
        raise ValueError(
            f"{path.name}: no header line, the first line holds only numbers; give the "
            f"{len(_fields(body[0], delimiter))} column names as [recordings] names = [...]."
        )
    if header is not None and names is not None:
        raise ValueError(
            f"{path.name}: [recordings] names is for files without a header line, but this one has "
            f"{shown(header)}; map those under [columns]."
        )
    start = offset[skipped]
    return _parse(data[start:], delimiter, list(header or names or ()), path.name)


def sniff_delimiter(lines: list[str]) -> str:
    """The first of tab, semicolon, comma and blank that splits most lines into equally many fields."""
    for delimiter in _DELIMITERS:
        counts = [len(_fields(line, delimiter)) for line in lines[:20]]
        usual = statistics.mode(counts)
        if usual > 1 and 2 * counts.count(usual) > len(counts):
            return delimiter
    return ","


def _text_bytes(path: Path) -> bytes:
    data = path.read_bytes()
    if not data.strip():
        raise ValueError(f"{path.name}: the file is empty; at least one sample is needed.")
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        raise ValueError(f"{path.name}: the text is UTF-16; save it as UTF-8.")
    if b"\0" in data[:65536]:
        raise ValueError(f"{path.name}: the content is binary, not delimited text.")
    return data.removeprefix(b"\xef\xbb\xbf").replace(b"\r\n", b"\n").replace(b"\r", b"\n")


def _first_lines(data: bytes) -> tuple[list[str], list[int]]:
    """The first lines that are not blank, and where in `data` each starts."""
    lines, starts, position = [], [], 0
    while position < len(data) and len(lines) < 100:
        end = data.find(b"\n", position)
        end = len(data) if end < 0 else end
        line = data[position:end].decode("utf-8", "replace").strip()
        if line:
            lines.append(line)
            starts.append(position)
        position = end + 1
    return lines, [*starts, position]


def _fields(line: str, delimiter: str) -> list[str]:
    if delimiter == " ":
        return line.split()
    return [f.strip() for f in next(csv.reader([line], delimiter=delimiter))]


def _is_number(field: str) -> bool:
    try:
        float(field.replace(",", "."))
    except ValueError:
        return not field
    return True


def _header(
    lines: list[str], body: list[str], delimiter: str
) -> tuple[tuple[str, ...] | None, int]:
    """Column names, `None` where there are none, and how many of `lines` come before the data."""
    first = lines.index(body[0])
    fields = _fields(body[0], delimiter)
    if not all(map(_is_number, fields)):
        return _named(fields), first + 1
    if first > 0:
        comment = lines[first - 1].lstrip("#%/ ")
        named = _fields(comment, delimiter)
        if len(named) == len(fields) and not all(map(_is_number, named)):
            return _named(named), first
    return None, first


def _named(fields: list[str]) -> tuple[str, ...]:
    return tuple(f.strip().strip('"') for f in fields)


def _parse(data: bytes, delimiter: str, names: list[str], where: str) -> pl.DataFrame:
    if len(set(names)) < len(names):
        twice = next(n for n in names if names.count(n) > 1)
        raise ValueError(
            f"{where}: column name '{short(twice)}' stands twice in the header {shown(names)}."
        )
    if not data.strip():
        raise ValueError(
            f"{where}: no rows of data under the header; at least one sample is needed."
        )
    if delimiter == " ":
        data = b"\n".join(b",".join(line.split()) for line in data.splitlines())
        delimiter = ","
    try:
        table = pl.read_csv(
            data, separator=delimiter, has_header=False, infer_schema=False, comment_prefix="#"
        )
    except pl.exceptions.PolarsError as error:
        _raise_ragged(data, delimiter, len(names), where, str(error).splitlines()[0])
    if table.width != len(names):
        raise ValueError(
            f"{where}: {len(names)} column names {shown(names)} but {table.width} columns of data."
        )
    table.columns = names
    table = table.filter(~pl.all_horizontal(pl.all().is_null()))  # blank lines
    if not table.height:
        raise ValueError(
            f"{where}: no rows of data, only separators; at least one sample is needed."
        )
    last = table.row(-1)
    if last[-1] is None and len(last) > 1 and table.get_column(names[-1]).null_count() == 1:
        found = sum(v is not None for v in last)
        raise ValueError(
            f"{where}: the last row has {found} of {len(names)} fields; the file seems cut off."
        )
    return _decimal_points(table) if delimiter == ";" else table


def _raise_ragged(data: bytes, delimiter: str, width: int, where: str, error: str) -> NoReturn:
    for row, line in enumerate(data.decode("utf-8", "replace").splitlines()):
        found = len(_fields(line, delimiter))
        if found > width:
            raise ValueError(
                f"{where}: row {row} has {found} fields but there are {width} columns."
            )
    raise ValueError(f"{where}: not readable as delimited text: {error}.")


def _decimal_points(table: pl.DataFrame) -> pl.DataFrame:
    commas = [
        c for c in table.columns if table.get_column(c).str.contains(r"^\s*[-+]?\d*,\d").any()
    ]
    return table.with_columns(pl.col(commas).str.replace(",", "."))
