"""What kind of values a text's columns hold: whole numbers, numbers or text, told for all rows or piece by piece."""

from collections.abc import Mapping

import polars as pl


# From narrow to wide: what holds the values of two pieces is the wider kind. Nothing was seen yet in the first.
KINDS = (None, pl.Int64, pl.Float64, pl.String)

Kinds = Mapping[str, int]  # index into `KINDS` of each column


def kinds_of(table: pl.DataFrame, known: Kinds | None = None) -> Kinds:
    """The narrowest kinds that hold every field of a table of text, and of pieces that gave those `known`."""
    found = {}
    for column in table.get_columns():
        least = 0 if known is None else known[column.name]
        found[column.name] = least if column.is_null().all() else _kind(column, max(least, 1))
    return found


def _kind(column: pl.Series, least: int) -> int:
    for kind in range(least, len(KINDS) - 1):
        if _cast(column, kind).null_count() == column.null_count():
            return kind
    return len(KINDS) - 1


def typed(table: pl.DataFrame, kinds: Kinds) -> pl.DataFrame:
    """Columns of text as what they hold."""
    return pl.DataFrame([_cast(c, kinds[c.name]) for c in table.get_columns()])


def _cast(column: pl.Series, kind: int) -> pl.Series:
    to = KINDS[kind]
    if to is None or to is pl.String:
        return column
    return column.str.strip_chars().cast(to, strict=False)
