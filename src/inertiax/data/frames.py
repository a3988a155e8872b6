"""Tables of other libraries as columns of a recording."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import polars as pl


TRIADS = ("accel", "gyro", "reference_accel", "reference_gyro", "mag")
SINGLE = ("time", "experiment", "position", "supply", "current", "pressure")
Names = Mapping[str, str | Sequence[str]]


def table_of(frame: Any) -> pl.DataFrame:
    """A table of polars, pandas, pyarrow or xarray, a mapping of columns, or whatever speaks Arrow.

    Raises `ValueError` for something else.
    """
    if isinstance(frame, pl.DataFrame):
        return frame
    if isinstance(frame, pl.LazyFrame):
        return frame.collect()
    if hasattr(frame, "to_dataframe"):  # xarray's Dataset
        frame = frame.to_dataframe().reset_index()
    if isinstance(frame, Mapping) or hasattr(frame, "__arrow_c_stream__"):
        return pl.DataFrame(frame)
    if hasattr(frame, "__dataframe__"):
        return pl.from_dataframe(frame)
    raise ValueError(
        f"`Recording.from_frame(frame)`: got {type(frame).__name__}; it takes a table of polars, pandas, pyarrow or "
        f"xarray, or a mapping of columns."
    )


def columns_of(frame: Any, names: Names) -> dict[str, Any]:
    """Columns of a recording from a table whose columns are canonical (`accel_x` …) or named by `names`.

    Raises `ValueError` that names a column that is missing.
    """
    table = table_of(frame)
    unknown = sorted(set(names) - {*TRIADS, *SINGLE, "temperature"})
    if unknown:
        raise ValueError(
            f"`Recording.from_frame(columns=...)`: {unknown[0]!r} is no column of a recording."
        )
    made: dict[str, Any] = {}
    for triad in TRIADS:
        own = names.get(triad, [f"{triad}_{axis}" for axis in "xyz"])
        if triad in names or all(n in table.columns for n in own):
            made[triad] = np.stack([_numbers(table, n, triad) for n in _three(triad, own)], axis=1)
    for column in SINGLE:
        own = names.get(column, column)
        if column in names or own in table.columns:
            made[column] = _numbers(table, str(own), column)
    probes = names.get("temperature", [c for c in table.columns if _is_probe(c)])
    probes = [probes] if isinstance(probes, str) else list(probes)
    if probes:
        made["temperature"] = np.stack([_numbers(table, p, "temperature") for p in probes], axis=1)
    return made


def _three(triad: str, names: str | Sequence[str]) -> Sequence[str]:
    if isinstance(names, str) or len(names) != 3:
        raise ValueError(
            f"`Recording.from_frame(columns=...)`: '{triad}' needs the names of three columns."
        )
    return names


def _is_probe(name: str) -> bool:
    return name == "temperature" or (name.startswith("temperature_") and name[12:].isdigit())


def _numbers(table: pl.DataFrame, name: str, label: str) -> np.ndarray:
    if name not in table.columns:
        raise ValueError(
            f"`Recording.from_frame(frame)`: no column '{name}' for '{label}'; "
            f"there are {', '.join(table.columns[:12])}."
        )
    column = table.get_column(name)
    if column.dtype.is_temporal():
        return column.cast(pl.Datetime("ns")).cast(pl.Int64).to_numpy() * 1e-9
    if not column.dtype.is_numeric():
        raise ValueError(f"`Recording.from_frame(frame)`: column '{name}' is not of numbers.")
    return column.cast(pl.Float64).to_numpy()
