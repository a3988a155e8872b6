"""`campaign.toml` and the recordings it names, to one `Campaign` in SI.

The schema below is strict: an unknown key, a missing one or a wrong type is an error that names file,
key, what was found and what would be right. `[columns]` is in `formats/columns`.
"""

import math
import re
import tomllib
import types
import typing
from pathlib import Path
from typing import Literal

import msgspec
import numpy as np

from .formats import ColumnMap, FORMATS, Layout, read_recordings
from .formats.columns import nearest, short
from .formats.detect import is_recording
from .recordings import Campaign, ModelChoice, Recording, Rig, Site
from .screening import check_model_columns, screen


ARCSEC = math.pi / 180 / 3600
_WILD = re.compile(r"[*?\[]")


class _Strict(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A table in which an unknown key is an error."""


class SiteTable(_Strict, frozen=True):
    """The test place."""

    gravity: float  # m/s²
    latitude: float | None = None  # deg


class RecordingsTable(_Strict, frozen=True):
    """Which files, and what their first lines do not say."""

    files: tuple[str, ...]
    gyro_files: tuple[str, ...] | None = None  # the gyros' files, where triads are logged apart
    format: str | None = None
    names: tuple[str, ...] | None = None  # columns of text without a header line
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
    rate_uncertainty: float | None = None  # ppm
    temperature_uncertainty: float | None = None  # °C


class DeviceTable(_Strict, frozen=True):
    """What kind of device."""

    grade: Literal["navigation", "tactical", "consumer"] | None = None


class ModelTable(_Strict, frozen=True):
    """The model the user means to fit."""

    accel_estimator: Literal["invariant", "reference", "static"] | None = None
    gyro_estimator: Literal["reference", "gravity", "static"] | None = None
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


def load_campaign(path: Path | str) -> Campaign:
    """The campaign in a folder or `campaign.toml`, in SI, checked; `notes` says what looks odd.

    **Arguments:** `path` is the folder that holds `campaign.toml`, or that file.

    Raises `ValueError`, in one line with file, key or column, what was found and what would be right.
    """
    file = _campaign_file(Path(path))
    table = _read_table(file)
    _check_values(table, file)
    try:
        recordings = _read_all(table, file)
        check_model_columns(_model(table.model), recordings)
        notes = screen(recordings, table.site.gravity)
    except ValueError as error:
        raise ValueError(f"{file}: {error}") from None
    return Campaign(
        recordings=recordings,
        site=_site(table.site),
        rig=_rig(table.rig),
        model=_model(table.model),
        grade=table.device.grade,
        path=file,
        notes=notes,
    )


def load_settings(path: Path | str) -> tuple[Campaign, CampaignTable]:
    """`campaign.toml` alone: a `Campaign` without recordings, and the table, for those who read the
    recordings in their own way. Raises `ValueError` as `load_campaign` does."""
    file = _campaign_file(Path(path))
    table = _read_table(file)
    _check_values(table, file)
    campaign = Campaign(
        recordings=(),
        site=_site(table.site),
        rig=_rig(table.rig),
        model=_model(table.model),
        grade=table.device.grade,
        path=file,
    )
    return campaign, table


def _site(table: SiteTable) -> Site:
    latitude = None if table.latitude is None else math.radians(table.latitude)
    return Site(gravity=table.gravity, latitude=latitude)


def _rig(table: RigTable) -> Rig:
    position, rate = table.position_uncertainty, table.rate_uncertainty
    return Rig(
        position_uncertainty=None if position is None else position * ARCSEC,
        rate_uncertainty=None if rate is None else rate * 1e-6,
        temperature_uncertainty=table.temperature_uncertainty,
    )


def _model(table: ModelTable) -> ModelChoice:
    return ModelChoice(**msgspec.structs.asdict(table))


def _campaign_file(path: Path) -> Path:
    if path.is_dir():
        if (path / "campaign.toml").is_file():
            return path / "campaign.toml"
        found = sorted(p.name for p in path.iterdir())[:8]
        raise ValueError(f"{path}: no campaign.toml in this folder; found {found}.")
    if not path.exists():
        raise ValueError(
            f"{path}: does not exist; a folder with campaign.toml, or that file, is needed."
        )
    if path.suffix.lower() != ".toml":
        raise ValueError(
            f"{path}: not a campaign.toml; write one that names this recording under [recordings] files."
        )
    return path


# --- the schema ----------------------------------------------------------------------------------


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


def _read_table(file: Path) -> CampaignTable:
    raw = read_toml(file)
    if not raw:
        raise ValueError(f"{file}: the file is empty; [site] and [recordings] are needed.")
    _check_keys(raw, CampaignTable, file, "")
    try:
        return msgspec.convert(raw, CampaignTable)
    except msgspec.ValidationError as error:
        raise ValueError(f"{file}: {_in_words(str(error), raw)}") from None


def _check_keys(raw: dict, table: type[msgspec.Struct], file: Path, where: str) -> None:
    """Unknown keys, before msgspec finds them, so that the message can offer the right one."""
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
            _check_keys(value, inner, file, f"{where}{key}: " if where else f"[{key}] ")
    for name, field in fields.items():
        if field.required and name not in raw:
            raise ValueError(f"{file}: {where or '['}{name}{_MISSING.get(name, '')}")


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
    for key, value in msgspec.structs.asdict(table.rig).items():
        if value is not None and not (math.isfinite(value) and value >= 0):
            raise ValueError(f"{file}: [rig] {key} = {value:g} must be 0 or more (1 sigma).")
    if degree is not None and not 0 <= degree <= 12:
        raise ValueError(f"{file}: [model] temperature_degree = {degree} must be within 0 to 12.")
    if table.recordings.start_row < 0:
        raise ValueError(
            f"{file}: [recordings] start_row = {table.recordings.start_row} must be 0 or more rows."
        )
    name = table.recordings.format
    formats = [f.NAME for f in FORMATS]
    if name is not None and name not in formats:
        raise ValueError(
            f"{file}: [recordings] format '{name}' is not known; {nearest(name, formats)}one of "
            f"{', '.join(formats)} is needed."
        )


# --- the files -----------------------------------------------------------------------------------


def find_files(folder: Path, patterns: tuple[str, ...], key: str = "files") -> tuple[Path, ...]:
    """Files that the patterns name, each once; a glob's matches in natural order (2 before 10).

    A pattern with `*`, `?` or `[` stays inside the campaign's folder: it may not be absolute or
    contain `..`, and a match that a link leads out of the folder is refused. A path written out
    in full is the user's own choice and is taken wherever it points.
    """
    if not patterns:
        raise ValueError(
            f'[recordings] {key} is empty; list files or globs, for example ["*.csv"].'
        )
    files: dict[Path, None] = {}
    for pattern in patterns:
        matches = _match(folder, pattern, key) if _WILD.search(pattern) else [folder / pattern]
        for match in matches:
            if not is_recording(match):
                raise ValueError(
                    f"[recordings] {key}: '{pattern}' does not exist in {_listing(folder)}."
                )
            files[match] = None
    return tuple(files)


def _match(folder: Path, pattern: str, key: str) -> list[Path]:
    if Path(pattern).is_absolute() or ".." in Path(pattern).parts:
        raise ValueError(
            f"[recordings] {key}: the glob '{pattern}' leaves the campaign's folder; use globs inside "
            "it, or write each outside file out in full."
        )
    try:
        found = [p for p in folder.glob(pattern) if is_recording(p) and not p.name.startswith(".")]
    except (ValueError, NotImplementedError, RecursionError, OSError) as error:
        raise ValueError(
            f"[recordings] {key}: the glob '{short(pattern)}' cannot be used: {error}."
        ) from None
    found = [p for p in found if p.name != "campaign.toml"]
    if not found:
        raise ValueError(f"[recordings] {key}: '{pattern}' matches no file in {_listing(folder)}.")
    home = folder.resolve()
    for match in found:
        if not match.resolve().is_relative_to(home):
            raise ValueError(
                f"[recordings] {key}: '{match.name}' is a link to a file outside the campaign's "
                "folder; write its path out in full if it is meant."
            )
    return sorted(found, key=lambda p: [(not t.isdigit(), t.zfill(20)) for t in _split(str(p))])


def _split(name: str) -> list[str]:
    return [t for t in re.split(r"(\d+)", name) if t]


def _listing(folder: Path) -> str:
    names = sorted(p.name for p in folder.iterdir() if p.name != "campaign.toml")
    return f"the campaign's folder, which has {names[:8]}" + (" and more" if len(names) > 8 else "")


def _read_all(table: CampaignTable, file: Path) -> tuple[Recording, ...]:
    said, folder = table.recordings, file.parent
    special = ("group", "topic", "temperature_topic", "instance", "sections", "turn_angle")
    layout = Layout(
        names=said.names,
        start_row=said.start_row,
        gravity=table.site.gravity,
        **{key: getattr(said, key) for key in special},
    )
    if said.gyro_files is None:
        files = find_files(folder, said.files)
        return tuple(
            r for f in files for r in read_recordings(f, table.columns, layout, name=said.format)
        )
    accel_files = find_files(folder, said.files)
    gyro_files = find_files(folder, said.gyro_files, "gyro_files")
    if len(accel_files) != len(gyro_files):
        raise ValueError(
            f"[recordings] gyro_files names {len(gyro_files)} files but files names "
            f"{len(accel_files)}; they are paired in order, so there must be as many."
        )
    recordings = []
    for triad, files in (("accel", accel_files), ("gyro", gyro_files)):
        one = msgspec.structs.replace(layout, triad=triad)
        recordings.append(
            [r for f in files for r in read_recordings(f, table.columns, one, name=said.format)]
        )
    return tuple(pair(a, g) for a, g in zip(*recordings, strict=True))


def pair(accel: Recording, gyro: Recording) -> Recording:
    """One recording from the two triads' files. Raises `ValueError` where their stamps differ."""
    where = f"'{accel.name}' and '{gyro.name}'"
    if accel.num_samples != gyro.num_samples:
        raise ValueError(
            f"{where}: {accel.num_samples} and {gyro.num_samples} rows; files of the two triads must "
            "have the same rows."
        )
    step = np.median(np.diff(accel.time)) if accel.num_samples > 1 else 1.0
    apart = np.abs(accel.time - gyro.time)
    if apart.max() > 0.5 * step:
        row = int(np.argmax(apart > 0.5 * step))
        raise ValueError(
            f"{where}: stamps differ in row {row} ({accel.time[row]:.6f} and {gyro.time[row]:.6f} s); "
            "files of the two triads must have the same stamps."
        )
    return Recording(
        time=accel.time,
        accel=accel.accel,
        gyro=gyro.gyro,
        temperature=gyro.temperature if accel.temperature is None else accel.temperature,
        experiment=gyro.experiment if accel.experiment is None else accel.experiment,
        position=gyro.position if accel.position is None else accel.position,
        reference_accel=accel.reference_accel,
        reference_gyro=gyro.reference_gyro,
        device=accel.device or gyro.device,
        name=f"{accel.name} + {gyro.name}",
    )
