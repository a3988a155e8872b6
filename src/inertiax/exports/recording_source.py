"""How the recording that a calibration is applied to is read: names and units, layout, format."""

import math
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType

import msgspec
import polars as pl

from ..data.campaign import device_files, with_temperature_logs
from ..data.compensated import COLUMN, is_compensated
from ..data.formats import ColumnMap, detect, Layout
from ..data.formats.columns import AXES, TriadColumns
from ..data.formats.temperature_at_stamps import TemperatureLog
from ..data.frames import TRIADS
from ..data.recording import COLUMNS
from ..data.settings import read_table, read_toml


_OF_A_STATION = (
    "reference_accel", "reference_gyro", "table_angles", "table_rates", "position", "experiment",
)  # fmt: skip
_NUMBERS = [
    k for k in ColumnMap.__struct_fields__ if k not in ("device", "table_time", "temperature_time")
]
_FILES = ("files", "gyro_files", "table_files", "temperature_files", "temperature_delay")


def source_of(
    path: Path, gyro_file: Path | None, campaign: Path | None
) -> tuple[ColumnMap, Layout, ModuleType]:
    """How a recording is to be read: names and units, layout, format.

    Raises `ValueError` where it is none, was compensated before, or holds one triad whose columns are called as the
    other's, which no `gyro_file` holds.
    """
    columns, layout, format_name = mapping_of(campaign, path)
    of_both = _named(columns, "accel") & _named(columns, "gyro")
    if of_both and gyro_file is None:
        raise ValueError(
            f"{path}: the columns {', '.join(sorted(of_both))} are the accelerometers' and, in a file of their own, "
            "the gyros'; name that file by --gyro FILE."
        )
    for file in (path, gyro_file):
        if file is not None and is_compensated(file):
            raise ValueError(
                f"{file}: was compensated already, for it has a column '{COLUMN}'; give the recording itself. "
                "Twice compensated outputs are wrong by the errors' size."
            )
    if not detect.is_recording(path):
        raise ValueError(f"{path}: a recording file is needed, or a bag's or EuRoC's folder.")
    chosen = detect.format_of(path, layout) if format_name is None else detect.by_name(format_name)
    return columns, layout, chosen


def mapping_of(campaign: Path | None, path: Path) -> tuple[ColumnMap, Layout, str | None]:
    """`[columns]`, and the layout and format under `[recordings]`, of a campaign for that recording."""
    if campaign is None:
        return ColumnMap(), Layout(), None
    file = campaign / "campaign.toml" if campaign.is_dir() else campaign
    try:
        raw = read_toml(file)
        columns = msgspec.convert(raw.get("columns", {}), ColumnMap)
        said = dict(raw.get("recordings", {}))
        name = said.pop("format", None)
        apart = _temperature_log(file, path) if "temperature_files" in said else None
        for key in _FILES:
            said.pop(key, None)
        site, table = raw.get("site", {}), raw.get("table", {})
        latitude = site.get("latitude")
        place = {"gravity": site.get("gravity"), "latitude": latitude and math.radians(latitude)}
        layout = msgspec.convert({**said, **place, "turntable": table}, Layout)
        layout = msgspec.structs.replace(layout, temperature_log=apart)
        return columns, layout, msgspec.convert(name, str | None)
    except (msgspec.ValidationError, AttributeError, TypeError) as error:
        reason = " ".join(str(error).split())[:200]
        raise ValueError(f"{file}: [columns], [recordings] or [table]: {reason}.") from None


def in_service(columns: ColumnMap, there: Sequence[str] = ()) -> ColumnMap:
    """`[columns]` of a log from outside the station: names that only a station writes and that are not `there` go."""
    absent = {key: None for key in _OF_A_STATION if not _named(columns, key) <= set(there)}
    return msgspec.structs.replace(columns, **absent)


def rows_of_device(
    table: pl.DataFrame, columns: ColumnMap, device: str, name: str
) -> tuple[pl.Series | None, tuple[str, ...]]:
    """Which rows of a table of several devices are of that one, and a note that says so; `None` where all are, or where
    none is, or a row says no device."""
    column = columns.label("device") or "device"
    if not device or column not in table.columns:
        return None, ()
    serial = table[column].cast(pl.String).str.strip_chars()
    count = serial.n_unique()
    mine = serial == device
    if count == 1 or serial.null_count() or (serial == "").any() or not mine.any():
        return None, ()
    note = (
        f"{name}: {mine.sum()} of {table.height} rows are compensated, those of device {device}, one of {count}; the "
        "others are left out"
    )
    return mine, (note,)


def channels_of(columns: ColumnMap, there: Sequence[str]) -> tuple[str, ...]:
    """Those of the columns `there` that are read as numbers: of `[columns]`, or of canonical names."""
    named = set().union(*(_named(columns, key) for key in _NUMBERS))
    canonical = {*COLUMNS, *(f"{triad}_{axis}" for triad in TRIADS for axis in AXES)}
    probes = [n for n in there if n.startswith("temperature_")]
    return tuple(n for n in there if n in named or n in canonical or n in probes)


def _named(columns: ColumnMap, key: str) -> set[str]:
    said = getattr(columns, key)
    if isinstance(said, str):
        return {said}
    if isinstance(said, TriadColumns):
        return set(said.names or (f"{key}_{axis}" for axis in AXES))
    return set(getattr(said, "names", None) or [getattr(said, "name", None) or key])


def _temperature_log(campaign: Path, recording: Path) -> TemperatureLog:
    """The log of the temperature of one of the campaign's files, or the only log of the campaign.

    Raises `ValueError` for a recording that the campaign does not name, where each of its files has a log of its own.
    """
    table, folder = read_table(campaign), campaign.parent
    files = device_files(folder, table.recordings)
    layouts, _ = with_temperature_logs(table, folder, [Layout()] * len(files))
    logs = [layout.temperature_log for layout in layouts]
    named = [x for x, f in zip(logs, files, strict=True) if f.resolve() == recording.resolve()]
    if not named and any(x is not logs[0] for x in logs):
        raise ValueError(
            f"{recording}: is none of the files of {campaign}, of which each has a log of its temperature; name it "
            "there, with its log under [recordings] temperature_files."
        )
    return named[0] if named else logs[0]
