"""Which files the draft names, and how their text is laid out."""

import os
from collections.abc import Sequence
from pathlib import Path

from .raw_triads import given_names, RawTriads
from .table_log import TableLog
from .temperature_log import file_lines, ProbeLog
from .toml_text import Line, Table


_MOST_FILES = 4  # that are named one by one where a glob would do
_OTHERS_SUFFIXES = (".gcsv", ".mat")  # of text that other formats call so, too
_SPACES = {",": "commas", ";": "semicolons", "\t": "tabs", " ": "blanks"}


def recordings_table(
    found: RawTriads,
    folder: Path,
    paths: list[str],
    own: Sequence[TableLog],
    probes: Sequence[ProbeLog],
) -> Table:
    """`[recordings]`: the files as `file_names` names them, the table's `own` logs, those of the temperature, and how
    their text is laid out."""
    log, layout = found.log, found.log.layout
    lines = [Line("files", paths, _words(found))]
    tables = list(dict.fromkeys(path_words(t.path, folder) for t in own))
    if tables:
        why = "the table's own log" if len(tables) == 1 else "the table's own log beside each"
        lines.append(Line("table_files", tables, why))
    lines += file_lines(probes, [path_words(p.path, folder) for p in probes])
    if found.gyro_log is not None:
        lines.append(Line("gyro_files", [path_words(found.gyro_log.path, folder)]))
    if sections_file(found).is_file():
        why = f"{sections_file(found).name} labels its sections; turns are of -360 deg, say turn_angle otherwise"
        lines.append(Line("format", "imucal", why))
    elif log.format == "csv" and log.path.suffix.lower() in _OTHERS_SUFFIXES:
        lines.append(Line("format", "csv"))
    if layout is not None and layout.header_line not in (None, 1):
        lines.append(
            Line("header_line", layout.header_line, "the line that holds the column names")
        )
    names = given_names(log, found.roles)
    if names is not None:
        lines.append(Line("names", list(names), "the file has no header line"))
    if found.gyro_log is not None and found.gyro_roles is not None:
        names = given_names(found.gyro_log, found.gyro_roles)
        lines += [] if names is None else [Line("gyro_names", list(names))]
    if log.unit_rows:
        why = "rows of units below the header" if log.has_header else "rows of settings"
        lines.append(Line("start_row", log.unit_rows, why))
    return Table("recordings", tuple(lines))


def _words(found: RawTriads) -> str:
    layout = found.log.layout
    if layout is None:
        return ""
    between = _SPACES.get(layout.delimiter, repr(layout.delimiter))
    above = len(layout.preamble)
    settings = f", {above} line{'s' * (above > 1)} above the names" if above else ""
    fields = max(len(layout.names or ()), layout.width)  # the first rows may have empty ones
    return f"{between} between {fields} fields{settings}"


def file_names(logs: Sequence[Path], folder: Path, *, one_by_one: bool = False) -> list[str]:
    """The recordings as `campaign.toml` names them: by one glob where they are all of a kind in its own folder, unless
    their order matters (`one_by_one`)."""
    glob = f"*{logs[0].suffix}"
    if (
        not one_by_one
        and len(logs) > _MOST_FILES
        and {p.resolve() for p in folder.glob(glob)} == {p.resolve() for p in logs}
    ):
        return [glob]
    return [path_words(p, folder) for p in logs]


def path_words(file: Path, folder: Path) -> str:
    """A file as `campaign.toml` names it, relative where that is possible."""
    try:
        relative = Path(os.path.relpath(file.resolve(), folder.resolve())).as_posix()
    except ValueError:  # another drive
        relative = file.resolve().as_posix()
    return relative


def sections_file(found: RawTriads) -> Path:
    """imucal's list of the labelled sections of a session, where there is one."""
    path = found.log.path
    return path.with_name(f"{path.stem}_list.json")
