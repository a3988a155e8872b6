"""From a table of named columns to `Recording`s: units, checks, one recording per device."""

import re
from collections.abc import Callable, Sequence
from typing import Literal

import numpy as np
import polars as pl
from jaxtyping import Bool, Float, Int

from ..recording import Recording
from .columns import (
    AXES,
    ColumnMap,
    current_scale,
    CurrentColumn,
    Layout,
    PositionColumn,
    pressure_scale,
    PressureColumn,
    ProbeColumns,
    shown,
    supply_scale,
    SupplyColumn,
    temperature_factors,
    time_scale,
    TimeColumn,
    triad_factors,
    TriadColumns,
)
from .kept_rows import kept_rows
from .late_references import at_their_moments
from .mended_stamps import can_be_mended, mended
from .numeric_columns import numbers, require
from .table_references import references_of_table
from .temperature_at_stamps import between_rows
from .time_stamps import seconds_of


def to_recordings(
    table: pl.DataFrame, columns: ColumnMap, layout: Layout, *, name: str, piece: bool = False
) -> tuple[Recording, ...]:
    """One `Recording` per device in the table, in SI, in order of first appearance.

    `layout.triad` restricts to one triad, for files that hold the triads separately; of a `piece` of a table what
    the whole alone can tell is refused.
    Raises `ValueError` in one line that names the file, the column, the row (counted from 0 after
    the header) and what was found.
    """
    if table.height <= layout.start_row:
        raise ValueError(
            f"{name}: no rows of data after start_row = {layout.start_row} (the file has "
            f"{table.height}); at least one sample is needed."
        )
    table, _, empty, repeated = kept_rows(table.slice(layout.start_row), columns, layout)
    position = _position(table, columns, name)
    moving = None if position is None else position < 0
    values = {
        "time": stamps_of(table, columns, name),
        "accel": None if layout.triad == "gyro" else _triad(table, columns.accel, "accel", name),
        "gyro": None if layout.triad == "accel" else _triad(table, columns.gyro, "gyro", name),
        "temperature": temperatures_of(table, columns.temperature, name, gaps=True),
        "experiment": _labels(table, columns.label("experiment"), "experiment", name),
        "position": position,
        "reference_accel": _triad(
            table, columns.reference_accel, "reference_accel", name, moving=moving
        ),
        "reference_gyro": _triad(
            table, columns.reference_gyro, "reference_gyro", name, moving=moving
        ),
        "supply": _quantity(table, columns.supply, "supply", supply_scale, name, gaps=False),
        "mag": _mag(table, columns.mag, name),
        "current": _quantity(table, columns.current, "current", current_scale, name),
        "pressure": _quantity(table, columns.pressure, "pressure", pressure_scale, name),
    }
    made = references_of_table(
        table, columns, layout, name, moving, values["time"], values["accel"]
    )
    values |= made
    if all(values[triad] is None for triad in ("accel", "gyro", "mag")):
        raise ValueError(
            f"{name}: neither accel_x/y/z nor gyro_x/y/z among the columns {shown(table.columns)}; name "
            "them under [columns] accel or gyro."
        )
    parts = []
    for device, rows in _devices(table, columns.label("device"), name):
        mine = {k: v[rows] for k, v in values.items() if v is not None}
        label = f"{name} (device {device})" if device else name
        mine["time"] = _clock(mine["time"], columns.time, name if not device else label)
        if not made:
            mine = at_their_moments(mine, layout.turntable)
        step = 0.0
        if "temperature" in mine:
            mine["temperature"], step = between_rows(mine["time"], mine["temperature"], label)
        if piece and step:
            raise ValueError(f"{name}: the rows with a temperature may be those of another piece.")
        mine |= {"device": device, "name": label, "temperature_step": step}
        parts.append(Recording(**mine, empty_rows=empty, repeated_rows=repeated))
    return tuple(parts)


def _clock(
    time: Float[np.ndarray, " rows"], column: TimeColumn | str | None, where: str
) -> Float[np.ndarray, " rows"]:
    """Stamps of one device, checked; or its own row count where the campaign gives only a rate."""
    if isinstance(column, TimeColumn) and column.rate is not None:
        return np.arange(len(time)) / column.rate
    if isinstance(column, TimeColumn) and column.mend:
        time = mended(time, where)
    steps = np.diff(time)
    if np.any(steps <= 0):
        row = int(np.argmax(steps <= 0)) + 1
        again, back = int((steps == 0).sum()), int((steps < 0).sum())
        what = "repeats" if steps[row - 1] == 0 else "goes back from"
        repair = "Add mend = true to [columns] time" if can_be_mended(time) else "Repair them"
        raise ValueError(
            f"{where}: time must increase strictly, but row {row} ({time[row]:.6f} s) {what} the "
            f"stamp of row {row - 1} ({time[row - 1]:.6f} s); {again} repeated and {back} backward "
            f"stamps in all. {repair}, or count rows with [columns] time = {{ rate = ... }} in Hz."
        )
    return time


def stamps_of(table: pl.DataFrame, columns: ColumnMap, where: str) -> Float[np.ndarray, " rows"]:
    """Stamps in s as they stand, in whatever order, or row numbers over the rate that the campaign gives."""
    said = columns.time
    if isinstance(said, str):
        said = TimeColumn(name=said)
    column = said or TimeColumn()
    scale = time_scale(column, "[columns]")
    if column.rate is not None:
        return np.arange(table.height) / column.rate
    if column.name is None and "time" not in table.columns:
        if columns.each_row_is_a_pose:
            return np.arange(table.height, dtype=float)  # in their order; no clock is meant
        raise ValueError(
            f"{where}: column 'time' is missing; the file has {shown(table.columns)}. Name it with "
            '[columns] time = { name = "...", unit = "..." }, or count rows with '
            "[columns] time = { rate = ... } in Hz."
        )
    name = column.name or "time"
    series = require(table, name, where)
    if isinstance(series.dtype, pl.Datetime | pl.Duration):
        return series.to_physical().cast(pl.Float64).to_numpy() * _TICK[series.dtype.time_unit]
    if series.dtype == pl.String:
        stamps = seconds_of(series, where)
        if stamps is not None:
            return stamps
    return numbers(table, name, where) * scale


_TICK = {"ms": 1e-3, "us": 1e-6, "ns": 1e-9}

TriadName = Literal["accel", "gyro", "reference_accel", "reference_gyro", "mag"]


def _triad(
    table: pl.DataFrame,
    said: TriadColumns | None,
    key: TriadName,
    where: str,
    moving: Bool[np.ndarray, " rows"] | None = None,
) -> Float[np.ndarray, "rows 3"] | None:
    """A triad in SI. A reference may be empty in rows that are `moving`, and is zero there: it is not told."""
    column = said or TriadColumns()
    names = column.names or tuple(f"{key}_{axis}" for axis in AXES)
    if said is None and not any(n in table.columns for n in names):
        return None
    if len(set(names)) < 3:
        raise ValueError(
            f"[columns] {key}: names must be three different columns; found {list(names)}."
        )
    kind = "mag" if key == "mag" else "accel" if key.endswith("accel") else "gyro"
    offset, factor = triad_factors(column, kind, f"[columns] {key}")
    values = np.empty((table.height, 3), order="F")  # as a `Recording` has it
    unlabelled = key.startswith("reference") and moving is None
    for axis, name in enumerate(names):
        try:
            read = numbers(table, name, where, gaps=key == "mag", empty=moving)
        except ValueError as error:
            if not unlabelled or "no finite number" not in str(error):
                raise
            told = "a reference may be empty while the table moves: [columns] position names its column"
            raise ValueError(f"{error} ({told}).") from None
        values[:, axis] = (read - offset[axis]) * factor[axis]
    if moving is not None:
        values[np.isnan(values).any(axis=1)] = 0.0
    return values


def _mag(
    table: pl.DataFrame, said: TriadColumns | None, where: str
) -> Float[np.ndarray, "rows 3"] | None:
    """The magnetometers, T; rows in which one of them is missing are NaN.

    Columns of that name that nobody asked for and that are no three of numbers are not they.
    """
    try:
        values = _triad(table, said, "mag", where)
    except ValueError:
        if said is not None:
            raise
        return None
    if values is None or np.isnan(values).all():
        return None
    return np.where(np.isnan(values).any(axis=1, keepdims=True), np.nan, values)


def temperatures_of(
    table: pl.DataFrame, said: ProbeColumns | str | None, where: str, *, gaps: bool = False
) -> Float[np.ndarray, "rows probes"] | None:
    """The probes' temperatures in °C; `None` where there is no column of them. With `gaps` a row without is NaN."""
    names = temperature_names(said, table.columns)
    if not names:
        return None
    column = said if isinstance(said, ProbeColumns) else ProbeColumns()
    scale, shift = temperature_factors(column, "[columns] temperature")
    return np.stack([scale * (numbers(table, n, where, gaps=gaps) + shift) for n in names], axis=1)


def temperature_names(said: ProbeColumns | str | None, there: Sequence[str]) -> tuple[str, ...]:
    """The probes' columns that are said, else the canonical ones among those that are `there`."""
    column = ProbeColumns(name=said) if isinstance(said, str) else said or ProbeColumns()
    if column.name is not None and column.names is not None:
        raise ValueError("[columns] temperature: give name or names, not both.")
    if column.names is not None:
        return column.names
    if column.name is not None:
        return (column.name,)
    if said is None and "temperature" not in there:
        return ()
    further = [(int(n[12:]), n) for n in there if _PROBE.fullmatch(n)]
    return ("temperature", *(n for _, n in sorted(further)))


_PROBE = re.compile(r"temperature_\d{1,6}")


def _quantity(
    table: pl.DataFrame,
    said: SupplyColumn | CurrentColumn | PressureColumn | str | None,
    key: str,
    scale: Callable[[str, str], float],
    where: str,
    *,
    gaps: bool = True,
) -> Float[np.ndarray, " rows"] | None:
    """The supply voltage (V), the current (A) or the barometer (Pa); NaN where it was not read and `gaps` are allowed.

    A column of that name that nobody asked for and that holds no numbers is not it.
    """
    column = _QUANTITIES[key](name=said) if isinstance(said, str) else said or _QUANTITIES[key]()
    name = column.name or key
    if said is None and not (name in table.columns and table.schema[name].is_numeric()):
        return None
    return numbers(table, name, where, gaps=gaps) * scale(column.unit, f"[columns] {key}")


_QUANTITIES = {"supply": SupplyColumn, "current": CurrentColumn, "pressure": PressureColumn}


def _position(
    table: pl.DataFrame, columns: ColumnMap, where: str
) -> Int[np.ndarray, " rows"] | None:
    """Position labels; row numbers where each row is the mean of one pose."""
    if columns.each_row_is_a_pose:
        return np.arange(table.height)
    labels = _labels(table, columns.label("position"), "position", where)
    said = columns.position
    if labels is None or not isinstance(said, PositionColumn) or not said.moving_labels:
        return labels
    return np.where(np.isin(labels, said.moving_labels), -1, labels)


def _labels(
    table: pl.DataFrame, said: str | None, key: str, where: str
) -> Int[np.ndarray, " rows"] | None:
    if said is None and key not in table.columns:
        return None
    values = numbers(table, said or key, where)
    whole = values == np.round(values)
    if not whole.all():
        row = int(np.argmin(whole))
        raise ValueError(
            f"{where}: column '{said or key}' must hold whole numbers ({key}); row {row} is "
            f"{values[row]:g}."
        )
    if np.abs(values).max() > 2.0**53:
        row = int(np.argmax(np.abs(values)))
        raise ValueError(
            f"{where}: column '{said or key}' is {values[row]:g} in row {row}; whole numbers up to 2^53 "
            "are told apart."
        )
    return values.astype(np.int64)


def _devices(
    table: pl.DataFrame, said: str | None, where: str
) -> list[tuple[str, slice | Int[np.ndarray, " chosen"]]]:
    if said is None and "device" not in table.columns:
        return [("", slice(None))]
    serial = require(table, said or "device", where).cast(pl.String).str.strip_chars()
    empty = serial.is_null() | (serial == "")
    if empty.any():
        row = int(empty.arg_true()[0])
        raise ValueError(
            f"{where}: column '{said or 'device'}' is empty in row {row}; every row needs the serial "
            "number of its device."
        )
    names = serial.unique(maintain_order=True).to_list()
    if len(names) == 1:
        return [(names[0], slice(None))]
    return [(n, (serial == n).arg_true().to_numpy().astype(np.int64)) for n in names]
