"""Raw rows of many devices to dwell means, in one pass over the columns.

Everything is sums over stretches of rows, so that the cost is that of reading memory. The covariance of a
dwell's mean comes from the scatter of block means within dwells, by successive differences (an
Allan variance at the block's length), pooled over the device: noise that is correlated for less than a block
is counted rightly, and a slow drift within a dwell is not taken for noise.
"""

from collections.abc import Sequence
from typing import Literal

import equinox as eqx
import numpy as np
import polars as pl
from jaxtyping import Float, Int

from ..dwells import Dwells
from ..formats import ColumnMap
from ..formats.columns import (
    AXES,
    ProbeColumns,
    temperature_to_celsius,
    time_scale,
    TimeColumn,
    triad_factors,
    TriadColumns,
)
from .locations import scan
from .tasks import Stretch, Task


BLOCKS = 16  # of a dwell
FEWEST = 4  # samples in a block

Triad = Literal["accel", "gyro", "reference_accel", "reference_gyro"]
TRIADS: tuple[Triad, ...] = ("accel", "gyro", "reference_accel", "reference_gyro")


class Reduced(eqx.Module):
    """One device's dwells, or in words why there are none."""

    device: str = eqx.field(static=True)
    dwells: Dwells | None
    reason: str = eqx.field(static=True, default="")


def read(task: Task, columns: ColumnMap) -> tuple[Reduced, ...]:
    """The dwells of a task's devices. Raises `ValueError` for what is wrong with a file as a whole."""
    stretches = [s for _, mine in task.devices for s in mine]
    sizes = [s.rows for s in stretches]
    owner = np.repeat([k for k, (_, mine) in enumerate(task.devices) for _ in mine], sizes)
    # Neighbours are read in one go: a row group holds many devices, and would be decoded for each.
    tables = [_rows(s.file, s.start, s.rows, columns) for s in _joined(stretches)]
    table = pl.concat(tables, how="vertical_relaxed", rechunk=True)
    return reduce_table(table, owner, [d for d, _ in task.devices], columns)


def _joined(stretches: Sequence[Stretch]) -> list[Stretch]:
    """Stretches that follow one another in a file as one."""
    joined: list[Stretch] = []
    for s in stretches:
        last = joined[-1] if joined else None
        if last is not None and last.file == s.file and last.start + last.rows == s.start:
            joined[-1] = Stretch(s.file, last.start, last.rows + s.rows)
        else:
            joined.append(s)
    return joined


def _rows(file: str, start: int, count: int, columns: ColumnMap) -> pl.DataFrame:
    rows = scan(file)
    wanted = _wanted(rows.collect_schema().names(), columns, file)
    return rows.select(wanted).slice(start, count).collect()


def _wanted(names: Sequence[str], columns: ColumnMap, file: str) -> list[str]:
    position = columns.label("position") or "position"
    if position not in names:
        raise ValueError(
            f"{file}: column '{position}' is missing; a fleet's Parquet files tell the measuring position "
            "(-1 while the table turns). Calibrate recordings without it as a folder of campaigns."
        )
    experiment = columns.label("experiment") or "experiment"
    wanted = [position, *([experiment] if experiment in names else []), _time_name(columns)]
    wanted += [n for n in (_temperature_name(columns),) if n in names]
    for triad in TRIADS:
        said: TriadColumns | None = getattr(columns, triad)
        mine = _triad_names(said, triad)
        if said is not None or any(n in names for n in mine):
            wanted += mine
    missing = [n for n in wanted if n not in names]
    if missing:
        raise ValueError(f"{file}: column '{missing[0]}' is missing; the file has {list(names)}.")
    return wanted


def _time_name(columns: ColumnMap) -> str:
    said = columns.time
    if isinstance(said, TimeColumn) and said.rate is not None:
        raise ValueError(
            "[columns] time: rate is for logs without a clock; a fleet's Parquet files need a time column."
        )
    return said if isinstance(said, str) else (said.name if said and said.name else "time")


def _temperature_name(columns: ColumnMap) -> str:
    said = columns.temperature
    if isinstance(said, ProbeColumns):
        return said.name or (said.names[0] if said.names else "temperature")
    return said or "temperature"


def _triad_names(said: TriadColumns | None, triad: str) -> list[str]:
    return list(said.names) if said and said.names else [f"{triad}_{axis}" for axis in AXES]


def reduce_table(
    table: pl.DataFrame,
    owner: Int[np.ndarray, " row"],
    devices: Sequence[str],
    columns: ColumnMap,
) -> tuple[Reduced, ...]:
    """Dwells of each device; `owner` numbers the device of each row, rows of one device together."""
    position = _labels(table, columns.label("position") or "position")
    experiment_name = columns.label("experiment") or "experiment"
    if experiment_name in table.columns:
        experiment = _labels(table, experiment_name)
    else:
        experiment = np.zeros(len(owner), np.int64)
    changes = (np.diff(owner) != 0) | (np.diff(position) != 0) | (np.diff(experiment) != 0)
    edges = np.concatenate([[0], np.flatnonzero(changes) + 1, [len(owner)]])
    start, stop = edges[:-1], edges[1:]
    rest = position[start] >= 0
    start, stop = start[rest], stop[rest]
    blocks = _Blocks.cut(start, stop)
    values = {
        c: blocks.means(table.get_column(c)) for c in table.columns if _is_measured(c, columns)
    }
    return tuple(
        _device(
            name, np.flatnonzero(owner[start] == k), blocks, values, position, experiment, columns
        )
        for k, name in enumerate(devices)
    )


def _is_measured(column: str, columns: ColumnMap) -> bool:
    labels = (columns.label("position") or "position", columns.label("experiment") or "experiment")
    return column not in labels


def _labels(table: pl.DataFrame, column: str) -> Int[np.ndarray, " row"]:
    series = table.get_column(column)
    if not series.dtype.is_numeric():
        raise ValueError(
            f"column '{column}' is of type {series.dtype}; it must hold whole numbers."
        )
    return series.cast(pl.Int64, strict=False).fill_null(-1).to_numpy()


class _Blocks(eqx.Module):
    """Dwells cut into blocks of equal length; what is left over at a dwell's end joins its last block."""

    start: Int[np.ndarray, " dwell"]
    stop: Int[np.ndarray, " dwell"]
    pieces: Int[np.ndarray, " dwell"]
    first: Int[np.ndarray, " dwell"]  # number of each dwell's first block
    edge: Int[np.ndarray, " block"]  # first row of each block
    count: Int[np.ndarray, " block"]  # samples

    @classmethod
    def cut(cls, start: np.ndarray, stop: np.ndarray) -> "_Blocks":
        count = stop - start
        pieces = np.clip(count // FEWEST, 1, BLOCKS)
        first = np.cumsum(pieces) - pieces
        owner = np.repeat(np.arange(len(start)), pieces)
        within = np.arange(len(owner)) - first[owner]
        edge = start[owner] + within * count[owner] // pieces[owner]
        end = start[owner] + (within + 1) * count[owner] // pieces[owner]
        return cls(start, stop, pieces, first, edge, end - edge)

    def means(self, series: pl.Series) -> Float[np.ndarray, " block"]:
        """Means over the blocks; NaN where a block has a gap or a number that is not finite."""
        values = series.cast(pl.Float64, strict=False).fill_null(float("nan")).to_numpy()
        if not len(self.edge):
            return np.zeros(0)
        # Sums between consecutive edges hold the rows between dwells too, so both edges are cut.
        cuts = np.stack([self.edge, self.edge + self.count], axis=1).reshape(-1)
        inside = cuts[-1] == len(values)
        sums = np.add.reduceat(values, cuts[:-1] if inside else cuts)
        return sums[::2] / self.count


def _device(
    name: str,
    mine: Int[np.ndarray, " dwell"],
    blocks: _Blocks,
    values: dict[str, np.ndarray],
    position: np.ndarray,
    experiment: np.ndarray,
    columns: ColumnMap,
) -> Reduced:
    if not len(mine):
        return Reduced(name, None, "no rest: no row has a position of 0 or more")
    pieces, first = blocks.pieces[mine], blocks.first[mine]
    rows = np.arange(first[0], first[-1] + pieces[-1])
    count = blocks.count[rows].astype(float)
    starts = first - first[0]
    samples = np.add.reduceat(count, starts)

    def mean(column: str) -> np.ndarray:
        return np.add.reduceat(values[column][rows] * count, starts) / samples

    for column in values:
        bad = ~np.isfinite(values[column][rows])
        if bad.any():
            dwell = int(np.searchsorted(starts, np.argmax(bad), side="right")) - 1
            row = int(blocks.start[mine[dwell]])
            return Reduced(
                name,
                None,
                f"column '{column}' has no finite number in {int(bad.sum())} of {len(bad)} blocks, first in "
                f"position {position[row]} of experiment {experiment[row]}",
            )
    said_time = columns.time if isinstance(columns.time, TimeColumn) else TimeColumn()
    time = mean(_time_name(columns)) * time_scale(said_time, "[columns]")
    triads: dict[str, np.ndarray] = {}
    for triad in TRIADS:
        said: TriadColumns | None = getattr(columns, triad)
        names = _triad_names(said, triad)
        if names[0] not in values:
            continue
        kind = "accel" if triad.endswith("accel") else "gyro"
        offset, factor = triad_factors(said or TriadColumns(), kind, f"[columns] {triad}")
        triads[triad] = (np.stack([mean(n) for n in names], axis=1) - offset) * factor
        if triad in ("accel", "gyro"):
            noise = [_variance_of_block(values[n][rows], starts, pieces) for n in names]
            if triad == "accel":
                held = _held(values, names, rows, starts, pieces)
                if held is not None:
                    return Reduced(name, None, held)
            variance = np.array(noise)[None] * np.square(factor)[None] / pieces[:, None]
            triads[f"{triad}_covariance"] = variance[:, :, None] * np.eye(3)[None]
    temperature = np.zeros(len(mine))
    probe = _temperature_name(columns)
    if probe in values:
        unit = columns.temperature.unit if isinstance(columns.temperature, ProbeColumns) else "degC"
        scale, shift = temperature_to_celsius(unit, "[columns] temperature")
        temperature = scale * (mean(probe) + shift)
    row = blocks.start[mine]
    stamps = values[_time_name(columns)][rows] * time_scale(said_time, "[columns]")
    span = (
        stamps[starts + pieces - 1] - stamps[starts]
    )  # between the first and the last block's middle
    with np.errstate(invalid="ignore", divide="ignore"):
        duration = np.where(pieces > 1, span * pieces / (pieces - 1), 0.0)
    if np.any(span < 0) or np.any(np.diff(time) <= 0):
        return Reduced(
            name, None, "time does not increase from position to position; sort the rows by time"
        )
    return Reduced(
        name,
        Dwells(
            time=time,
            duration=duration,
            count=samples,
            temperature=temperature,
            experiment=experiment[row],
            position=position[row],
            valid=np.ones(len(mine), bool),
            accel=triads.get("accel"),
            accel_covariance=triads.get("accel_covariance"),
            gyro=triads.get("gyro"),
            gyro_covariance=triads.get("gyro_covariance"),
            reference_accel=triads.get("reference_accel"),
            reference_gyro=triads.get("reference_gyro"),
        ),
    )


def _variance_of_block(
    means: Float[np.ndarray, " block"], starts: np.ndarray, pieces: np.ndarray
) -> float:
    """Variance of one block's mean, by successive differences within dwells, pooled."""
    difference = np.diff(means)
    same = np.ones(len(difference), bool)
    same[starts[1:] - 1] = False  # from one dwell to the next
    kept = difference[same]
    return float(np.mean(np.square(kept)) / 2.0) if len(kept) else 0.0


def _held(
    values: dict[str, np.ndarray],
    names: list[str],
    rows: np.ndarray,
    starts: np.ndarray,
    pieces: np.ndarray,
) -> str | None:
    """In words, an axis that stays exactly at its extreme value through several dwells."""
    for column in names:
        x = values[column][rows]
        low, high = np.minimum.reduceat(x, starts), np.maximum.reduceat(x, starts)
        for extreme in (x.min(), x.max()):
            stuck = (low == high) & (low == extreme) & (pieces > 1)
            if stuck.sum() >= 2:
                return (
                    f"column '{column}' stays at {extreme:g}, its extreme value, through {int(stuck.sum())} "
                    "positions: saturated or stuck; choose a wider measuring range"
                )
    return None
