"""Raw rows of many devices to dwell means, in one pass over the columns.

Everything is sums over stretches of rows, of all devices of a task at once, so that the cost is that of
reading memory. Only devices that are set aside are looked at one by one, for the reason.
"""

import dataclasses
from collections.abc import Iterator, Sequence

import equinox as eqx
import jax
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
from ...reduction.dwells import Dwells
from .blocks import Blocks
from .columns import (
    experiment_name,
    position_name,
    temperature_name,
    time_name,
    triad_names,
    TRIADS,
    wanted,
)
from .implausible_devices import implausible_devices
from .locations import scan
from .many_dwells import Reduction, Stack
from .single_devices import (
    changes,
    labels,
    recording_of,
    reduce_alone,
    with_moving_rows,
    with_plateaus,
)
from .stacked_dwells import shared_length
from .tasks import Stretch, Task


NO_REST = "no rest: no row has a position of 0 or more"


def read(task: Task, columns: ColumnMap, *, exact: bool = False, force: bool = False) -> Reduction:
    """The dwells of a task's devices; for `exact` and `force` see `reduce_table`.

    Raises `ValueError` for what is wrong with a file as a whole.
    """
    stretches = [s for _, mine in task.devices for s in mine]
    rows = np.array([sum(s.rows for s in mine) for _, mine in task.devices])
    # Neighbours are read in one go: a row group holds many devices, and would be decoded for each.
    tables = [_rows(s.file, s.start, s.rows, columns) for s in _joined(stretches)]
    table = tables[0] if len(tables) == 1 else pl.concat(tables, how="vertical_relaxed")
    names = tuple(d for d, _ in task.devices)
    return reduce_table(table, rows, names, columns, exact=exact, force=force)


def recordings_of(task: Task, columns: ColumnMap) -> Iterator[tuple[str, Recording | str]]:
    """A task's devices, each with all its rows, or in words why these make no recording."""
    for device, stretches in task.devices:
        tables = [_rows(s.file, s.start, s.rows, columns) for s in _joined(stretches)]
        try:
            yield device, recording_of(pl.concat(tables, how="vertical_relaxed"), columns, device)
        except ValueError as error:
            yield device, " ".join(str(error).split()).rstrip(".")


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
    names = wanted(rows.collect_schema().names(), columns, file)
    return rows.select(names).slice(start, count).collect()


class _Means(eqx.Module):
    """Of all dwells of a table, one after the other."""

    position: Int[np.ndarray, " dwell"]
    experiment: Int[np.ndarray, " dwell"]
    blocks: dict[str, Float[np.ndarray, " block"]]  # by column
    span: Float[np.ndarray, " dwell"]  # s, from the first to the last block's middle
    dwells: Dwells


def reduce_table(
    table: pl.DataFrame,
    rows: Int[np.ndarray, " device"],
    devices: tuple[str, ...],
    columns: ColumnMap,
    *,
    exact: bool = False,
    force: bool = False,
) -> Reduction:
    """Dwells of each device; the table holds `rows[0]` rows of the first device, then those of the second …

    A device that turns at a constant rate, by its reference, is reduced alone as `inertiax calibrate` does, since its
    plateaus count, and so is one of a single rest, whose bias may wander within it; with `exact` so is every device,
    whose weights are then calibrate's own. With `force` data that cannot be right have dwells too.
    """
    table = with_moving_rows(table, columns)
    quick = _by_sums(table, rows, devices, columns, force)
    ends = np.cumsum(rows)
    turning = with_plateaus(table, ends, columns)
    usable = np.array(
        [r in ("", NO_REST) if t else r == "" for r, t in zip(quick.reasons, turning)]
    )
    alone = np.flatnonzero(usable & (turning | exact | _of_one_rest(quick)))
    if not len(alone):
        return quick
    slices = (table.slice(int(ends[k] - rows[k]), int(rows[k])) for k in alone)
    made = [reduce_alone(t, columns, devices[k]) for t, k in zip(slices, alone)]
    return quick.with_reduced(alone, made)


def _of_one_rest(quick: Reduction) -> Bool[np.ndarray, " device"]:
    """Which devices have one dwell alone."""
    found = np.zeros(len(quick.devices), bool)
    for stack in quick.stacks:
        found[stack.members[stack.counts == 1]] = True
    return found


def _by_sums(
    table: pl.DataFrame,
    rows: Int[np.ndarray, " device"],
    devices: tuple[str, ...],
    columns: ColumnMap,
    force: bool,
) -> Reduction:
    """Dwells at rest of each device by sums over blocks of rows."""
    reasons = np.array([NO_REST] * len(devices), object)
    blocks, position, experiment = _cut(table, rows, columns)
    if blocks is None:
        return Reduction(devices, tuple(reasons), ())
    numbers = (position_name(columns), experiment_name(columns))
    # A device with a number that is not finite is found after it went through the sums with the others.
    with np.errstate(invalid="ignore", over="ignore"):
        values = {c: blocks.means(table.get_column(c)) for c in table.columns if c not in numbers}
        means = _means(blocks, values, position, experiment, columns)
        reasons[blocks.devices] = _reasons(blocks, means, columns, force)
    usable = reasons[blocks.devices] == ""
    return Reduction(devices, tuple(reasons), _stacks(blocks, means.dwells, usable))


def _cut(
    table: pl.DataFrame, rows: np.ndarray, columns: ColumnMap
) -> tuple[Blocks | None, np.ndarray, np.ndarray]:
    """The stretches at rest (same device, position and experiment), with their positions and experiments."""
    position = labels(table, position_name(columns))
    name = experiment_name(columns)
    experiment = labels(table, name) if name in table.columns else None
    ends = np.cumsum(rows)
    told = [changes(c) for c in (position, experiment) if c is not None]
    edges = np.unique(np.concatenate([[0], *told, ends[:-1], [len(position)]]).astype(np.int64))
    start, stop = edges[:-1], edges[1:]
    number = position.gather(start).to_numpy()
    rest = number >= 0
    start, stop = start[rest], stop[rest]
    of_dwell = np.zeros(len(start)) if experiment is None else experiment.gather(start).to_numpy()
    blocks = None
    if len(start):
        blocks = Blocks.cut(np.searchsorted(ends, start, side="right"), start, stop)
    return blocks, number[rest].astype(np.int64), of_dwell.astype(np.int64)


def _means(
    blocks: Blocks,
    values: dict[str, np.ndarray],
    position: np.ndarray,
    experiment: np.ndarray,
    columns: ColumnMap,
) -> _Means:
    scale = time_scale(
        columns.time if isinstance(columns.time, TimeColumn) else TimeColumn(), "[columns]"
    )
    clock = time_name(columns)
    stamps, pieces = values[clock] * scale, blocks.pieces
    span = stamps[blocks.first + pieces - 1] - stamps[blocks.first]
    with np.errstate(invalid="ignore", divide="ignore"):
        duration = np.where(pieces > 1, span * pieces / (pieces - 1), 0.0)
    temperature = np.zeros(len(pieces))
    probe = temperature_name(columns)
    if probe in values:
        said = columns.temperature
        column = said if isinstance(said, ProbeColumns) else ProbeColumns()
        factor, shift = temperature_factors(column, "[columns] temperature")
        temperature = factor * (blocks.over_dwells(values[probe]) + shift)
    dwells = Dwells(
        time=blocks.over_dwells(values[clock]) * scale,
        duration=duration,
        count=blocks.samples,
        temperature=temperature,
        experiment=experiment,
        position=position,
        valid=np.ones(len(pieces), bool),
    )
    return _Means(
        position,
        experiment,
        values,
        span,
        dataclasses.replace(dwells, **_triads(blocks, values, columns)),
    )


def _triads(
    blocks: Blocks, values: dict[str, np.ndarray], columns: ColumnMap
) -> dict[str, np.ndarray]:
    """Means of the triads that there are, and of those that are calibrated the covariance of the means."""
    found: dict[str, np.ndarray] = {}
    owner = np.repeat(np.arange(len(blocks.devices)), blocks.num_dwells)
    for triad in TRIADS:
        said: TriadColumns | None = getattr(columns, triad)
        names = triad_names(said, triad)
        if names[0] not in values:
            continue
        kind = "accel" if triad.endswith("accel") else "gyro"
        offset, factor = triad_factors(said or TriadColumns(), kind, f"[columns] {triad}")
        means = np.stack([blocks.over_dwells(values[n]) for n in names], axis=1)
        found[triad] = (means - offset) * factor
        if triad in ("accel", "gyro"):
            noise = np.stack([blocks.variance(values[n]) for n in names], axis=1)
            variance = noise[owner] * np.square(factor)[None] / blocks.pieces[:, None]
            found[f"{triad}_covariance"] = variance[:, :, None] * np.eye(3)[None]
    return found


# --- devices that are set aside ------------------------------------------------------------------


def _reasons(blocks: Blocks, means: _Means, columns: ColumnMap, force: bool) -> np.ndarray:
    """For each device with dwells, in words, why they cannot be used; else empty."""
    reasons = np.full(len(blocks.devices), "", object)
    for column, values in means.blocks.items():
        bad = ~np.isfinite(values)
        if bad.any():
            for k in np.flatnonzero(np.logical_or.reduceat(bad, blocks.first_block)):
                reasons[k] = reasons[k] or _gap(column, bad, int(k), blocks, means)
    accel = triad_names(columns.accel, "accel")
    for column in (c for c in accel if c in means.blocks):
        for highest in (False, True):
            held = blocks.held(means.blocks[column], highest=highest)
            for k in np.flatnonzero(held >= 2):
                reasons[k] = reasons[k] or _held(
                    column, int(held[k]), int(k), blocks, means, highest
                )
    found = implausible_devices(blocks.first_dwell, blocks.num_dwells, means.dwells)
    for k, why in enumerate([] if force else found):
        reasons[k] = reasons[k] or why
    unsorted = blocks.any_of_device(means.span < 0) | _goes_back(
        blocks, np.asarray(means.dwells.time)
    )
    for k in np.flatnonzero(unsorted):
        reasons[k] = reasons[k] or (
            "time does not increase from position to position; sort the rows by time, or, where the clock begins "
            "anew in each file, give the device a folder with a campaign.toml"
        )
    return reasons


def _goes_back(blocks: Blocks, time: np.ndarray) -> np.ndarray:
    """Whether a device's dwells do not follow one another in time."""
    back = np.zeros(len(time), bool)
    back[1:] = np.diff(time) <= 0
    back[blocks.first_dwell] = False
    return blocks.any_of_device(back)


def _gap(column: str, bad: np.ndarray, k: int, blocks: Blocks, means: _Means) -> str:
    first = int(blocks.first_block[k])
    mine = bad[first : first + int(blocks.num_blocks[k])]
    dwell = int(np.searchsorted(blocks.first, first + np.argmax(mine), side="right")) - 1
    return (
        f"column '{column}' has no finite number in {int(mine.sum())} of {len(mine)} blocks, first in "
        f"position {means.position[dwell]} of experiment {means.experiment[dwell]}"
    )


def _held(column: str, dwells: int, k: int, blocks: Blocks, means: _Means, highest: bool) -> str:
    first = int(blocks.first_block[k])
    mine = means.blocks[column][first : first + int(blocks.num_blocks[k])]
    extreme = mine.max() if highest else mine.min()
    return (
        f"column '{column}' stays at {extreme:g}, its extreme value, through {dwells} "
        "positions: saturated or stuck; choose a wider measuring range"
    )


# --- devices of about as many dwells side by side ------------------------------------------------


def _stacks(blocks: Blocks, dwells: Dwells, usable: np.ndarray) -> tuple[Stack, ...]:
    lengths = np.array([shared_length(int(n)) for n in blocks.num_dwells])
    stacks: list[Stack] = []
    for length in dict.fromkeys(lengths[usable].tolist()):
        mine = np.flatnonzero(usable & (lengths == length))
        counts = blocks.num_dwells[mine]
        within = np.minimum(np.arange(length)[None, :], counts[:, None] - 1)
        index = blocks.first_dwell[mine][:, None] + within
        padded = jax.tree.map(lambda x, i=index: x[i], dwells)
        valid = np.arange(length)[None, :] < counts[:, None]
        padded = eqx.tree_at(lambda d: d.valid, padded, valid)
        stacks.append(Stack(blocks.devices[mine], counts, padded))
    return tuple(stacks)
