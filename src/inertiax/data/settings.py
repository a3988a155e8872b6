"""The tables of `campaign.toml`, read strictly.

An unknown key, a missing one or a wrong type is an error that names file, key, what was found and what
would be right. `[columns]` is in `formats/columns`.
"""

import math
import re
import tomllib
import types
import typing
from pathlib import Path
from typing import Literal

import msgspec

from .formats import ColumnMap, FORMATS
from .formats.columns import nearest, TimeColumn
from .formats.turntable import Turntable
from .plausible_units import GREATEST_EARTH_FIELD, LEAST_EARTH_FIELD


class _Strict(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A table in which an unknown key is an error."""


class SiteTable(_Strict, frozen=True):
    """The test place."""

    gravity: float  # m/s²
    latitude: float | None = None  # deg
    magnetic_field: float | None = None  # T, magnitude


class RecordingsTable(_Strict, frozen=True):
    """Which files, and what their first lines do not say."""

    files: tuple[str, ...]
    gyro_files: tuple[str, ...] | None = None  # the gyros' files, where triads are logged apart
    table_files: tuple[str, ...] | None = None  # the table's own logs: one, or one for each file
    # Logs of the temperature, where that is logged apart: one, or one for each file
    temperature_files: tuple[str, ...] | None = None
    temperature_delay: float | tuple[float, ...] = 0.0  # s, by which their stamps are late
    format: str | None = None
    names: tuple[str, ...] | None = None  # columns of text without a header line
    gyro_names: tuple[str, ...] | None = None  # the same of `gyro_files`, where they differ
    header_line: int | None = None  # line of a text that holds the column names, counted from 1
    start_row: int = 0  # data rows left out at the start of each file
    group: str | None = None  # HDF5 group or table, MATLAB struct
    topic: str | None = None  # ROS or ULog topic
    temperature_topic: str | None = None  # ROS topic of the probe
    instance: int | None = None  # which IMU of a flight controller's log
    sections: str | None = None  # imucal's list of labelled sections
    turn_angle: float | None = None  # deg, of imucal's turns


class RigTable(_Strict, frozen=True):
    """1 sigma each."""

    position_uncertainty: float | None = None  # arcsec
    axis_uncertainty: tuple[float, float] | None = None  # arcsec, of the outer and the inner axis
    rate_uncertainty: float | None = None  # ppm
    temperature_uncertainty: float | None = None  # °C
    level_uncertainty: float | None = None  # arcsec, each of two horizontal angles of the base
    orthogonality_uncertainty: float | None = None  # arcsec, of the outer axis to the inner one


class DeviceTable(_Strict, frozen=True):
    """What kind of device, and which."""

    grade: Literal["navigation", "tactical", "consumer"] | None = None
    serial: str | None = None  # serial number, where no column of the recordings names the device


class ModelTable(_Strict, frozen=True):
    """The model the user means to fit."""

    # Names of `estimators.ESTIMATORS`, or "none"; checked where the model is chosen, since users may add their own.
    accel_estimator: str | None = None
    gyro_estimator: str | None = None
    mag_estimator: str | None = None
    g_sensitivity: bool | None = None
    temperature_degree: int | None = None
    together: bool | None = None
    lever_arms: bool | None = None
    misalignment: bool | None = None


class CampaignTable(_Strict, frozen=True):
    """The whole file."""

    site: SiteTable
    recordings: RecordingsTable
    columns: ColumnMap = ColumnMap()
    rig: RigTable = RigTable()
    device: DeviceTable = DeviceTable()
    model: ModelTable = ModelTable()
    table: Turntable = Turntable()  # whose angles `[columns] table_angles` names


def read_toml(file: Path) -> dict:
    """The tables of a TOML file. Raises `ValueError` of one line where it is none."""
    content = file.read_bytes()
    if content.startswith((b"\xff\xfe", b"\xfe\xff")):
        raise ValueError(f"{file}: the text is UTF-16; save it as UTF-8.")
    try:
        return tomllib.loads(content.decode("utf-8-sig"))
    # RecursionError: brackets in brackets; ValueError: whole numbers of thousands of digits.
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{file}: not valid TOML: {' '.join(str(error).split())[:200]}.") from None


def read_table(file: Path) -> CampaignTable:
    """The checked tables of a `campaign.toml`.

    Raises `ValueError` in one line with file and key, what was found and what would be right.
    """
    raw = read_toml(file)
    if not raw:
        raise ValueError(f"{file}: the file is empty; [site] and [recordings] are needed.")
    check_keys(raw, CampaignTable, file)
    try:
        table = msgspec.convert(raw, CampaignTable)
    except msgspec.ValidationError as error:
        raise ValueError(f"{file}: {_in_words(str(error), raw)}") from None
    _check_values(table, file)
    return table


def check_keys(raw: dict, table: type[msgspec.Struct], file: Path, where: str = "") -> None:
    """Look for unknown and missing keys of a table before msgspec does, so that the message can offer the right ones.

    **Arguments:** `where` are the tables around it, such as "[site] "; empty for a whole file.

    Raises `ValueError`, one line that begins with the file and names table and key.
    """
    fields = {f.name: f for f in msgspec.structs.fields(table)}
    for key, value in raw.items():
        if key not in fields:
            kind = "table" if not where else "key"
            raise ValueError(
                f"{file}: {where}unknown {kind} '{key}'; {nearest(key, fields)}known are "
                f"{', '.join(fields)}."
            )
        inner = _struct_of(fields[key].type)
        if inner is not None and isinstance(value, dict):
            check_keys(value, inner, file, f"{where}{key}: " if where else f"[{key}] ")
    for name, field in fields.items():
        if field.required and name not in raw:
            absent = _MISSING.get(name, " is missing." if where else "] is missing.")
            raise ValueError(f"{file}: {where or '['}{name}{absent}")


_MISSING = {
    "site": "] is missing; it gives gravity, the reference value at the test place in m/s².",
    "recordings": '] is missing; it names the files, for example files = ["*.csv"].',
    "gravity": " is missing; it is the reference value at the test place in m/s² (standard: 9.80665).",
    "files": ' is missing; it lists files or globs, for example files = ["*.csv"].',
    "name": " is missing; it is the column's name in the file.",
}


def _struct_of(kind: object) -> type[msgspec.Struct] | None:
    options = typing.get_args(kind) if isinstance(kind, types.UnionType) else (kind,)
    for option in options:
        if isinstance(option, type) and issubclass(option, msgspec.Struct):
            return option
    return None


def _in_words(message: str, raw: dict) -> str:
    """msgspec's message with the key in TOML's terms, the value found, and the choices there are."""
    said, _, place = message.partition(" - at `$.")
    keys = place.rstrip("`").split(".")
    found, kind = raw, CampaignTable
    for key in keys:
        name = key.partition("[")[0]
        found = found[name]
        inner = {f.name: f.type for f in msgspec.structs.fields(kind)}[name]
        kind = _struct_of(inner) or inner
    where = f"[{keys[0]}] " + " ".join(keys[1:])
    choices = [c for a in typing.get_args(kind) for c in typing.get_args(a) if isinstance(c, str)]
    if choices:
        said = f"{nearest(str(found), choices)}it must be one of {', '.join(choices)}"
    said = said.replace("`array` of length 3", "a list of three").replace("`array`", "a list")
    said = re.sub(r"Expected (.*), got (.*)", r"expected \1", said).replace("`", "")
    for ugly, plain in _TYPE_NAMES:
        said = re.sub(rf"\b{ugly}\b", plain, said)
    told = repr(found)
    return f"{where.strip()}: {said}; found {told if len(told) < 80 else told[:80] + '…'}."


_TYPE_NAMES = (
    (r" \| null", ""),
    ("float", "a number"),
    ("int", "a whole number"),
    ("str", "text"),
    ("bool", "true or false"),
    ("array", "a list of three"),
    ("object", "a table"),
    (r" \| ", " or "),
)


def _check_values(table: CampaignTable, file: Path) -> None:
    """Numbers that no test place or station has."""
    site, degree = table.site, table.model.temperature_degree
    if not 9.7 <= site.gravity <= 9.9:
        raise ValueError(
            f"{file}: [site] gravity = {site.gravity:g} is no gravity on Earth; it must be within "
            "9.7 to 9.9 m/s²."
        )
    if site.latitude is not None and not -90 <= site.latitude <= 90:
        raise ValueError(
            f"{file}: [site] latitude = {site.latitude:g} must be within -90 to 90 degrees."
        )
    field = site.magnetic_field
    if field is not None and not LEAST_EARTH_FIELD <= field <= GREATEST_EARTH_FIELD:
        raise ValueError(
            f"{file}: [site] magnetic_field = {field:g} is no magnetic field of the Earth in T; it must be within "
            f"{LEAST_EARTH_FIELD:g} to {GREATEST_EARTH_FIELD:g} (48.6 uT is 48.6e-6)."
        )
    serial = table.device.serial
    if serial is not None and not serial.strip():
        raise ValueError(
            f"{file}: [device] serial is empty; write the serial number, or leave it out."
        )
    for key, said in msgspec.structs.asdict(table.rig).items():
        for value in said if isinstance(said, tuple) else (said,):
            if value is not None and not (math.isfinite(value) and value >= 0):
                raise ValueError(f"{file}: [rig] {key} = {value:g} must be 0 or more (1 sigma).")
    if table.rig.position_uncertainty is not None and table.rig.axis_uncertainty is not None:
        raise ValueError(
            f"{file}: [rig] states position_uncertainty and axis_uncertainty; the former is the root of the sum of the "
            "latter's squares, so state one of them."
        )
    if degree is not None and not 0 <= degree <= 12:
        raise ValueError(f"{file}: [model] temperature_degree = {degree} must be within 0 to 12.")
    if table.recordings.start_row < 0:
        raise ValueError(
            f"{file}: [recordings] start_row = {table.recordings.start_row} must be 0 or more rows."
        )
    line = table.recordings.header_line
    if line is not None and line < 1:
        raise ValueError(
            f"{file}: [recordings] header_line = {line} must be 1 or more; lines are counted from 1."
        )
    if table.recordings.gyro_names is not None and table.recordings.gyro_files is None:
        raise ValueError(
            f"{file}: [recordings] gyro_names is for gyro_files, which are not given; use names."
        )
    time = table.columns.time
    apart = isinstance(time, TimeColumn) and time.gyro_name is not None
    if apart and table.recordings.gyro_files is None:
        raise ValueError(
            f"{file}: [columns] time: gyro_name is for gyro_files, which are not given; use name."
        )
    if table.recordings.temperature_files is None:
        for where, said in (
            ("[recordings] temperature_delay", table.recordings.temperature_delay),
            ("[columns] temperature_time", table.columns.temperature_time),
        ):
            if said:
                raise ValueError(
                    f"{file}: {where} is for [recordings] temperature_files, which are not given."
                )
    name = table.recordings.format
    formats = [f.NAME for f in FORMATS]
    if name is not None and name not in formats:
        raise ValueError(
            f"{file}: [recordings] format '{name}' is not known; {nearest(name, formats)}one of "
            f"{', '.join(formats)} is needed."
        )
