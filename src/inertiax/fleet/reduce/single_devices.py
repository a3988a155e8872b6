"""Rows of single devices to dwells exactly as `inertiax calibrate` reduces them.

Rests without what disturbs them, plateaus of constant rate, dwells cut where the temperature moves, and the covariance
of each mean from all of its samples. It takes some ten milliseconds a device, where the sums over blocks take one.
"""

import dataclasses

import msgspec
import numpy as np
import polars as pl
from jaxtyping import Bool, Int

from ...data.formats import ColumnMap, Layout
from ...data.formats.columns import PositionColumn, ProbeColumns, triad_factors, TriadColumns
from ...data.formats.table import to_recordings
from ...data.recorded import recorded
from ...data.recording import Recording
from ...physics.wgs84 import EARTH_RATE
from ...reduction.dwell_means import reduce_to_dwells
from ...reduction.plateaus import FEWEST, TURNING
from ...reduction.segments import segment
from .columns import (
    experiment_name,
    position_name,
    temperature_name,
    triad_names,
)
from .many_dwells import Reduced


def recording_of(table: pl.DataFrame, columns: ColumnMap, name: str) -> Recording:
    """One device's rows as a recording, SI, as a campaign of it alone would read them; labels left empty are -1.

    Raises `ValueError` as the reader of tables and `Recording` do.
    """
    labels = [c for c in (position_name(columns), experiment_name(columns)) if c in table.columns]
    probe = columns.temperature
    if isinstance(probe, ProbeColumns):  # a fleet reads the device's own probe
        probe = msgspec.structs.replace(probe, name=temperature_name(columns), names=None)
    own = msgspec.structs.replace(columns, device=None, supply=None, temperature=probe)
    (recording,) = to_recordings(
        table.with_columns(pl.col(labels).fill_null(-1)), own, Layout(), name=name
    )
    return recording


def reduce_alone(table: pl.DataFrame, columns: ColumnMap, name: str) -> Reduced:
    """The dwells of one device, or in words why there are none."""
    try:
        recording = recording_of(table, columns, name)
        dwells = reduce_to_dwells([recording])
    except ValueError as error:
        return Reduced(name, None, " ".join(str(error).split()).rstrip("."))
    # Which rows a dwell has and how it wanders is of no use further on, and the other devices do not know it.
    own = dataclasses.replace(dwells, rows=None, wander=None)
    return Reduced(name, own, recorded=recorded([recording]))


def with_plateaus(
    table: pl.DataFrame, ends: Int[np.ndarray, " device"], columns: ColumnMap
) -> Bool[np.ndarray, " device"]:
    """Which devices turn at a constant rate by their reference, whatever position those rows state.

    **Arguments:** `ends` holds one past each device's last row.
    """
    found = np.zeros(len(ends), bool)
    names = triad_names(columns.reference_gyro, "reference_gyro")
    if names[0] not in table.columns:
        return found
    offset, factor = triad_factors(
        columns.reference_gyro or TriadColumns(), "gyro", "[columns] reference_gyro"
    )
    stated = table.select(pl.col(names).cast(pl.Float64, strict=False)).to_numpy()
    rate = (stated - offset) * factor
    with np.errstate(invalid="ignore", over="ignore"):
        turning = np.linalg.norm(rate, axis=1) > TURNING * EARTH_RATE
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


def with_moving_rows(table: pl.DataFrame, columns: ColumnMap) -> pl.DataFrame:
    """The table with −1 for each label that the campaign says is that of a table that moves."""
    said, name = columns.position, position_name(columns)
    if not isinstance(said, PositionColumn) or not said.moving_labels:
        return table
    moving = pl.col(name).is_in(said.moving_labels)
    return table.with_columns(pl.when(moving).then(-1).otherwise(pl.col(name)).alias(name))


def labels(table: pl.DataFrame, column: str) -> pl.Series:
    """A column of whole numbers, -1 where it is empty. Raises `ValueError` where it holds no numbers."""
    series = table.get_column(column)
    if not series.dtype.is_numeric():
        raise ValueError(
            f"column '{column}' is of type {series.dtype}; it must hold whole numbers."
        )
    if series.dtype.is_integer() and not series.null_count():
        return series
    return series.cast(pl.Int64, strict=False).fill_null(-1)


def changes(series: pl.Series) -> Int[np.ndarray, " change"]:
    """Rows at which a column without gaps has another number than the row before."""
    found, row, before = [np.empty(0, int)], 0, None
    # Piece by piece as they were decoded, without a copy of all.
    for piece in series.get_chunks():
        if not len(piece):
            continue
        values = piece.to_numpy()
        if before is not None and values[0] != before:
            found.append(np.array([row]))
        found.append(np.flatnonzero(values[1:] != values[:-1]) + row + 1)
        row, before = row + len(values), values[-1]
    return np.concatenate(found)
