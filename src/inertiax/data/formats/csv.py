"""Delimited text: CSV and its relatives, with comma, semicolon, tab or blanks between fields.

Where the names stand, which lines come before them and what separates fields is told by the first lines
(`text_layout`), or by `[recordings] header_line` and `names`. Decimal commas are read where fields are not
separated by commas.
"""

import re
import shlex
from collections import Counter
from pathlib import Path
from typing import NoReturn

import polars as pl

from ...storage.harmless_text import short
from ..frames import TRIADS
from ..recording import COLUMNS, Recording
from . import lvm, novatel
from .columns import AS_FOUND, AXES, ColumnMap, Layout, numbered_name, shown
from .nmea import refuse_satellites
from .table import to_recordings
from .text_layout import as_utf8, fields, find_layout, is_value, TextLayout, UTF8_MARK


NAME = "csv"
SUFFIXES = (".csv", ".tsv", ".txt", ".log", ".dat", ".gcsv", ".lvm")
_CUT = 0.01  # of all rows: more have an empty last field on purpose
_CHECKSUM = re.compile(rb"\*[0-9A-Fa-f]{2}$", re.MULTILINE)
KEYS = ("header_line",)  # of `Layout`, beyond those that all formats know
MOST_UNIT_ROWS = 5  # below the names (convention): the loggers that are known write three
_MOST = 10_000  # columns of a header whose doubled names are numbered; more are no log's, and take minutes to read
# Names that are read unasked: which of two is meant nobody could say.
_CANONICAL = {*COLUMNS, "device", *(f"{t}_{a}" for t in TRIADS for a in AXES)}


def read(path: Path, columns: ColumnMap, layout: Layout = AS_FOUND) -> tuple[Recording, ...]:
    """Recordings in a text file, one per device. Raises `ValueError` naming file, row and column."""
    table = read_table(path, layout.said_names, header_line=layout.header_line)
    return to_recordings(table, columns, layout, name=path.name)


def read_table(
    path: Path, names: tuple[str, ...] | None = None, *, header_line: int | None = None
) -> pl.DataFrame:
    """All fields as text, under their column names.

    **Arguments:** `names` are those of a file without a header line; `header_line` is the line that holds them,
    counted from 1, where the first lines do not tell.
    """
    data = text_of(path)
    layout = find_layout(data, path.name, header_line)
    return parse_rows(
        data[layout.start :], layout, column_names(layout, names, path.name), path.name
    )


def text_of(path: Path) -> bytes:
    """A file's text with line feeds at its lines' ends. Raises `ValueError` where it is empty, binary, or a
    satellite receiver's.

    Bytes of zero at the start and at the end, which an interrupted or a preallocating logger leaves, are no text and
    are left out; anywhere else they are refused.
    """
    data = path.read_bytes()
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        raise ValueError(f"{path.name}: the text is UTF-16; save it as UTF-8.")
    text = data.strip(b"\0") if data[:1] == b"\0" or data[-1:] == b"\0" else data
    if not text.strip():
        raise ValueError(f"{path.name}: the file is empty; at least one sample is needed.")
    zero = text.find(b"\0")
    if zero >= 0:
        line = text.count(b"\n", 0, zero) + 1
        before = data.find(text[:1])
        raise ValueError(
            f"{path.name}: the content is binary, not delimited text: byte {before + zero} (line {line}) is zero."
        )
    text = with_line_feeds(text.removeprefix(UTF8_MARK))
    refuse_satellites(text, path.name)
    if novatel.is_novatel(text):
        return novatel.as_rows(text)
    return lvm.as_rows(text, path.name) if lvm.is_lvm(text) else text


def with_line_feeds(text: bytes) -> bytes:
    """Text with line feeds at its lines' ends, whatever stands there; the checksums of NMEA sentences are left out."""
    if b"\r" in text:
        text = text.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    return _CHECKSUM.sub(b"", text) if text.startswith(b"$") else text


def column_names(layout: TextLayout, names: tuple[str, ...] | None, where: str) -> tuple[str, ...]:
    """Names of the columns, by the header or by the campaign.

    A name that stands in the header more than once gets a number: `ax (1)`, `ax (2)`; canonical ones do not.

    Raises `ValueError` where both or none say them.
    """
    if layout.names is None and names is None:
        raise ValueError(
            f"{where}: no header line, the first line of data holds values, not names; give the "
            f"{layout.width} column names as [recordings] names = [...]."
        )
    if layout.names is None or names is None or names == layout.names:
        found = layout.names or names or ()
        found = tuple(n or f"column {k}" for k, n in enumerate(found, start=1))
        return found if layout.names is None else _numbered(found)
    raise ValueError(
        f"{where}: [recordings] names is for files without a header line, but this one has "
        f"{shown(layout.names)} in line {layout.header_line}; map those under [columns]."
    )


def _numbered(names: tuple[str, ...]) -> tuple[str, ...]:
    """Names of a header with numbers behind those that stand in it more than once."""
    if len(names) > _MOST:
        return names
    several = {n for n, count in Counter(names).items() if count > 1} - _CANONICAL
    seen: Counter[str] = Counter()
    made = []
    for name in names:
        seen[name] += 1
        made.append(numbered_name(name, seen[name]) if name in several else name)
    return tuple(made)


def parse_rows(data: bytes, layout: TextLayout, names: tuple[str, ...], where: str) -> pl.DataFrame:
    """Lines of data as a table of text. Raises `ValueError` where they are not as the layout says."""
    delimiter, data = layout.delimiter, as_utf8(data, layout.page)
    if len(set(names)) < len(names):
        twice = next(n for n in names if names.count(n) > 1)
        raise ValueError(
            f"{where}: column name '{short(twice)}' stands twice in the header {shown(names)}; rename one "
            "of them."
        )
    if not data.strip():
        raise ValueError(
            f"{where}: no rows of data under the header; at least one sample is needed."
        )
    if delimiter == " ":
        data, delimiter = _single_commas(data), ","
    try:
        table = pl.read_csv(
            data, separator=delimiter, has_header=False, infer_schema=False, comment_prefix="#"
        )
    except pl.exceptions.PolarsError as error:
        _raise_ragged(data, delimiter, len(names), where, str(error).splitlines()[0])
    table = _without_empty_ends(table, len(names))
    if table.width != len(names):
        elsewhere = (
            "; if they stand in another line, say so: [recordings] header_line = ... (counted from 1)"
            if layout.header_line is not None
            else ""
        )
        raise ValueError(
            f"{where}: {len(names)} column names {shown(names)} but {table.width} columns of data{elsewhere}."
        )
    table.columns = list(names)
    table = without_header_again(table, layout.names)
    blank = pl.all_horizontal(
        pl.nth(0).str.strip_chars().fill_null("") == "", pl.nth(*range(1, table.width)).is_null()
    )
    # Lines of nothing but blanks
    table = _without_remarks(table.filter(~blank)) if table.width > 1 else table.drop_nulls()
    if not table.height:
        raise ValueError(
            f"{where}: no rows of data, only separators; at least one sample is needed."
        )
    last = table.row(-1)
    if last[-1] is None and len(last) > 1 and table.get_column(names[-1]).null_count() == 1:
        found = sum(v is not None for v in last)
        raise ValueError(
            f"{where}: the last row has {found} of {len(names)} fields; the file seems cut off; remove that row."
        )
    missing = table.get_column(names[-1]).null_count()
    if 0 < missing < _CUT * table.height:
        _raise_cut(data, layout, len(names), delimiter, where)
    return table if layout.delimiter == "," else _decimal_points(table)


def _raise_cut(data: bytes, layout: TextLayout, width: int, delimiter: str, where: str) -> None:
    """Refuse a text of which a few lines have fewer fields than all others: a serial port lost a part of them."""
    lines = data.split(b"\n")
    fewest = width - 1 if b'"' not in data else 0
    cut = [
        line
        for line in lines
        if line.strip() and line[:1] != b"#" and line.count(delimiter.encode()) < fewest
    ]
    if cut:
        above = layout.header_line or len(layout.preamble)
        separator = {",": "-F, ", ";": "-F';' ", "\t": "-F'\\t' "}.get(layout.delimiter, "")
        raise ValueError(
            f"{where}: {len(cut)} of {len(lines)} lines are cut off ('{short(cut[0].decode('utf-8', 'replace'))}' has "
            f"fewer than {width} fields); take them out: awk {separator}'NR<={above} || NF>={width}' "
            f"{shlex.quote(where)} > {shlex.quote(f'whole_{where}')}"
        )


def _single_commas(data: bytes) -> bytes:
    """Text with one comma for every run of blanks, and none at a line's ends."""
    data = data.replace(b"\t", b" ")
    while b"  " in data:  # each pass halves the longest run
        data = data.replace(b"  ", b" ")
    return data.replace(b" \n", b"\n").replace(b"\n ", b"\n").strip(b" ").replace(b" ", b",")


def _without_empty_ends(table: pl.DataFrame, width: int) -> pl.DataFrame:
    """Rows that end with a delimiter, and maybe a blank behind it, have an empty last field, which is no column."""
    while table.width > width and (table.to_series(-1).fill_null("").str.strip_chars() == "").all():
        table = table[:, :-1]
    return table


def without_header_again(table: pl.DataFrame, header: tuple[str, ...] | None) -> pl.DataFrame:
    """The rows without those that hold the names once more, and the rows of text that stand below the names the first
    time, as units do: what a logger prints that is switched on again."""
    if header is None:
        return table
    again = table.to_series(0).str.strip_chars() == header[0]
    for column, name in zip(table.get_columns()[1:], header[1:]):
        if not again.any():
            return table
        again &= column.fill_null("").str.strip_chars() == name
    again = again.fill_null(False)
    if not again.any():
        return table
    below = below_the_names(table)
    rows, left_out = table.rows() if below else [], again.to_list()
    for row in again.arg_true():
        for k, line in enumerate(below, start=row + 1):
            if k >= len(rows) or rows[k] != line:
                break
            left_out[k] = True
    return table.filter(~pl.Series(left_out))


def below_the_names(table: pl.DataFrame) -> list[tuple[str | None, ...]]:
    """The first rows in which no field is a value: units, and what else a logger writes there."""
    found = []
    for row in table.head(MOST_UNIT_ROWS + 1).iter_rows():
        if any(field and is_value(str(field).strip()) for field in row):
            return found
        found.append(row)
    return []


def _without_remarks(table: pl.DataFrame) -> pl.DataFrame:
    """The rows without those lines that lack fields and hold words alone: what a serial monitor shows between data."""
    short_rows = table.to_series(-1).is_null()
    if not short_rows.any():
        return table
    rows = short_rows.arg_true()
    words = [
        not any(f and is_value(f.strip()) for f in r if f is not None) for r in table[rows].rows()
    ]
    kept = (
        pl.Series([True])
        .new_from_index(0, table.height)
        .scatter(rows.filter(pl.Series(words)), False)
    )
    return table.filter(kept)


def _raise_ragged(data: bytes, delimiter: str, width: int, where: str, error: str) -> NoReturn:
    for row, line in enumerate(data.decode("utf-8", "replace").splitlines()):
        found = len(fields(line, delimiter))
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
