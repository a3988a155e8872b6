"""A column of a table as numbers."""

import numpy as np
import polars as pl
from jaxtyping import Bool, Float

from ...storage.harmless_text import short
from .columns import nearest, numbered_name, shown


def require(table: pl.DataFrame, column: str, where: str) -> pl.Series:
    """The column, or a `ValueError` that lists the columns there are."""
    if column not in table.columns:
        first, second = (numbered_name(column, k) for k in (1, 2))
        if second in table.columns:
            raise ValueError(
                f"{where}: column '{column}' stands more than once in the header; name the one that is meant, "
                f"'{first}' or '{second}', in the order of the file."
            )
        raise ValueError(
            f"{where}: column '{column}' is missing; {nearest(column, table.columns)}the file has "
            f"{shown(table.columns)}."
        )
    return table.get_column(column)


def numbers(
    table: pl.DataFrame,
    column: str,
    where: str,
    *,
    gaps: bool = False,
    empty: Bool[np.ndarray, " rows"] | None = None,
) -> Float[np.ndarray, " rows"]:
    """A column as finite float64. Raises `ValueError` for text, gaps, NaN and infinities.

    With `gaps` rows without a number are NaN: a sensor that is read less often than the others. `empty` marks the only
    rows that may be without.
    """
    series = require(table, column, where)
    if series.dtype == pl.String:
        series = _of_text(series, column, where)
    elif not (series.dtype.is_numeric() or series.dtype == pl.Boolean):
        raise ValueError(
            f"{where}: column '{column}' is of type {series.dtype}; it must hold numbers."
        )
    series = series.cast(pl.Float64)
    values = (series.fill_null(float("nan")) if series.null_count() else series).to_numpy()
    finite = np.isfinite(values) | (np.isnan(values) & (gaps if empty is None else empty))
    if not finite.all():
        only = " outside position −1" if empty is not None and empty.any() else ""
        raise ValueError(
            f"{where}: column '{column}' has no finite number in {int((~finite).sum())} of "
            f"{len(values)} rows{only}, first in row {int(np.argmin(finite))}; drop or repair them."
        )
    return values


def _of_text(given: pl.Series, column: str, where: str) -> pl.Series:
    """Numbers of a column of text; null where there is none. Raises `ValueError` for what is no number."""
    plain = given.cast(pl.Float64, strict=False)
    if plain.null_count() == given.null_count():  # no blanks around any number, as nearly always
        return plain
    text = given.str.strip_chars()
    found = text.cast(pl.Float64, strict=False)
    bad = found.is_null() & text.is_not_null() & (text != "")
    if bad.any():
        row = int(bad.arg_true()[0])
        raise ValueError(
            f"{where}: column '{column}' holds text in row {row}: '{short(text[row])}'; every row "
            "must be a number."
        )
    return found
