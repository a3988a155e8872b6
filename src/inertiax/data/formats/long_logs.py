"""A log of millions of rows as parts on the disk, cut where the device lies still."""

import dataclasses
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from types import ModuleType

import msgspec
import numpy as np
import polars as pl
from jaxtyping import Float

from ...numerics.side_by_side import side_by_side
from ...physics.wgs84 import EARTH_RATE
from ..recording import Recording
from ..stored_recording import ColumnStore, StoredRecording
from . import csv
from .columns import AS_FOUND, CANONICAL, ColumnMap, Layout, TimeColumn
from .detect import by_name, format_of, read_recordings, special_keys
from .pieces import BYTES, can_be_cut, mends_stamps, pieces, ROWS
from .table import to_recordings
from .temperature_at_stamps import with_temperatures


PART = 1 << 19  # rows of a part, about
_BYTES_A_ROW = 64  # of text, at the least: time and six numbers
_LONG = 1.5  # parts, from which a log is cut
_BLOCK = 128  # rows that are judged together where a cut is looked for
_STANDS = 1.5 * EARTH_RATE  # of a reference, as `reduction.segments` has it
_REACH = 8  # of a part's length, its fraction in which the stillest place is taken


def read_long(
    path: Path,
    columns: ColumnMap = CANONICAL,
    layout: Layout = AS_FOUND,
    *,
    name: str | None = None,
    part: int = PART,
    rows: int = ROWS,
    size: int = BYTES,
) -> tuple[Recording, ...]:
    """The recordings of `read_recordings`; one long log of one device as parts that stay on the disk.

    **Arguments:** as of `read_recordings`; `part` is about how many rows a part has, `rows` and `size` are as in
    `pieces`. A file is long from one and a half parts on.

    Raises `ValueError` as `read_recordings` does.
    """
    chosen = _format(path, layout, name)
    if chosen is not None and _rows(path, chosen) > _LONG * part:
        try:
            tables = pieces(path, chosen, layout, rows=rows, size=size)
            store, device = _stored(tables, columns.of_files(layout), layout, path.name)
            return _parts(store, device, path.name, part)
        except (ValueError, OSError):
            pass  # what is wrong, if anything is, is said where the whole file is read
    return read_recordings(path, columns, layout, name=name)


def _format(path: Path, layout: Layout, name: str | None) -> ModuleType | None:
    """The format of a file that can be cut; `None` for any other."""
    if not path.is_file() or layout.triad is not None:
        return None
    if layout.turntable.one_delay and layout.table_log is None:
        return None  # angles at other rows than their own may be those of another piece
    chosen = format_of(path, layout) if name is None else by_name(name)
    return chosen if can_be_cut(chosen) and not special_keys(chosen, layout) else None


def _rows(path: Path, chosen: ModuleType) -> int:
    """Rows of a file, about; 0 where it is damaged."""
    if chosen is csv:
        return path.stat().st_size // _BYTES_A_ROW
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        return pq.read_metadata(path).num_rows
    except (pa.ArrowException, OSError, ValueError):
        return 0


def _stored(
    tables: Iterator[pl.DataFrame], columns: ColumnMap, layout: Layout, name: str
) -> tuple[ColumnStore, str]:
    """The columns on the disk, and the device. Raises `ValueError` for what only the whole table tells."""
    store, device, last = ColumnStore(), "", -np.inf
    if columns.each_row_is_a_pose:
        raise ValueError(f"{name}: rows of poses are no long log.")
    if mends_stamps(columns):
        raise ValueError(f"{name}: stamps are mended in the whole log alone.")
    rate = columns.time.rate if isinstance(columns.time, TimeColumn) else None
    layout = msgspec.structs.replace(layout, start_row=0)  # left out of the pieces already

    def keep(table: pl.DataFrame, device: str, last: float) -> tuple[str, float]:
        (recording,) = to_recordings(table, columns, layout, name=name, piece=True)
        if rate is not None:
            time = (store.rows + np.arange(recording.num_samples)) / rate
            recording = dataclasses.replace(recording, time=time)
        recording = with_temperatures(recording, layout.temperature_log)
        if recording.time[0] <= last or (store.rows and recording.device != device):
            raise ValueError(f"{name}: the pieces are not those of one recording.")
        store.append(recording)
        return recording.device, float(recording.time[-1])

    # One piece is decoded while the one before it is written.
    with ThreadPoolExecutor(1) as pool:
        written: Future[tuple[str, float]] | None = None
        for table in tables:
            if written is not None:
                device, last = written.result()
            written = pool.submit(keep, table, device, last)
        if written is not None:
            device, last = written.result()
    return store, device


def _parts(store: ColumnStore, device: str, name: str, part: int) -> tuple[Recording, ...]:
    """Parts of about one length, from one still place to the next."""
    count = max(-(-store.rows // part), 1)
    middles = [k * store.rows // count for k in range(1, count)]
    cuts = [0, *(_still(store, at, part // _REACH) for at in middles), store.rows]
    ends = list(zip(cuts[:-1], cuts[1:], strict=True))
    levels = side_by_side(lambda rows: _quietest(store, *rows), ends, rows=store.rows)
    quietest = min(x for x, _ in levels), min(y for _, y in levels)

    def checked(k: int) -> StoredRecording:
        return StoredRecording.part(
            store, *ends[k], device=device, name=f"{name} (part {k + 1} of {count})", whole=name,
            quietest=quietest,
        )  # fmt: skip

    return tuple(side_by_side(checked, range(count), rows=store.rows))


def _quietest(store: ColumnStore, first: int, stop: int) -> tuple[float, float]:
    """The level of the quietest twentieth of the seconds of a part, of accelerometers and of gyros."""
    time = store.read("time", first, stop)
    assert time is not None
    step = float(np.median(np.diff(time)))
    width = max(int(round(1.0 / step)) if step > 0 else 1, 16)
    count = (stop - first) // width
    levels = []
    for name in ("accel", "gyro"):
        values = store.read(name, first, stop)
        level = np.inf
        if values is not None and count:
            blocks = values[: count * width].T.reshape(3, count, width)  # no copy
            spread = blocks.var(axis=2).sum(axis=0)
            varying = spread[spread > 1e-12 * spread.max()]  # a coarse converter may stand still
            level = float(np.quantile(varying, 0.05)) if len(varying) else np.inf
        levels.append(level)
    return levels[0], levels[1]


def _still(store: ColumnStore, middle: int, reach: int) -> int:
    """The middle of a rest within `reach` of a row, where columns tell rests; else of the stillest rows."""
    first = middle - reach
    count = max(2 * reach // _BLOCK, 1)
    told = _told_rest(store, first, first + count * _BLOCK)
    if told is not None:
        return first + told
    motion = np.zeros(count)
    for name in ("accel", "gyro"):
        values = store.read(name, first, first + count * _BLOCK, keep=False)
        if values is not None:
            motion += _motion(values.reshape(count, _BLOCK, 3), turns=name == "gyro")
    return first + int(np.argmin(motion)) * _BLOCK + _BLOCK // 2


def _told_rest(store: ColumnStore, first: int, stop: int) -> int | None:
    """The middle of a run of one position, or in which the reference stands; `None` where no column tells one.

    It is the nearest to the middle of the rows that is no shorter than half of the runs: the halves of a long one, in
    which the temperature moves, would be other dwells than the whole.
    """
    label = store.read("position", first, stop, keep=False)
    if label is None:
        rate = store.read("reference_gyro", first, stop, keep=False)
        if rate is None:
            return None
        label = np.where(np.linalg.norm(rate, axis=1) <= _STANDS, 0, -1)
    edges = np.concatenate([[0], np.flatnonzero(np.diff(label)) + 1, [len(label)]])
    resting = label[edges[:-1]] >= 0
    start, lasts = edges[:-1][resting], np.diff(edges)[resting]
    if not len(start):
        return None
    usual = lasts >= np.median(lasts)
    middle = (start + lasts // 2)[usual]
    return int(middle[np.argmin(np.abs(middle - len(label) // 2))])


def _motion(
    blocks: Float[np.ndarray, "block row 3"], *, turns: bool
) -> Float[np.ndarray, " block"]:
    """How much each block moves, in the unit of the usual one; with `turns`, steady turns count, too."""
    spread = blocks.var(axis=1).sum(axis=1)
    scale = max(float(np.median(spread)), 1e-300)
    if turns:
        mean = blocks.mean(axis=1)
        spread = spread + np.square(mean - np.median(mean, axis=0)).sum(axis=1)
    return spread / scale
