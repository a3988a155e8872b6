"""Named numeric arrays, as HDF5 and MATLAB files hold them, to a table of columns.

An array of n values is a column. One of n × 3 named `accel` is `accel_x`, `accel_y`, `accel_z`; one of n × k
otherwise is `name_0`, `name_1`, …, and so is one of k × n with more than 64 samples and no more channels; names of
groups and structs come before, joined by `/`, except for the group that the campaign names.
"""

import numpy as np
import polars as pl

from .columns import AXES, ColumnMap, nearest, ProbeColumns, shown, TimeColumn, TriadColumns
from .numeric_columns import require


_CHANNELS = 64  # the most that one array holds


def to_table(arrays: dict[str, np.ndarray], columns: ColumnMap, where: str) -> pl.DataFrame:
    """Columns as long as the time column (without one, as the longest); shorter and longer ones are
    other data of the file.

    Raises `ValueError` where a column that the campaign names has another length than time.
    """
    found, lying = _all_columns(arrays, where)
    rows = _rows(found, columns, where)
    kept = {k: v for k, v in (found | lying).items() if len(v) == rows}
    for name in _wanted(columns):
        if name in found and name not in kept:
            raise ValueError(
                f"{where}: '{name}' has {len(found[name])} values but time has {rows}; all columns of "
                "a recording must have the same length."
            )
    return pl.DataFrame(kept)


def columns_by_length(arrays: dict[str, np.ndarray], where: str) -> list[pl.DataFrame]:
    """All columns of each length, those of the length that most values have first: what a file holds whose names
    nobody has told yet.

    Raises `ValueError` where there is none.
    """
    found, lying = _all_columns(arrays, where)
    sizes = [len(v) for v in found.values()]
    lengths = sorted(set(sizes), key=lambda n: (n * sizes.count(n), n), reverse=True)
    every = (found | lying).items()
    return [pl.DataFrame({k: v for k, v in every if len(v) == rows}) for rows in lengths]


def _all_columns(
    arrays: dict[str, np.ndarray], where: str
) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """All columns, and those that stand in the rows of arrays, which are columns only where nothing else is or where
    they are as long."""
    found: dict[str, np.ndarray] = {}
    lying: dict[str, np.ndarray] = {}
    if len(arrays) == 1:
        arrays = {name: _filled(values) for name, values in arrays.items()}
    for name, values in arrays.items():
        found |= _split(name, values)
        if values.ndim == 2 and 3 < values.shape[0] <= _CHANNELS < values.shape[1]:
            lying |= _split(name, values.T)
    if lying and max((len(v) for v in found.values()), default=0) <= _CHANNELS:
        found |= lying
    if not found:
        raise ValueError(f"{where}: no numeric arrays in it.")
    return found, lying


def _filled(values: np.ndarray) -> np.ndarray:
    """An array of samples, stamps first, without rows of zeros at its end, which was made in advance and not filled."""
    if values.ndim != 2 or values.dtype.kind not in "fiu":
        return values
    lies = values.shape[0] <= _CHANNELS < values.shape[1]
    rows = values.T if lies else values
    filled = np.flatnonzero(rows.any(axis=1))
    last = int(filled[-1]) + 1 if len(filled) else 0
    if last < 2 or last > len(rows) - 2 or np.any(np.diff(rows[:last, 0]) < 0):
        return values
    return rows[:last].T if lies else rows[:last]


def choose_group(groups: list[str], asked: str, where: str) -> None:
    """Raises `ValueError` where the group that the campaign asks for is not in the file."""
    if asked not in groups:
        raise ValueError(
            f"{where}: group '{asked}' is missing; {nearest(asked, groups)}the file has {shown(groups)}."
        )


def _split(name: str, values: np.ndarray) -> dict[str, np.ndarray]:
    if values.dtype.names is not None:  # a table: rows of named fields
        fields = {k: values[k] for k in values.dtype.names}
        plain = {k: v for k, v in fields.items() if v.dtype.kind in "fiubS" and v.ndim <= 2}
        return {k: v for n, x in plain.items() for k, v in _split(n, x).items()}
    if values.dtype.kind == "S":
        return {name: np.char.decode(values, "utf-8", "replace")} if values.ndim == 1 else {}
    if values.ndim == 2 and 1 in values.shape:
        values = values.reshape(-1)
    if values.ndim == 1:
        return {name: np.ascontiguousarray(values)}
    if values.ndim != 2:
        return {}
    if values.shape[1] != 3 and values.shape[0] == 3:
        values = values.T
    labels = AXES if values.shape[1] == 3 else [str(k) for k in range(values.shape[1])]
    if values.shape[1] > _CHANNELS:  # an image or a matrix, no set of channels
        return {}
    return {f"{name}_{k}": np.ascontiguousarray(values[:, i]) for i, k in enumerate(labels)}


def _rows(found: dict[str, np.ndarray], columns: ColumnMap, where: str) -> int:
    said = columns.time
    column = said if isinstance(said, TimeColumn) else TimeColumn(name=said)
    if column.rate is not None:
        triads = [n for n in _wanted(columns) if n in found]
        return len(found[triads[0]]) if triads else max(map(len, found.values()))
    name = column.name or "time"
    if name not in found:
        if column.name is not None or not any(n in found for n in _wanted(columns)):
            require(pl.DataFrame({k: v[:0] for k, v in found.items()}), name, where)
        return max(map(len, found.values()))  # `to_recordings` says that time is missing
    return len(found[name])


def _wanted(columns: ColumnMap) -> list[str]:
    """Names of the triads', the supply's and the temperature's columns, as the campaign or the canon gives them."""
    names: list[str] = []
    for key in ("accel", "gyro", "reference_accel", "reference_gyro"):
        triad = getattr(columns, key) or TriadColumns()
        names += triad.names or [f"{key}_{a}" for a in AXES]
    names += columns.mag.names or () if columns.mag is not None else ()
    if columns.supply is not None:  # unasked, an array of that name may be other data of the file
        supply = columns.supply
        names.append(supply if isinstance(supply, str) else supply.name or "supply")
    said = columns.temperature
    if isinstance(said, ProbeColumns):
        return [*names, *(said.names or (said.name or "temperature",))]
    return [*names, said or "temperature"]
