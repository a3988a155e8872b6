"""Rows of a table that become samples: those with a value of a triad that are not the row before, written again."""

from typing import NamedTuple

import numpy as np
import polars as pl
from jaxtyping import Bool

from .columns import AXES, ColumnMap, Layout, TimeColumn


_INFINITE = [f"{sign}{word}" for sign in ("", "+", "-") for word in ("inf", "infinity")]
_NO_VALUE = ["", "nan", "-nan", "null", "none", *_INFINITE]


class KeptRows(NamedTuple):
    """A table without rows that are no samples, and where these stood."""

    table: pl.DataFrame
    mask: Bool[np.ndarray, " rows"] | None  # of the whole table; `None`: all rows are kept
    empty: int  # rows of another sensor
    repeated: int  # rows that a logger wrote again

    def of(self, other: pl.DataFrame) -> "KeptRows":
        """The same rows of another table of as many."""
        return (
            self._replace(table=other)
            if self.mask is None
            else self._replace(table=other.filter(pl.Series(self.mask)))
        )

    def among(self, whole: pl.DataFrame, made: pl.DataFrame) -> pl.DataFrame:
        """The `whole` table with the columns that were `made` of its kept rows; empty in the others."""
        if self.mask is None:
            return made
        at = pl.Series(np.cumsum(self.mask) - 1).clip(0)
        mask = pl.Series(self.mask)
        new = [
            n for n in made.columns if n not in whole.columns or not made[n].equals(self.table[n])
        ]
        spread = made.select(new)[at.to_numpy()].with_columns(mask.alias(_MASK))
        empty = [pl.when(pl.col(_MASK)).then(pl.col(n)).alias(n) for n in new]
        return whole.with_columns(spread.select(empty).get_columns())


_MASK = "\x00kept"  # no file's column is called so


def kept_rows(table: pl.DataFrame, columns: ColumnMap, layout: Layout) -> KeptRows:
    """The rows in which any channel of the triads has a finite number, without those that hold stamp, device and
    outputs of the row before.

    The others are another sensor's or a filter's that failed, or tell nothing that the row before them does not, beside
    a clock that stands still. Where rows are counted each one is a sample. Where no row has a value, all stay, to be
    refused.
    """
    outputs = _outputs(table, columns, layout)
    filled = _filled(table, outputs)
    kept = table if filled is None else table.filter(pl.Series(filled))
    fresh = _fresh(kept, outputs, columns)
    if fresh is None:
        return KeptRows(kept, filled, table.height - kept.height, 0)
    mask = np.ones(table.height, bool) if filled is None else filled.copy()
    mask[mask] = fresh
    return KeptRows(
        kept.filter(pl.Series(fresh)), mask, table.height - kept.height, int((~fresh).sum())
    )


def notes_on_rows(name: str, empty: int, repeated: int) -> list[str]:
    """What of a recording was no sample, in a sentence each."""
    said = (
        (empty, "without a value in any channel"),
        (repeated, "with the stamp and outputs of the row before"),
    )
    return [
        f"{name}: {count} row{'s' * (count > 1)} {what} {'are' if count > 1 else 'is'} left out."
        for count, what in said
        if count
    ]


def _outputs(table: pl.DataFrame, columns: ColumnMap, layout: Layout) -> list[str]:
    """The columns of the triads that are in the table."""
    names = []
    for triad, said in (("accel", columns.accel), ("gyro", columns.gyro)):
        if layout.triad in (None, triad):
            own = (said.names if said is not None else None) or [f"{triad}_{x}" for x in AXES]
            names += [n for n in own if n in table.columns]
    return names


def _filled(table: pl.DataFrame, outputs: list[str]) -> Bool[np.ndarray, " rows"] | None:
    """Rows with a finite number in any of the columns; `None` where all have one, or none has."""
    if not outputs:
        return None
    empty = np.ones(table.height, bool)
    for name in outputs:
        values = table.get_column(name)
        none = values.is_null()
        if values.dtype.is_float():
            none |= ~values.is_finite().fill_null(value=False)
        elif values.dtype == pl.String:
            none |= (
                values.str.strip_chars().str.to_lowercase().is_in(_NO_VALUE).fill_null(value=True)
            )
        empty &= none.to_numpy()
        if not empty.any():
            return None
    return None if empty.all() else ~empty


def _fresh(
    table: pl.DataFrame, outputs: list[str], columns: ColumnMap
) -> Bool[np.ndarray, " rows"] | None:
    """Rows that are not the one before, written again; `None` where all are."""
    said = TimeColumn(name=columns.time) if isinstance(columns.time, str) else columns.time
    said = said or TimeColumn()
    clock = said.name or "time"
    if said.rate is not None or clock not in table.columns or table.height < 2 or not outputs:
        return None
    device = columns.label("device") or "device"
    again = np.ones(table.height - 1, bool)
    for name in (clock, *outputs, *([device] if device in table.columns else [])):
        values = table.get_column(name)
        again &= (values[1:] == values[:-1]).fill_null(value=False).to_numpy()
        if not again.any():
            return None
    return np.concatenate([[True], ~again])
