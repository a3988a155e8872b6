"""Lines of a log as they come, to samples in SI: the same columns and units as the batch reader's.

A line counts once its line feed is there. Lines that are no row, and rows whose stamp does not come after the one
before, are given back to whoever keeps them.
"""

import dataclasses

import msgspec
import numpy as np
import polars as pl
from jaxtyping import Bool, Float

from ..data.formats.columns import ColumnMap, Layout, TimeColumn
from ..data.formats.csv import column_names, parse_rows
from ..data.formats.kept_rows import kept_rows
from ..data.formats.table import stamps_of, temperature_names, to_recordings
from ..data.formats.text_layout import find_layout, TextLayout, UTF8_MARK
from ..data.recording import Recording


ENOUGH_LINES = 40  # lines of data that tell the layout
_COMMENTS = (b"#", b"%", b"//")


@dataclasses.dataclass(frozen=True, eq=False)
class Chunk:
    """Some rows: their text, their samples, and the lines between them that are none."""

    lines: list[bytes]  # one a row, without line feeds
    rows: Recording  # its `time` counts rows; the stamps are in `time`
    time: Float[np.ndarray, " time"]  # s, as stamped
    garbled: list[bytes]
    # Rows that the campaign leaves out at the start, and those without a value of a triad.
    skipped: list[bytes]


class TextRows:
    """Reads lines; the first ones decide how they are laid out."""

    def __init__(self, columns: ColumnMap, layout: Layout, name: str):
        if columns.each_row_is_a_pose:
            raise ValueError(
                "[columns] position: row_index = true makes every row a pose; `live` follows samples, so use "
                "`inertiax calibrate`."
            )
        self._columns, self._said, self._name = columns, layout, name
        self._waiting: list[bytes] = []
        self._layout: TextLayout | None = None
        self._names: tuple[str, ...] = ()
        self._count = 0
        self._last: dict[str, str | None] = {}  # of each probe
        self._left_out = layout.start_row  # rows still to be left out at the start
        self._names_line: bytes | None = None  # as it stands in the file
        self._header: list[bytes] | None = None  # lines above the data that nobody took yet

    def afresh(self) -> "TextRows":
        """A reader for another log of the same kind, which begins with its own first lines."""
        return TextRows(self._columns, self._said, self._name)

    def take_header(self) -> list[bytes] | None:
        """The lines above the data, once they are known, and once only."""
        header, self._header = self._header, None
        return header

    def read(self, lines: list[bytes], *, last: bool = False) -> Chunk | None:
        """Rows of further lines; `None` while there are too few to tell the layout, or none.

        **Arguments:** with `last` no more will come, and what there is must do.
        Raises `ValueError` where the columns are not what the campaign says.
        """
        if self._layout is None:
            self._waiting += lines
            if len(self._waiting) < ENOUGH_LINES and not last:
                return None
            lines = self._begin()
        lines = [line for line in lines if line.strip()]
        return self._rows(lines) if lines else None

    def _begin(self) -> list[bytes]:
        self._waiting[:1] = [line.removeprefix(UTF8_MARK) for line in self._waiting[:1]]
        data = b"".join(line + b"\n" for line in self._waiting)
        if not data.strip():
            return []
        self._layout = find_layout(data, self._name, self._said.header_line)
        self._names = column_names(self._layout, self._said.said_names, self._name)
        above = data[: self._layout.start].count(b"\n")
        number = self._layout.header_line
        self._names_line = None if number is None else self._waiting[number - 1].strip()
        self._header, below = self._waiting[:above], self._waiting[above:]
        self._waiting = []
        return below

    def _rows(self, lines: list[bytes]) -> Chunk:
        good, garbled = self._split(lines)
        skipped = good[: self._left_out]  # [recordings] start_row
        good, self._left_out = good[self._left_out :], self._left_out - len(skipped)
        try:
            rows, time, kept = self._samples(good) if good else _NOTHING
        except ValueError:
            bad = dict.fromkeys(self._bad(good))
            if self._count == 0 and len(bad) == len(good):
                raise
            garbled += [good[k] for k in bad]
            good = [line for k, line in enumerate(good) if k not in bad]
            rows, time, kept = self._samples(good) if good else _NOTHING
        if kept is not None:
            skipped += [line for line, told in zip(good, kept, strict=True) if not told]
            good = [line for line, told in zip(good, kept, strict=True) if told]
        self._count += len(good)
        return Chunk(good, rows, time, garbled, skipped)

    def _bad(self, lines: list[bytes], first: int = 0) -> list[int]:
        """Which lines hold no row, found by halving."""
        try:
            self._samples(lines)
        except ValueError:
            if len(lines) == 1:
                return [first]
            half = len(lines) // 2
            return self._bad(lines[:half], first) + self._bad(lines[half:], first + half)
        return []

    def _split(self, lines: list[bytes]) -> tuple[list[bytes], list[bytes]]:
        """Lines with as many fields as the data have, and the others."""
        layout = self._layout
        assert layout is not None
        if layout.delimiter == " ":
            count = lambda line: len(line.split())
        else:
            mark = layout.delimiter.encode()
            count = lambda line: line.count(mark) + 1
        good, garbled = [], []
        for line in lines:
            whole = count(line) >= layout.width and not line.lstrip().startswith(_COMMENTS)
            whole = whole and line.strip() != self._names_line  # after a restart
            (good if whole else garbled).append(line)
        return good, garbled

    def _samples(
        self, lines: list[bytes]
    ) -> tuple[Recording, Float[np.ndarray, " time"], Bool[np.ndarray, " line"] | None]:
        """The samples of lines, their stamps, and which lines they are (`None`: all)."""
        layout = self._layout
        assert layout is not None
        data = b"".join(line + b"\n" for line in lines)
        table = self._with_last_temperatures(parse_rows(data, layout, self._names, self._name))
        columns = msgspec.structs.replace(self._columns, time=TimeColumn(rate=1.0))
        # Rows are counted here: equal stamps are told by `follow`.
        table, kept, _, _ = kept_rows(table, columns, _ALL_ROWS)
        said = self._columns.time
        rate = said.rate if isinstance(said, TimeColumn) else None
        time = stamps_of(table, self._columns, self._name)
        if rate is not None:
            time = time + self._count / rate
        found = to_recordings(table, columns, _ALL_ROWS, name=self._name)
        if len(found) > 1:
            raise ValueError(
                f"{self._name}: holds {len(found)} devices; `live` follows one, so give it the rows of one device."
            )
        return next(iter(found)), time, kept

    def _with_last_temperatures(self, table: pl.DataFrame) -> pl.DataFrame:
        """A probe that is not read in every row reads as it last did: what comes next is not known yet."""
        for name in temperature_names(self._columns.temperature, table.columns):
            if name not in table.columns:
                continue
            read = pl.col(name).str.strip_chars()
            read = pl.when(~read.str.to_lowercase().is_in(["", "nan"])).then(pl.col(name))
            held = read.forward_fill().fill_null(pl.lit(self._last.get(name))).backward_fill()
            table = table.with_columns(held)
            self._last[name] = table[name][-1]
        return table


_ALL_ROWS = Layout()
_NOTHING = (Recording(time=np.zeros(1), accel=np.zeros((1, 3))), np.zeros(0), None)
