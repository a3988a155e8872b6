"""Rows of single devices to dwells exactly as `inertiax calibrate` reduces them.

Rests without what disturbs them, plateaus of constant rate, dwells cut where the temperature moves, and the covariance
of each mean from all of its samples. It takes some ten milliseconds a device, where the sums over blocks take one.
"""

import equinox as eqx
import numpy as np
import polars as pl
from jaxtyping import Bool, Float, Int

from ...data.formats import ColumnMap
from ...data.formats.columns import (
    ProbeColumns,
    temperature_factors,
    time_scale,
    TimeColumn,
    triad_factors,
    TriadColumns,
)
from ...data.recording import Recording
from ...physics.earth import EARTH_RATE
from ...reduction.dwell_means import reduce_to_dwells
from ...reduction.plateaus import FEWEST, TURNING
from ...reduction.segments import segment
from .columns import (
    experiment_name,
    position_name,
    temperature_name,
    time_name,
    triad_names,
)
from .many_dwells import Reduced


def recording_of(table: pl.DataFrame, columns: ColumnMap, name: str) -> Recording:
    """One device's rows as a recording, SI. Raises `ValueError` as `Recording` does."""
    said = columns.time if isinstance(columns.time, TimeColumn) else TimeColumn()
    experiment = experiment_name(columns)
    return Recording(
        time=_floats(table, time_name(columns)) * time_scale(said, "[columns]"),
        temperature=_temperature(table, columns),
        position=labels(table, position_name(columns)).astype(np.int64),
        experiment=labels(table, experiment).astype(np.int64)
        if experiment in table.columns
        else None,
        accel=_triad(table, columns, "accel"),
        gyro=_triad(table, columns, "gyro"),
        reference_accel=_triad(table, columns, "reference_accel"),
        reference_gyro=_triad(table, columns, "reference_gyro"),
        name=name,
    )


def reduce_alone(table: pl.DataFrame, columns: ColumnMap, name: str) -> Reduced:
    """The dwells of one device, or in words why there are none."""
    try:
        dwells = reduce_to_dwells([recording_of(table, columns, name)])
    except ValueError as error:
        return Reduced(name, None, " ".join(str(error).split()).rstrip("."))
    # Which rows a dwell has is of no use further on, and the other devices do not know it.
    return Reduced(name, eqx.tree_at(lambda d: d.rows, dwells, None))


def with_plateaus(
    table: pl.DataFrame, ends: Int[np.ndarray, " device"], columns: ColumnMap
) -> Bool[np.ndarray, " device"]:
    """Which devices turn at a constant rate by their reference, in rows of position -1.

    **Arguments:** `ends` holds one past each device's last row.
    """
    found = np.zeros(len(ends), bool)
    names = triad_names(columns.reference_gyro, "reference_gyro")
    if names[0] not in table.columns:
        return found
    moving = labels(table, position_name(columns)) < 0
    if not moving.any():
        return found
    rate = _triad(table, columns, "reference_gyro")
    assert rate is not None
    with np.errstate(invalid="ignore", over="ignore"):
        turning = moving & (np.linalg.norm(rate, axis=1) > TURNING * EARTH_RATE)
    starts = np.append(0, ends[:-1])
    many = np.add.reduceat(turning.astype(int), starts) >= FEWEST
    for k in np.flatnonzero(many):
        mine = table.slice(int(starts[k]), int(ends[k] - starts[k]))
        try:
            segments = segment(recording_of(mine, columns, ""), handling=False)
        except ValueError:
            continue  # said of the device with its reason
        found[k] = bool((~segments.resting).any())
    return found


def labels(table: pl.DataFrame, column: str) -> Int[np.ndarray, " row"]:
    """A column of whole numbers, -1 where it is empty. Raises `ValueError` where it holds no numbers."""
    series = table.get_column(column)
    if not series.dtype.is_numeric():
        raise ValueError(
            f"column '{column}' is of type {series.dtype}; it must hold whole numbers."
        )
    if series.dtype.is_integer() and not series.null_count():
        return series.to_numpy()
    return series.cast(pl.Int64, strict=False).fill_null(-1).to_numpy()


def _floats(table: pl.DataFrame, column: str) -> Float[np.ndarray, " row"]:
    series = table.get_column(column).cast(pl.Float64, strict=False)
    return series.fill_null(float("nan")).to_numpy()


def _triad(
    table: pl.DataFrame, columns: ColumnMap, triad: str
) -> Float[np.ndarray, "row 3"] | None:
    said: TriadColumns | None = getattr(columns, triad)
    names = triad_names(said, triad)
    if names[0] not in table.columns:
        return None
    kind = "accel" if triad.endswith("accel") else "gyro"
    offset, factor = triad_factors(said or TriadColumns(), kind, f"[columns] {triad}")
    return (np.stack([_floats(table, n) for n in names], axis=1) - offset) * factor


def _temperature(table: pl.DataFrame, columns: ColumnMap) -> Float[np.ndarray, "row 1"] | None:
    probe = temperature_name(columns)
    if probe not in table.columns:
        return None
    said = columns.temperature
    column = said if isinstance(said, ProbeColumns) else ProbeColumns()
    factor, shift = temperature_factors(column, "[columns] temperature")
    return factor * (_floats(table, probe) + shift)[:, None]
