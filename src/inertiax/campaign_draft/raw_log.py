"""A log as it lies in its file: named columns of numbers, in units that nobody has told yet."""

import re
from pathlib import Path
from types import ModuleType
from typing import NamedTuple

import numpy as np
import polars as pl
from jaxtyping import Float

from ..data.formats import array_notes, csv, hdf5, imu_tk, matlab, parquet
from ..data.formats.detect import detect
from ..data.formats.text_layout import find_layout, TextLayout
from ..data.formats.time_stamps import seconds_of
from .labelled_numbers import by_sed, refuse_groups, refuse_labels, refuse_stamped


_NUMERIC = 0.99  # of a column's rows hold numbers; the rest are dropouts for `calibrate` to refuse
_IMU_TK = ("time", "x", "y", "z")
_FIRST_ROWS, _MOST_WORDS = 1000, 64  # of a column of text that are looked at
_MOST_LISTED = 4  # lines
_RATE = re.compile(
    r"(?:rate|\bfs\b|\bodr\b|freq\w*|hz)[^0-9a-z]{0,6}([0-9]+(?:\.[0-9]+)?)|([0-9]+(?:\.[0-9]+)?)\s*hz",
    re.IGNORECASE,
)
_RATES = (1.0, 20000.0)  # Hz: what an IMU may be read at
_FILTER = re.compile(r"lpf|low.?pass|filter|band.?width|cut.?off|corner|notch", re.IGNORECASE)
_RANGE = re.compile(r"([0-9]{3,4}) ?(?:dps|deg/s|°/s)", re.IGNORECASE)
_NUMBER_OF_NAME = re.compile(r" \(\d+\)$")
_MONITOR = re.compile(
    r"\d\d:\d\d:\d\d\.\d{3} -> "
)  # what Arduino's serial monitor writes before a line


class RawLog(NamedTuple):
    """Columns of a file in its own units."""

    path: Path
    format: str
    layout: TextLayout | None  # of a text
    numbers: dict[str, Float[np.ndarray, " rows"]]  # may hold NaN where a field is empty
    stamps: dict[str, Float[np.ndarray, " rows"]]  # s, of columns of stamps as text
    words: dict[str, str]  # units row by row below a header, by column
    unit_rows: int  # rows of text below the header
    texts: dict[
        str, tuple[str, ...]
    ] = {}  # columns of other text, which may be labels, each with its first words
    labels: dict[str, Float[np.ndarray, " rows"]] = {}  # of those with few words, each as a number
    notes: array_notes.ArrayNotes = array_notes.NOTHING  # of a file of arrays
    aside: tuple[
        str, ...
    ] = ()  # triads of other lengths in the file, each by its first column and rows

    names_again: tuple[int, ...] = ()  # lines below the header that are the header once more

    @property
    def names(self) -> tuple[str, ...]:
        """Columns of numbers, in the file's order."""
        return tuple(self.numbers)

    @property
    def has_header(self) -> bool:
        """Whether the file itself names its columns."""
        return self.layout is None or self.layout.names is not None

    def hint(self, column: str) -> str:
        """What the file says in words of a column: its name and its units, in lower case.

        A number behind a name that the header has more than once is none of its words.
        """
        name = _NUMBER_OF_NAME.sub("", column)
        return f"{name} {self.words.get(column, '')}".strip().lower()

    @property
    def stated_rate(self) -> float | None:
        """Samples a second that the lines above the header state, or a file of arrays beside them, Hz."""
        if self.notes.sure:
            return self.notes.rate
        for line in self.preamble:
            last = 0
            for found in _RATE.finditer(line):
                value, before = float(found[1] or found[2]), line[last : found.end()]
                last = found.end()
                if _RATES[0] <= value <= _RATES[1] and not _FILTER.search(before):
                    return value
        return None

    @property
    def stated_range(self) -> float | None:
        """Full scale of the gyros that the lines above the header state, deg/s."""
        found = next(filter(None, map(_RANGE.search, self.preamble)), None)
        return None if found is None else float(found[1])

    @property
    def preamble(self) -> tuple[str, ...]:
        """The lines above header and data."""
        return () if self.layout is None else self.layout.preamble


def read_log(path: Path) -> RawLog:
    """The columns of numbers in a delimited text, or in a Parquet, HDF5 or MATLAB file.

    Raises `ValueError` where the file is in another format, or holds no numbers.
    """
    return read_logs(path)[0]


def read_logs(path: Path) -> list[RawLog]:
    """The columns of numbers of each length that a file holds, most files one alone. Raises as `read_log` does."""
    chosen = detect(path)
    if chosen in (hdf5, matlab):
        tables, notes = chosen.described(path)
        filled = [t for t in tables if any(d.is_numeric() for d in t.dtypes)]
        logs = [_from_table(t, path, chosen.NAME, None) for t in filled or tables[:1]]
        words = lambda log: array_notes.words_of(notes, log.numbers)
        return [log._replace(notes=notes, words=words(log)) for log in logs]
    return [_read_one(path, chosen)]


def _read_one(path: Path, chosen: ModuleType) -> RawLog:
    if chosen is parquet:
        return _from_table(chosen.decode(path), path, chosen.NAME, None)
    if chosen not in (csv, imu_tk):
        raise ValueError(f"{path.name}: {chosen.NAME} names its columns and units itself.")
    text = csv.text_of(path)
    if _MONITOR.match(text[:40].decode("utf-8", "replace")):
        raise ValueError(
            f"{path.name}: a serial monitor's stamps ('{text[:16].decode()}') begin the lines; make them a column: "
            + by_sed("s/ -> /,/", path)
        )
    refuse_groups(text, path)
    refuse_stamped(text, path)
    layout = find_layout(text, path.name)
    names = layout.names or unnamed(layout.width)
    if chosen is imu_tk and layout.names is None and layout.width == len(_IMU_TK):
        names = _IMU_TK
    else:
        chosen = csv  # a text that is called as imu_tk's are
    log = _from_table(csv.read_table(path, names), path, chosen.NAME, layout)
    return log._replace(names_again=_lines_of_names(text, layout))


def _lines_of_names(text: bytes, layout: TextLayout) -> tuple[int, ...]:
    """The first lines below the header that hold the names once more; the reader leaves them out."""
    if layout.names is None or layout.header_line is None:
        return ()
    head = text[: layout.start].split(b"\n")
    line = b"\n" + head[layout.header_line - 1].strip()
    found, at = [], text.find(line, layout.start)
    while at >= 0 and len(found) < _MOST_LISTED:
        found.append(text.count(b"\n", 0, at) + 2)
        at = text.find(line, at + len(line))
    return tuple(found)


def as_text(log: RawLog) -> RawLog:
    """A log of imu_tk's layout as any text without a header line: of one that holds no accelerometers."""
    assert log.layout is not None  # imu_tk's files are text
    numbers = dict(zip(unnamed(log.layout.width), log.numbers.values(), strict=True))
    return log._replace(format=csv.NAME, numbers=numbers)


def unnamed(width: int) -> tuple[str, ...]:
    """What the columns of a text without a header line are called, in the file's order."""
    return tuple(f"column_{k + 1}" for k in range(width))


def _from_table(
    table: pl.DataFrame, path: Path, format_name: str, layout: TextLayout | None
) -> RawLog:
    unit_rows = len(csv.below_the_names(table)) if layout is not None and layout.names else 0
    words: dict[str, str] = {}
    for row in table.head(unit_rows).iter_rows(named=True):
        words |= {k: f"{words.get(k, '')} {v or ''}".strip() for k, v in row.items()}
    body, numbers, stamps, texts, labels = table.slice(unit_rows), {}, {}, {}, {}
    for column in body.get_columns():
        values = _numbers(column)
        if values is not None:
            numbers[column.name] = values
        elif column.dtype == pl.String:
            seconds = seconds_of(column, path.name)
            if seconds is not None:
                stamps[column.name] = seconds
            elif column.null_count() < len(column):
                words_of = column.head(_FIRST_ROWS).drop_nulls().unique().head(_MOST_WORDS)
                texts[column.name] = tuple(sorted(words_of.str.strip_chars()))
                if len(words_of) < _MOST_WORDS:
                    ranks = column.str.strip_chars().rank("dense").cast(pl.Float64)
                    labels[column.name] = ranks.fill_null(0.0).to_numpy()
    if len(numbers) < len("xyz") and layout is not None:
        refuse_labels(texts, body.columns, layout, path, stamps)
    if not numbers:
        raise ValueError(f"{path.name}: no column of numbers in it; a log of an IMU is needed.")
    return RawLog(path, format_name, layout, numbers, stamps, words, unit_rows, texts, labels)


def _numbers(column: pl.Series) -> Float[np.ndarray, " rows"] | None:
    """A column as doubles, `None` where it holds something else."""
    if column.dtype == pl.String:
        text = column.str.strip_chars()
        values = text.cast(pl.Float64, strict=False)
        filled = text.is_not_null() & (text != "")
        if (filled & values.is_null()).sum() > (1 - _NUMERIC) * len(column):
            return None
    elif column.dtype.is_numeric():
        values = column.cast(pl.Float64)
    elif isinstance(column.dtype, pl.Datetime | pl.Duration):
        tick = {"ms": 1e-3, "us": 1e-6, "ns": 1e-9}[column.dtype.time_unit]
        return column.to_physical().cast(pl.Float64).to_numpy() * tick
    else:
        return None
    if values.is_null().all():
        return None
    return values.fill_null(float("nan")).to_numpy()
