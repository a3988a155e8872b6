"""Rows of another sensor in the same table: none of the triads' channels has a value in them."""

import numpy as np
import polars as pl

from .columns import AXES, ColumnMap, Layout


_NO_VALUE = ["", "nan", "null", "none"]


def without_empty_rows(
    table: pl.DataFrame, columns: ColumnMap, layout: Layout
) -> tuple[pl.DataFrame, int]:
    """The rows in which any channel of the triads has a value, and how many have none: rows of another sensor.

    Where no row has one, all stay, to be refused.
    """
    names = []
    for triad, said in (("accel", columns.accel), ("gyro", columns.gyro)):
        if layout.triad in (None, triad):
            own = (said.names if said is not None else None) or [f"{triad}_{x}" for x in AXES]
            names += [n for n in own if n in table.columns]
    if not names:
        return table, 0
    empty = np.ones(table.height, bool)
    for name in names:
        values = table.get_column(name)
        none = values.is_null()
        if values.dtype.is_float():
            none |= values.is_nan().fill_null(value=True)
        elif values.dtype == pl.String:
            none |= (
                values.str.strip_chars().str.to_lowercase().is_in(_NO_VALUE).fill_null(value=True)
            )
        empty &= none.to_numpy()
        if not empty.any():
            return table, 0
    return (table, 0) if empty.all() else (table.filter(pl.Series(~empty)), int(empty.sum()))
