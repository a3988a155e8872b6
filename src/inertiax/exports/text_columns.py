"""What a text's columns hold: whole numbers, numbers or text, told for all rows or piece by piece."""

from collections.abc import Collection, Mapping

import numpy as np
import polars as pl


# From narrow to wide: what holds the values of two pieces is the wider kind. Nothing was seen yet in the first.
KINDS = (None, pl.Int64, pl.Float64, pl.String)

_FRACTION = r"^[+-]?(0|[1-9]\d*)\.(\d+)$"
_DIGITS = 15  # that every float gives back
_EXACT = 2**53  # up to which all whole numbers are floats

Kinds = Mapping[str, int]  # index into `KINDS` of each column


class TextKinds:
    """What columns of a text are read as, and what they are kept as beside the compensated ones.

    All that hold numbers are read as numbers but the device's. As CSV each is kept as the text it is. As Parquet
    `channels` are numbers, and of the others those whose numbers give the same text back, or have one number of
    decimals throughout: a serial number 0012 and versions 1.9 and 1.10 do not.
    """

    def __init__(self, device: str, channels: Collection[str], *, as_text: bool):
        self._device, self._channels, self._as_text = device, channels, as_text
        self._read: Kinds = {}
        self._kept: Kinds = {}
        # Columns of which a piece held whole numbers that no float gives back.
        self._large: set[str] = set()
        self._decimals: dict[str, int | None] = {}  # that all numbers of a column have

    def see(self, table: pl.DataFrame) -> None:
        """Look at a table of text, or at one more piece of it."""
        self._read = {**kinds_of(table, self._read or None), self._device: len(KINDS) - 1}
        if not self._as_text:
            others = table.drop(self._device, *self._channels, strict=False)
            found = dict(kinds_of(others, self._kept or None, exactly=True))
            for name, kind in found.items():
                if KINDS[kind] is pl.Int64 and _exceeds_floats(table[name]):
                    self._large.add(name)
                elif KINDS[kind] is pl.Float64 and name in self._large:
                    found[name] = len(KINDS) - 1
                decimals = _decimals(table[name])
                if self._decimals.setdefault(name, decimals) != decimals:
                    self._decimals[name] = None
            self._kept = {**self._read, **found}

    def read(self, table: pl.DataFrame) -> pl.DataFrame:
        """The table as its columns are read."""
        return typed(table, self._read)

    def kept(self, table: pl.DataFrame) -> pl.DataFrame:
        """The table as its columns are kept."""
        if self._as_text:
            return table
        fixed = {n: KINDS.index(pl.Float64) for n, d in self._decimals.items() if d is not None}
        return typed(table, {**self._kept, **fixed})


def kinds_of(table: pl.DataFrame, known: Kinds | None = None, *, exactly: bool = False) -> Kinds:
    """The narrowest kinds that hold every field of a table of text, and of pieces that gave those `known`.

    With `exactly` numbers are only what gives its text back.
    """
    found = {}
    for column in table.get_columns():
        least = 0 if known is None else known[column.name]
        empty = column.is_null().all()
        found[column.name] = least if empty else _kind(column, max(least, 1), exactly=exactly)
    return found


def _kind(column: pl.Series, least: int, *, exactly: bool) -> int:
    for kind in range(least, len(KINDS) - 1):
        numbers = _cast(column, kind)
        if numbers.null_count() == column.null_count():
            if not exactly or _gives_back(numbers, column.str.strip_chars()):
                return kind
    return len(KINDS) - 1


def _gives_back(numbers: pl.Series, text: pl.Series) -> bool:
    """Whether each text is the shortest one of its number, with or without `.0`, as Polars or Python writes it."""
    text = text.str.to_lowercase()
    told = numbers.cast(pl.String).str.to_lowercase()
    other = ~((told == text) | (told == text + ".0")).fill_null(value=True)
    pairs = zip(numbers.filter(other), text.filter(other), strict=True)
    return all(repr(number) == written for number, written in pairs)


def _decimals(column: pl.Series) -> int | None:
    """How many decimals all numbers of a column of text have that are told to no more than 15 digits; else `None`."""
    parts = column.str.strip_chars().str.extract_groups(_FRACTION).struct.unnest()
    if parts.is_empty() or parts["2"].null_count():
        return None
    whole, fraction = (parts[name].str.len_chars().to_numpy() for name in ("1", "2"))
    fixed = np.all(fraction == fraction[0]) and np.all(whole + fraction <= _DIGITS)
    return int(fraction[0]) if fixed else None


def _exceeds_floats(column: pl.Series) -> bool:
    whole = _cast(column, KINDS.index(pl.Int64))
    return bool(((whole > _EXACT) | (whole < -_EXACT)).any())


def typed(table: pl.DataFrame, kinds: Kinds) -> pl.DataFrame:
    """Columns of text as what they hold."""
    return pl.DataFrame([_cast(c, kinds[c.name]) for c in table.get_columns()])


def _cast(column: pl.Series, kind: int) -> pl.Series:
    to = KINDS[kind]
    if to is None or to is pl.String:
        return column
    return column.str.strip_chars().cast(to, strict=False)
