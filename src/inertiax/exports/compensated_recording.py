"""A calibration applied to a recording file: the same table with compensated columns."""

from collections.abc import Sequence
from pathlib import Path
from types import ModuleType
from typing import NamedTuple

import msgspec
import numpy as np
import polars as pl
from jaxtyping import Bool, Float

from ..calibration.calibration import Calibration
from ..calibration.device_place import about_device, arms_not_shown, place_on_table
from ..calibration.over_rows import compensated_rows
from ..data.compensated import COLUMN
from ..data.formats import ColumnMap, csv, detect, Layout, parquet, table as tables
from ..data.formats.columns import AXES, TimeColumn
from ..data.formats.kept_rows import kept_rows, notes_on_rows
from ..data.formats.temperature_at_stamps import with_temperatures
from ..data.frames import TRIADS
from ..data.pairing import pair
from ..data.recording import Recording
from .better_at_rest import AtRest, Tally
from .compensated_field import feels_current, further_columns
from .extrapolation import extrapolated, margin
from .range_ends import RangeEnds
from .recording_source import channels_of, in_service, rows_of_device, source_of
from .replaced_columns import replaced_columns
from .required_columns import require_fit
from .text_columns import TextKinds


_CHUNK = 65536  # samples compensated at a time: little memory


class Extent(NamedTuple):
    """How many rows there are, and how many at which temperatures lie outside the calibrated range."""

    rows: int = 0
    outside: int = 0
    lowest: float = np.inf  # °C
    highest: float = -np.inf

    @classmethod
    def of(cls, recording: Recording, outside: Bool[np.ndarray, " time"]) -> "Extent":
        """Of one recording or a piece of one."""
        rows, count = len(outside), int(outside.sum())
        if recording.temperature is None:
            return cls(rows, count)
        probe = recording.temperature[:, 0]
        return cls(rows, count, float(probe.min()), float(probe.max()))

    def __or__(self, other: "Extent") -> "Extent":
        """Of both together."""
        low, high = min(self.lowest, other.lowest), max(self.highest, other.highest)
        return Extent(self.rows + other.rows, self.outside + other.outside, low, high)


class Compensated(NamedTuple):
    """A compensated table and what to know about it."""

    table: pl.DataFrame
    num_extrapolated: int
    notes: tuple[str, ...]
    units: dict[str, str]  # of the columns that were made: `accel`, `gyro`, `mag`, `pressure`
    at_rest: AtRest | None  # what its rests read before and after


def compensate_file(
    calibration: Calibration,
    path: Path,
    *,
    gyro_file: Path | None = None,
    campaign: Path | None = None,
    any_device: bool = False,
    at_table: bool = False,
    as_text: bool = False,
) -> Compensated:
    """The table of a recording with its outputs compensated, equation (3), named effects included.

    Columns accel_x/y/z (m/s²), gyro_x/y/z (rad/s) and mag_x/y/z (T) hold the result, and `extrapolated` says
    where the temperature is outside `calibration.temperature_range` (by more than `extrapolation.margin`). `time`
    (s) and `temperature` (°C) are as they were read, so that the result is a recording in canonical columns. Of CSV
    and Parquet all other columns are kept as they are, and of a table of several devices the rows of the calibration's;
    any other format that `formats` reads gives its canonical columns in SI, and a column `recording` where the file
    holds several of the device; of a log of several IMUs those of the calibration's. `gyro_file` holds the gyros where
    triads are logged apart; `campaign` is a `campaign.toml` (or its folder) that says names, units and layout.
    The force is that at the device's own place (`calibration.device_place`), with `at_table` that at the table's axes.
    Columns that are kept of a text are numbers where their numbers give the same text back, with `as_text` the text
    they are (`text_columns.TextKinds`).

    Raises `ValueError` where a column that the calibration needs is missing, or where the recording
    says that it is of another device or was compensated before.
    """
    calibration, place = at_place(calibration, path.name, at_table=at_table)
    columns, layout, chosen = source_of(path, gyro_file, campaign)
    if chosen in (csv, parquet) and gyro_file is None:
        table, shown = _read(path, chosen, columns, layout, as_text=as_text)
        columns = in_service(columns, table.columns).of_files(layout)
        first = min(layout.start_row, table.height - 1)  # with none left the reader says so
        mine, left_out = rows_of_device(
            table.slice(first), columns, calibration.device.strip(), path.name
        )
        if mine is not None:
            table, shown = (t.slice(first).filter(mine) for t in (table, shown))
            layout = msgspec.structs.replace(layout, start_row=0)
        # Rows that a refusal counts are those of the device.
        named = path.name if mine is None else f"{path.name}, rows of one device"
        found = tables.to_recordings(table, columns, layout, name=named)
        (recording,) = _of_device(found, path.name)
        recording = with_temperatures(recording, layout.temperature_log)
        table, shown = table.slice(layout.start_row), shown.slice(layout.start_row)
        kept = kept_rows(table, columns, layout)
        own = kept.of(shown)
        made = _compensated_table(
            calibration, recording, kept.table, path.name, any_device, own.table
        )
        return made._replace(
            table=own.among(shown, made.table),
            notes=(
                *left_out,
                *made.notes,
                *place,
                *notes_on_rows(path.name, kept.empty, kept.repeated),
            ),
        )
    read = lambda file, how: detect.read_recordings(file, columns, how, name=chosen.NAME)
    notes: tuple[str, ...] = ()
    if gyro_file is None:
        found = read(path, layout)
    else:
        alone = [msgspec.structs.replace(layout, triad=t) for t in ("accel", "gyro")]
        (accel,), (gyro,) = read(path, alone[0]), read(gyro_file, alone[1])
        counted = isinstance(columns.time, TimeColumn) and columns.time.rate is not None
        paired = pair(accel, gyro, counted=counted)
        found, notes = (paired.recording,), tuple(n for n in (paired.note,) if n is not None)
    found = _of_device(found, path.name, calibration.device)
    notes += tuple(note for r in found for note in (*r.notes, *r.reservations))
    parts = [
        _compensated_table(calibration, recording, _table_of(recording), path.name, any_device)
        for recording in found
    ]
    if len(parts) > 1:
        names = (r.name for r in found)
        parts = [
            part._replace(table=part.table.with_columns(recording=pl.lit(name)))
            for part, name in zip(parts, names, strict=True)
        ]
    return Compensated(
        pl.concat([p.table for p in parts]),
        sum(p.num_extrapolated for p in parts),
        tuple(dict.fromkeys((*notes, *(note for p in parts for note in p.notes), *place))),
        {name: unit for p in parts for name, unit in p.units.items()},
        parts[0].at_rest,
    )


def at_place(
    calibration: Calibration, name: str, *, at_table: bool
) -> tuple[Calibration, tuple[str, ...]]:
    """The calibration whose lever arms are about the device's own place, and a note that says where that was."""
    place = place_on_table(calibration)
    if place is None:
        return calibration, ()
    if at_table:
        note = (
            "with the lever arms taken away, the accelerometers' force is that at the table's axes"
        )
        return calibration, (f"{name}: {note}{arms_not_shown(calibration)}",)
    shown = ", ".join("not shown" if np.isnan(p) else f"{1e3 * p:.1f}" for p in place)
    note = (
        f"{name}: the force is that at the device's own place, which the table turned at {shown} mm (x, y, z) from its "
        "axes; --at-table gives that at the axes"
    )
    return about_device(calibration), (note,)


def _compensated_table(
    calibration: Calibration,
    recording: Recording,
    table: pl.DataFrame,
    name: str,
    any_device: bool,
    shown: pl.DataFrame | None = None,
) -> Compensated:
    """A recording's table, or the same as it is `shown`, with the columns that compensation makes."""
    require_fit(calibration, recording, name, any_device=any_device)
    force, rate, outside, left_out = _compensate(calibration, recording)
    further = further_columns(calibration, recording)
    notes = notes_on(calibration, recording, Extent.of(recording, outside), name)
    ends = RangeEnds()
    ends.add(recording)
    notes += ends.notes(name)
    notes += tuple(f"{name}: {line}" for line in left_out)
    units = units_of(calibration, recording)
    notes += replaced_columns(table, recording, units, name)
    shown = table if shown is None else shown
    made = with_outputs(table, shown, recording, force, rate, further, outside)
    tally = Tally(float(calibration.gravity))
    tally.add(recording, force, rate)
    return Compensated(made, int(outside.sum()), notes, units, tally.result())


def units_of(calibration: Calibration, recording: Recording) -> dict[str, str]:
    """Units of the columns that compensation makes of a recording."""
    made = {"accel": "m/s^2", "gyro": "rad/s"}
    if calibration.mag is not None:
        made["mag"] = "T"
    if calibration.baro is not None and recording.temperature is not None:
        made["pressure"] = "Pa"
    return {name: unit for name, unit in made.items() if getattr(recording, name) is not None}


def with_outputs(
    table: pl.DataFrame,
    shown: pl.DataFrame,
    recording: Recording,
    force: Float[np.ndarray, "time 3"] | None,
    rate: Float[np.ndarray, "time 3"] | None,
    further: dict[str, np.ndarray],
    outside: Bool[np.ndarray, " time"],
) -> pl.DataFrame:
    """The table, as it is `shown`, with what compensation gave: m/s², rad/s, further columns, and where the temperature
    is outside; with the time (s) and temperature (°C) that were read, where it has none of these names or has them in
    other units."""
    new = {COLUMN: outside, **further}
    read = {"time": recording.time}
    if recording.temperature is not None:
        read["temperature"] = recording.temperature[:, 0]
    for name, values in read.items():
        if name not in table.columns:
            new[name] = values
        elif table[name].dtype.is_numeric() and not np.array_equal(
            table[name].to_numpy(), values, equal_nan=True
        ):
            new[name] = values
    for triad, values in (("accel", force), ("gyro", rate)):
        if values is not None:
            new |= {f"{triad}_{axis}": values[:, k] for k, axis in enumerate(AXES)}
    return shown.with_columns(**new)


def _table_of(recording: Recording) -> pl.DataFrame:
    """A recording as canonical columns, SI."""
    columns: dict[str, np.ndarray] = {"time": recording.time}
    for triad in TRIADS:
        values = getattr(recording, triad)
        if values is not None:
            columns |= {f"{triad}_{axis}": values[:, k] for k, axis in enumerate(AXES)}
    if recording.temperature is not None:
        probes = recording.temperature.T
        columns |= {f"temperature{f'_{k + 1}' if k else ''}": v for k, v in enumerate(probes)}
    for label in ("experiment", "position", "supply", "current", "pressure"):
        if getattr(recording, label) is not None:
            columns[label] = getattr(recording, label)
    table = pl.DataFrame(columns)
    return table.with_columns(device=pl.lit(recording.device)) if recording.device else table


def compensate_recording(
    calibration: Calibration, recording: Recording
) -> tuple[
    Float[np.ndarray, "time 3"] | None,
    Float[np.ndarray, "time 3"] | None,
    Bool[np.ndarray, " time"],
]:
    """Specific force (m/s²), rate (rad/s), and where the temperature is outside the calibration's.

    A triad that was not recorded is `None`; one that was not calibrated is returned as it is. Named
    effects of the calibration are taken away too, where the recording lets compute them.
    """
    return _compensate(calibration, recording)[:3]


def _compensate(
    calibration: Calibration, recording: Recording
) -> tuple[np.ndarray | None, np.ndarray | None, np.ndarray, tuple[str, ...]]:
    """`compensate_recording` and a line for each effect that is not taken away."""
    force, rate, outside = by_parameters(calibration, recording)
    notes: tuple[str, ...] = ()
    if calibration.effects:
        from ..diagnose.estimates import applied_effects as augmented

        made = augmented.compensate(calibration, recording)
        force, rate, notes = made.accel, made.gyro, made.notes
    return force, rate, outside, notes


def by_parameters(
    calibration: Calibration, recording: Recording
) -> tuple[
    Float[np.ndarray, "time 3"] | None,
    Float[np.ndarray, "time 3"] | None,
    Bool[np.ndarray, " time"],
]:
    """`compensate_recording` without named effects: sample by sample, in chunks."""
    count = recording.num_samples
    zeros = np.zeros((count, 3))
    accel = zeros if recording.accel is None else recording.accel
    gyro = zeros if recording.gyro is None else recording.gyro
    temperature = np.zeros(count) if recording.temperature is None else recording.temperature[:, 0]
    parts = []
    for start in range(0, count, _CHUNK):
        rows = slice(start, start + _CHUNK)
        parts.append(compensated_rows(calibration, accel[rows], gyro[rows], temperature[rows]))
    force, rate = (np.concatenate(x) for x in zip(*parts, strict=True))
    outside = np.zeros(count, bool)
    if recording.temperature is not None:
        outside = extrapolated(calibration, temperature)
    return (
        None if recording.accel is None else force,
        None if recording.gyro is None else rate,
        outside,
    )


def _read(
    path: Path, chosen: ModuleType, columns: ColumnMap, layout: Layout, *, as_text: bool
) -> tuple[pl.DataFrame, pl.DataFrame]:
    """A file's table as it is read, and as it is kept."""
    if chosen is csv:
        text = csv.read_table(path, layout.names, header_line=layout.header_line)
        kinds = text_kinds(columns, text.columns, as_text=as_text)
        kinds.see(text)
        return kinds.read(text), kinds.kept(text)
    table = parquet.decode(path)
    return table, table


def text_kinds(columns: ColumnMap, there: Sequence[str], *, as_text: bool) -> TextKinds:
    """How the columns of a text that are `there` are read and kept."""
    device = columns.label("device") or "device"
    return TextKinds(device, channels_of(columns, there), as_text=as_text)


def _of_device(
    recordings: tuple[Recording, ...], name: str, wanted: str = ""
) -> tuple[Recording, ...]:
    """The recordings of the `wanted` device, which a log of several IMUs names; else all, which must be of one."""
    devices = tuple(dict.fromkeys(r.device for r in recordings))
    if len(devices) == 1:
        return recordings
    if wanted and wanted in devices:
        return tuple(r for r in recordings if r.device == wanted)
    shown = ", ".join([*devices[:5], *["…"] * (len(devices) > 5)])
    raise ValueError(
        f"{name}: holds {len(devices)} devices ({shown}), but a "
        f"calibration is of one; write each device's rows to a file of its own, or name one IMU of a flight "
        f"log with [recordings] instance."
    )


def notes_on(
    calibration: Calibration, recording: Recording, extent: Extent, name: str
) -> tuple[str, ...]:
    """What a reader of the compensated table should know, in words."""
    notes = []
    for triad, label in (("accel", "accelerometers"), ("gyro", "gyros")):
        if getattr(recording, triad) is not None and getattr(calibration, triad) is None:
            named = [e.name for e in calibration.effects if e.triad == triad]
            kept = f"have only {', '.join(named)} taken away" if named else "are left as recorded"
            notes.append(f"{name}: the {label} were not calibrated and {kept}")
    if feels_current(calibration) and recording.mag is not None and recording.current is None:
        notes.append(
            f"{name}: no current column, so that its field is not taken from the magnetometers'"
        )
    if extent.outside and calibration.temperature_range is not None:
        low, high = calibration.temperature_range
        notes.append(
            f"{name}: {extent.outside} of {extent.rows} rows at {extent.lowest:.2f}…"
            f"{extent.highest:.2f} °C are outside the calibrated {low:.2f}…{high:.2f} °C by more than "
            f"{margin(calibration):.2f} °C; see the column 'extrapolated'"
        )
    return tuple(notes)
