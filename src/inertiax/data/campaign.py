"""`campaign.toml` and the recordings it names, to one `Campaign` in SI."""

import math
import re
from collections.abc import Callable
from pathlib import Path

import msgspec

from ..storage.harmless_text import short
from .compensated import is_compensated, note_on
from .formats import Layout, read_recordings
from .formats.columns import TimeColumn
from .formats.detect import is_recording
from .formats.kept_rows import notes_on_rows
from .formats.long_logs import read_long
from .formats.table_angles import two_axes
from .formats.table_log import read_table_log
from .formats.temperature_at_stamps import note_on_lines
from .formats.temperature_log import beside_each
from .model_columns import check_model_columns
from .pairing import pair
from .recording import Campaign, HALF, ModelChoice, Recording, restated, Rig, Site
from .settings import CampaignTable, ModelTable, read_table, RecordingsTable, SiteTable


ARCSEC = math.pi / 180 / 3600
_WILD = re.compile(r"[*?\[]")


def load_campaign(path: Path | str, *, in_parts: bool = False) -> Campaign:
    """The campaign in a folder or `campaign.toml`, in SI; `plausibility.check_campaign` says whether it can be right.

    **Arguments:** `path` is the folder that holds `campaign.toml`, or that file. With `in_parts` a log of millions of
    rows becomes several recordings whose columns stay on the disk (`formats.long_logs`).

    Raises `ValueError`, in one line with file, key or column, what was found and what would be right.
    """
    file = _campaign_file(Path(path))
    table = read_table(file)
    try:
        recordings, pairings, notes = _read_all(
            table, file, read_long if in_parts else read_recordings
        )
        check_model_columns(_model(table.model), recordings)
        recordings = _named(recordings, table.device.serial)
        for r in recordings:
            notes += tuple(notes_on_rows(r.name, r.empty_rows, r.repeated_rows))
            pairings += r.notes
            if r.temperature_step:
                pairings += (note_on_lines(r.name, r.temperature_step),)
    except ValueError as error:
        raise ValueError(f"{file}: {error}") from None
    return Campaign(
        recordings=recordings,
        site=_site(table.site),
        rig=_rig(table, file),
        model=_model(table.model),
        grade=table.device.grade,
        path=file,
        notes=pairings + notes,
        pairings=pairings,
    )


def load_triads_apart(path: Path | str) -> tuple[tuple[Recording, Recording], ...]:
    """The accelerometers' and the gyros' recording of each log of a campaign, each on stamps of its own, in SI.

    Empty where the same files hold both. Raises `ValueError` as `load_campaign` does.
    """
    file = _campaign_file(Path(path))
    table = read_table(file)
    if table.recordings.gyro_files is None:
        return ()
    try:
        accels, gyros, _ = _read_apart(table, file.parent, _layout(table))
        named = [_named(tuple(found), table.device.serial) for found in (accels, gyros)]
    except ValueError as error:
        raise ValueError(f"{file}: {error}") from None
    return tuple(zip(*named, strict=True))


def _named(recordings: tuple[Recording, ...], serial: str | None) -> tuple[Recording, ...]:
    """Recordings that no column names, with the device's serial number.

    Raises `ValueError` where a column names another device.
    """
    if serial is None:
        return recordings
    others = [r.device for r in recordings if r.device not in ("", serial)]
    if others:
        raise ValueError(
            f"[device] serial = {serial!r}, but a column of the recordings names {short(others[0])!r}; leave serial "
            "out, since the column names every device."
        )
    return tuple(restated(r, device=serial) for r in recordings)


def load_settings(path: Path | str) -> tuple[Campaign, CampaignTable]:
    """`campaign.toml` alone: a `Campaign` without recordings, and the table, for those who read the
    recordings in their own way. Raises `ValueError` as `load_campaign` does."""
    file = _campaign_file(Path(path))
    table = read_table(file)
    campaign = Campaign(
        recordings=(),
        site=_site(table.site),
        rig=_rig(table, file),
        model=_model(table.model),
        grade=table.device.grade,
        path=file,
    )
    return campaign, table


def _site(table: SiteTable) -> Site:
    latitude = None if table.latitude is None else math.radians(table.latitude)
    return Site(table.gravity, latitude, table.magnetic_field)


def _rig(table: CampaignTable, file: Path) -> Rig:
    said, axes = table.rig, None
    if table.columns.table_angles is not None:
        try:
            axes = two_axes(table.table)
        except ValueError as error:
            raise ValueError(f"{file}: {error}") from None
    position, outer_part = said.position_uncertainty, HALF
    if said.axis_uncertainty is not None:
        if axes is None:
            raise ValueError(
                f"{file}: [rig] axis_uncertainty is of the outer and the inner axis, which [columns] table_angles and "
                "two [table] axes tell; state position_uncertainty where they do not."
            )
        outer, inner = said.axis_uncertainty
        position = math.hypot(outer, inner)
        outer_part = outer**2 / position**2 if position else HALF
    scaled = lambda value, unit: None if value is None else value * unit
    return Rig(
        position_uncertainty=scaled(position, ARCSEC),
        outer_part=outer_part,
        rate_uncertainty=scaled(said.rate_uncertainty, 1e-6),
        temperature_uncertainty=said.temperature_uncertainty,
        level_uncertainty=scaled(said.level_uncertainty, ARCSEC),
        orthogonality_uncertainty=scaled(said.orthogonality_uncertainty, ARCSEC),
        axes=axes,
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
            f"{path}: not a campaign.toml; `inertiax init {short(path.name)} -o DIR` writes one that names this "
            "recording under [recordings] files."
        )
    return path


def find_files(folder: Path, patterns: tuple[str, ...], key: str = "files") -> tuple[Path, ...]:
    """Files that the patterns name, each once; a glob's matches in natural order (2 before 10).

    A pattern with `*`, `?` or `[` stays inside the campaign's folder: it may not be absolute or
    contain `..`, and a match that a link leads out of the folder is refused. A path written out
    in full is the user's own choice and is taken wherever it points. Files that `inertiax compensate` wrote are
    no recordings: a glob skips them.
    """
    if not patterns:
        raise ValueError(
            f'[recordings] {key} is empty; list files or globs, for example ["*.csv"].'
        )
    files: dict[Path, None] = {}
    for pattern in patterns:
        matches = [folder / pattern]
        if _WILD.search(pattern):
            matches = _raw(_match(folder, pattern, key), pattern, key)
        for match in matches:
            if not is_recording(match):
                raise ValueError(
                    f"[recordings] {key}: '{pattern}' does not exist in {_listing(folder)}."
                )
            files[match] = None
    return tuple(files)


def device_files(folder: Path, said: RecordingsTable) -> tuple[Path, ...]:
    """The device's files: those of `files` without what a glob among them finds of the other keys, unless that is all.

    Raises `ValueError` as `find_files` does.
    """
    found = find_files(folder, said.files)
    if not any(_WILD.search(pattern) for pattern in said.files):
        return found
    others = {
        file
        for key in ("gyro_files", "table_files", "temperature_files")
        if (patterns := getattr(said, key)) is not None
        for file in find_files(folder, patterns, key)
    }
    return tuple(f for f in found if f not in others) or found


def _raw(matches: list[Path], pattern: str, key: str) -> list[Path]:
    raw = [p for p in matches if not is_compensated(p)]
    if not raw:
        raise ValueError(
            f"[recordings] {key}: '{pattern}' matches only what `inertiax compensate` wrote "
            f"({short(matches[0].name)}); name it in full if it is meant."
        )
    return raw


def _compensated_notes(folder: Path, said: RecordingsTable, used: set[Path]) -> tuple[str, ...]:
    """Of compensated files among those that the campaign names: which were skipped, which were read."""
    patterns = (*said.files, *(said.gyro_files or ()))
    matches = {p for g in patterns if _WILD.search(g) for p in _match(folder, g, "files")}
    skipped = sorted(p for p in matches - used if is_compensated(p))
    return note_on(skipped, sorted(p for p in used - matches if is_compensated(p)))


def campaign_beside(recording: Path) -> Path | None:
    """The `campaign.toml` in a recording's folder that names it among its `files`, if there is one.

    A campaign that cannot be read is nobody's: whoever meant it names it, and is told what is wrong.
    """
    file = recording.parent / "campaign.toml"
    try:
        named = find_files(file.parent, read_table(file).recordings.files)
    except (ValueError, OSError):
        return None
    return file if recording.resolve() in {f.resolve() for f in named} else None


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
    for path in found:
        if any("\ud800" <= c <= "\udfff" for c in path.name):  # bytes of a name that are no UTF-8
            raise ValueError(
                f"[recordings] {key}: the name of '{short(path.name)}' is no UTF-8; rename it."
            )
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


def _with_table_logs(
    table: CampaignTable, folder: Path, files: tuple[Path, ...], layout: Layout
) -> list[Layout]:
    """The layout of each file, with the delay of its table, and the table's own log where there is one."""
    tables = [table.table.of_file(k, len(files)) for k in range(len(files))]
    layouts = [msgspec.structs.replace(layout, turntable=t) for t in tables]
    if table.recordings.table_files is None:
        return layouts
    paths = find_files(folder, table.recordings.table_files, "table_files")
    if len(paths) not in (1, len(files)):
        raise ValueError(
            f"[recordings] table_files names {len(paths)} files but files names {len(files)}; give one for all, or one "
            "for each, in their order."
        )
    logs = [read_table_log(p, table.columns, table.table) for p in paths]
    logs = logs * len(files) if len(logs) == 1 else logs
    pairs = zip(layouts, logs, strict=True)
    return [msgspec.structs.replace(one, table_log=log) for one, log in pairs]


def with_temperature_logs(
    table: CampaignTable, folder: Path, layouts: list[Layout]
) -> tuple[list[Layout], tuple[str, ...]]:
    """The layout of each file with the log of its temperature, where that is logged apart, and what a reader should
    know of it. Raises `ValueError` as `beside_each` does."""
    said = table.recordings
    if said.temperature_files is None:
        return layouts, ()
    paths = find_files(folder, said.temperature_files, "temperature_files")
    return beside_each(layouts, paths, said.temperature_delay, table.columns)


def _split(name: str) -> list[str]:
    return [t for t in re.split(r"(\d+)", name) if t]


def _listing(folder: Path) -> str:
    names = sorted(p.name for p in folder.iterdir() if p.name != "campaign.toml")
    return f"the campaign's folder, which has {names[:8]}" + (" and more" if len(names) > 8 else "")


def _read_all(
    table: CampaignTable, file: Path, read: Callable[..., tuple[Recording, ...]]
) -> tuple[tuple[Recording, ...], tuple[str, ...], tuple[str, ...]]:
    """The recordings, how files of the two triads became one each, and further notes."""
    said, folder = table.recordings, file.parent
    layout = _layout(table)
    if said.gyro_files is None:
        files = device_files(folder, said)
        layouts = _with_table_logs(table, folder, files, layout)
        layouts, notes = with_temperature_logs(table, folder, layouts)
        return (
            tuple(
                r
                for f, one in zip(files, layouts, strict=True)
                for r in read(f, table.columns, one, name=said.format)
            ),
            notes,
            _compensated_notes(folder, said, set(files)),
        )
    accels, gyros, notes = _read_apart(table, folder, layout)
    time = table.columns.time
    counted = isinstance(time, TimeColumn) and time.rate is not None
    paired = [pair(a, g, counted=counted) for a, g in zip(accels, gyros, strict=True)]
    pairings = tuple(p.note for p in paired if p.note is not None)
    used = {
        *device_files(folder, said),
        *find_files(folder, said.gyro_files, "gyro_files"),
    }
    recordings = tuple(p.recording for p in paired)
    return recordings, pairings + notes, _compensated_notes(folder, said, used)


def _layout(table: CampaignTable) -> Layout:
    """How the files under `[recordings]` are laid out."""
    said = table.recordings
    special = ("group", "topic", "temperature_topic", "instance", "sections", "turn_angle")
    special += ("header_line",)
    return Layout(
        names=said.names,
        gyro_names=said.gyro_names,
        start_row=said.start_row,
        gravity=table.site.gravity,
        latitude=_site(table.site).latitude,
        turntable=table.table,
        **{key: getattr(said, key) for key in special},
    )


def _read_apart(
    table: CampaignTable, folder: Path, layout: Layout
) -> tuple[list[Recording], list[Recording], tuple[str, ...]]:
    """The accelerometers' recordings and the gyros', from as many files in the same order, and what a reader should
    know."""
    said = table.recordings
    assert said.gyro_files is not None
    if said.table_files is not None:
        raise ValueError(
            "[recordings] table_files: needs both triads in each of files; gyro_files logs them apart."
        )
    accel_files = device_files(folder, said)
    gyro_files = find_files(folder, said.gyro_files, "gyro_files")
    if len(accel_files) != len(gyro_files):
        raise ValueError(
            f"[recordings] gyro_files names {len(gyro_files)} files but files names "
            f"{len(accel_files)}; they are paired in order, so there must be as many."
        )
    layouts, notes = with_temperature_logs(table, folder, [layout] * len(accel_files))
    accels, gyros = (
        [
            r
            for f, one in zip(files, layouts, strict=True)
            for r in read_recordings(
                f, table.columns, msgspec.structs.replace(one, triad=triad), name=said.format
            )
        ]
        for triad, files in (("accel", accel_files), ("gyro", gyro_files))
    )
    return accels, gyros, notes
