"""imucal's Ferraris session: a CSV and a list of labelled sections, six rests and three turns.

`x_p` … `z_a` rest with an axis up (p) or down (a); in `x_rot`, `y_rot`, `z_rot` the device turns about that
axis, which points up, by `[recordings] turn_angle` (deg; −360 as imucal has it: clockwise). Each section is
a recording of its own with its reference: ±g and no rate, or +g and the mean rate angle / duration.
Raw data are in m/s² and deg/s, columns acc_x … gyr_z, unless `[columns]` says otherwise; imucal keeps no
stamps, so give `[columns] time = { rate = ... }`.

**Reference:** Ferraris, Grimaldi, Parvis, *Procedure for effortless in-field calibration of three-axis
rate gyros and accelerometers*, Sensors and Materials 7(5), 1995.
"""

import json
import math
from pathlib import Path

import msgspec
import numpy as np

from ..recording import Recording
from .columns import AS_FOUND, ColumnMap, Layout, shown, TriadColumns
from .csv import read_table
from .table import to_recordings


NAME = "imucal"
SUFFIXES = ()
KEYS = ("sections", "turn_angle")
STANDARD_GRAVITY = 9.80665  # m/s², where the campaign gives none
RESTS = ("x_p", "x_a", "y_p", "y_a", "z_p", "z_a")
TURNS = ("x_rot", "y_rot", "z_rot")


def read(path: Path, columns: ColumnMap, layout: Layout = AS_FOUND) -> tuple[Recording, ...]:
    """One recording per section. Raises `ValueError` naming file, section or column."""
    mapped = msgspec.structs.replace(
        columns,
        accel=_default(columns.accel, "acc", "m/s^2"),
        gyro=_default(columns.gyro, "gyr", "deg/s"),
    )
    sections = _sections(_section_file(path, layout.sections), path)
    if isinstance(columns.time, str) or columns.time is None:
        raise ValueError(
            f"{path.name}: imucal sessions have no stamps; give the sampling rate with [columns] "
            "time = { rate = ... } in Hz."
        )
    (whole,) = to_recordings(read_table(path, layout.names), mapped, layout, name=path.name)
    angle = math.radians(-360.0 if layout.turn_angle is None else layout.turn_angle)
    gravity = STANDARD_GRAVITY if layout.gravity is None else layout.gravity
    recordings = []
    for label, (start, end) in sections.items():
        if not 0 <= start < end <= whole.num_samples:
            raise ValueError(
                f"{path.name}: section {label} is rows {start} to {end}, but the session has "
                f"{whole.num_samples} rows."
            )
        recordings.append(_labelled(whole[start:end], label, angle, gravity))
    return tuple(recordings)


def _labelled(part: Recording, label: str, angle: float, gravity: float) -> Recording:
    axis = np.eye(3)["xyz".index(label[0])]
    up = -1.0 if label.endswith("_a") else 1.0
    turning = label in TURNS
    step = float(np.median(np.diff(part.time)))
    rate = axis * (angle / (part.num_samples * step) if turning else 0.0)
    spread = lambda v: np.tile(v, (part.num_samples, 1))
    return Recording(
        time=part.time,
        accel=part.accel,
        gyro=part.gyro,
        temperature=part.temperature,
        experiment=np.zeros(part.num_samples, np.int64),
        position=np.full(part.num_samples, -1 if turning else RESTS.index(label)),
        reference_accel=spread(up * gravity * axis),
        reference_gyro=spread(rate),
        device=part.device,
        name=f"{part.name} ({label})",
    )


def _default(said: TriadColumns | None, prefix: str, unit: str) -> TriadColumns:
    said = said or TriadColumns(unit=unit)
    if said.names is None:
        said = msgspec.structs.replace(said, names=tuple(f"{prefix}_{a}" for a in "xyz"))
    return said


def _section_file(path: Path, asked: str | None) -> Path:
    if asked is not None:
        file = path.parent / asked
        if not file.is_file():
            raise ValueError(f"{path.name}: the sections' file '{asked}' does not exist beside it.")
        return file
    tries = [f"{path.stem}_list.json", f"{path.stem}_list.csv", f"{path.stem}_sections.json"]
    for name in tries:
        if (path.parent / name).is_file():
            return path.parent / name
    raise ValueError(
        f"{path.name}: no list of sections beside it ({', '.join(tries)}); name it with [recordings] "
        "sections."
    )


def _sections(file: Path, path: Path) -> dict[str, tuple[int, int]]:
    """First row and row after the last of each section, in the order of the list."""
    if file.suffix.lower() == ".json":
        try:
            said = json.loads(file.read_text("utf-8"))
            found = {k: (int(v["start"]), int(v["end"])) for k, v in said.items()}
        except (ValueError, KeyError, TypeError, AttributeError, OverflowError, RecursionError):
            raise ValueError(
                f'{file.name}: a list of sections is {{"x_p": {{"start": 0, "end": 100}}, ...}}.'
            ) from None
    else:
        table = read_table(file)
        names = table.columns
        if not {"start", "end"} <= set(names) or len(names) != 3:
            raise ValueError(
                f"{file.name}: a list of sections has a label, start and end; found {shown(names)}."
            )
        (label,) = set(names) - {"start", "end"}
        try:
            found = {r[label]: (int(r["start"]), int(r["end"])) for r in table.to_dicts()}
        except (TypeError, ValueError, OverflowError):
            raise ValueError(f"{file.name}: start and end must be whole numbers.") from None
    missing = [s for s in (*RESTS, *TURNS) if s not in found]
    unknown = [s for s in found if s not in (*RESTS, *TURNS)]
    if missing or unknown:
        raise ValueError(
            f"{file.name}: sections must be {', '.join((*RESTS, *TURNS))}; missing {missing}, unknown "
            f"{unknown} (of {path.name})."
        )
    return found
