"""A calibration applied to a log of any length, some rows at a time.

CSV and Parquet are read, compensated and written in pieces, so that the memory does not grow with the log. Equation (3)
knows no other sample than its own, so the pieces are what the whole table would be. Named effects depend on
what went before (and on the recording as a whole): with them, of other formats, of triads in files of their own, and of
what cannot be read in pieces, the whole table is made in memory, as `compensate_file` does.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import polars as pl

from ..calibration.calibration import Calibration
from ..data.formats import ColumnMap, csv, Layout
from ..data.formats.columns import TimeColumn
from ..data.formats.kept_rows import kept_rows, notes_on_rows
from ..data.formats.pieces import BYTES, can_be_cut, counts_rows, mends_stamps, pieces, ROWS
from ..data.formats.table import to_recordings
from ..data.recording import Recording
from ..storage.whole_files import written_beside
from .better_at_rest import AtRest, Tally
from .compensated_field import feels_current, further_columns
from .compensated_recording import (
    at_place,
    by_parameters,
    compensate_file,
    Extent,
    notes_on,
    text_kinds,
    units_of,
    with_outputs,
)
from .range_ends import RangeEnds
from .recording_source import in_service, source_of
from .replaced_columns import replaced_columns
from .required_columns import require_fit
from .table_writer import full_disk_told, TableWriter


# A piece as it is read, and as it is kept.
Pairs = Iterator[tuple[pl.DataFrame, pl.DataFrame]]


class Written(NamedTuple):
    """What a compensated file holds and what to know about it."""

    rows: int
    num_extrapolated: int
    notes: tuple[str, ...]
    units: dict[str, str]  # of the columns that were made: `accel`, `gyro`, `mag`, `pressure`
    at_rest: AtRest | None  # what its rests read before and after


def write_compensated(
    calibration: Calibration,
    path: Path,
    output: Path,
    *,
    gyro_file: Path | None = None,
    campaign: Path | None = None,
    any_device: bool = False,
    at_table: bool = False,
    rows: int = ROWS,
    size: int = BYTES,
) -> Written:
    """Write the table of `compensate_file` as CSV or Parquet, by the suffix of `output`: whole or not at all.

    **Arguments:** as of `compensate_file`; `rows` (of Parquet) and `size` (bytes of text) are those of a piece.

    Raises `ValueError` as `compensate_file` does, and where the result cannot be written.
    """
    columns, layout, chosen = source_of(path, gyro_file, campaign)
    as_text = output.suffix.lower() == ".csv"
    with full_disk_told(output), written_beside(output) as beside:
        known, place = at_place(calibration, path.name, at_table=at_table)
        whole = gyro_file is not None or known.effects or layout.temperature_log is not None
        if can_be_cut(chosen) and not whole:
            read = lambda: pieces(path, chosen, layout, rows=rows, size=size)
            tables = _typed(read, columns, as_text) if chosen is csv else ((t, t) for t in read())
            write = lambda: TableWriter(beside, output.suffix)
            try:
                made = _in_pieces(known, path.name, tables, columns, write, any_device)
                return made._replace(notes=(*made.notes, *place))
            except ValueError:
                pass  # what is wrong, if anything is, is said with its row where the whole table is read
        made = compensate_file(
            calibration, path, gyro_file=gyro_file, campaign=campaign, any_device=any_device,
            at_table=at_table, as_text=as_text,
        )  # fmt: skip
        with TableWriter(beside, output.suffix) as writer:
            writer.append(made.table)
    return Written(made.table.height, made.num_extrapolated, made.notes, made.units, made.at_rest)


def _in_pieces(
    calibration: Calibration,
    name: str,
    tables: Pairs,
    columns: ColumnMap,
    write: Callable[[], TableWriter],
    any_device: bool,
) -> Written:
    """The pieces, compensated and written. Raises `ValueError` for what the whole table alone can tell."""
    if mends_stamps(columns):
        raise ValueError(f"{name}: stamps are mended in the whole log alone.")
    columns = in_service(columns)  # a sample is compensated without references and labels
    extent, last, replaced, empty, repeated = Extent(), None, (), 0, 0
    tally, ends = Tally(float(calibration.gravity)), RangeEnds()
    with write() as writer:
        for table, shown in tables:
            kept = kept_rows(table, columns, Layout())
            own = kept.of(shown)
            (recording,) = to_recordings(kept.table, columns, Layout(), name=name, piece=True)
            if isinstance(columns.time, TimeColumn) and columns.time.rate is not None:
                counted = (extent.rows + np.arange(recording.num_samples)) / columns.time.rate
                recording = replace(recording, time=counted)
            _require_next(recording, last, columns)
            require_fit(calibration, recording, name, any_device=any_device)
            if feels_current(calibration) and _has_gaps(recording):
                raise ValueError("a current that is held goes beyond a piece.")
            force, rate, outside = by_parameters(calibration, recording)
            tally.add(recording, force, rate)
            ends.add(recording)
            further = further_columns(calibration, recording)
            if last is None:
                units = units_of(calibration, recording)
                replaced = replaced_columns(kept.table, recording, units, name)
            extent |= Extent.of(recording, outside)
            empty, repeated = empty + kept.empty, repeated + kept.repeated
            made = with_outputs(kept.table, own.table, recording, force, rate, further, outside)
            writer.append(own.among(shown, made))
            last = recording[-1:]
    if last is None:
        raise ValueError(f"{name}: no rows.")
    left_out = notes_on_rows(name, empty, repeated)
    notes = (*notes_on(calibration, last, extent, name), *ends.notes(name), *replaced, *left_out)
    units = units_of(calibration, last)
    return Written(extent.rows, extent.outside, notes, units, tally.result())


def _require_next(recording: Recording, last: Recording | None, columns: ColumnMap) -> None:
    """That a piece goes on where the last one ended: the same device, the same columns, a later time."""
    if last is None:
        return
    same = recording.device == last.device and _columns(recording) == _columns(last)
    if not same or not (counts_rows(columns) or recording.time[0] > last.time[-1]):
        raise ValueError("the pieces are not those of one recording.")


def _has_gaps(recording: Recording) -> bool:
    return recording.current is not None and not np.isfinite(recording.current).all()


def _columns(recording: Recording) -> list[str]:
    return [k for k in ("accel", "gyro", "mag", "temperature") if getattr(recording, k) is not None]


def _typed(
    tables: Callable[[], Iterator[pl.DataFrame]], columns: ColumnMap, as_text: bool
) -> Pairs:
    """Pieces of text with columns as numbers where all pieces hold numbers: told in a pass of its own."""
    kinds = None
    for table in tables():
        kinds = kinds or text_kinds(columns, table.columns, as_text=as_text)
        kinds.see(table)
    if kinds is not None:
        for table in tables():
            yield kinds.read(table), kinds.kept(table)
