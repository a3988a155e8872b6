"""Which columns of a fleet's Parquet files are read, by the campaign's `[columns]`."""

from collections.abc import Sequence
from typing import Literal

from ...data.formats import ColumnMap
from ...data.formats.columns import AXES, ProbeColumns, TimeColumn, TriadColumns


Triad = Literal["accel", "gyro", "reference_accel", "reference_gyro"]
TRIADS: tuple[Triad, ...] = ("accel", "gyro", "reference_accel", "reference_gyro")


def wanted(names: Sequence[str], columns: ColumnMap, file: str) -> list[str]:
    """Labels first, then what was measured. Raises `ValueError` for a column that is not among `names`."""
    position = position_name(columns)
    if position not in names:
        raise ValueError(
            f"{file}: column '{position}' is missing; a fleet's Parquet files tell the measuring position "
            "(-1 while the table turns). Calibrate recordings without it as a folder of campaigns."
        )
    experiment = experiment_name(columns)
    found = [position, *([experiment] if experiment in names else []), time_name(columns)]
    found += [n for n in (temperature_name(columns),) if n in names]
    for triad in TRIADS:
        said: TriadColumns | None = getattr(columns, triad)
        mine = triad_names(said, triad)
        if said is not None or any(n in names for n in mine):
            found += mine
    missing = [n for n in found if n not in names]
    if missing:
        raise ValueError(f"{file}: column '{missing[0]}' is missing; the file has {list(names)}.")
    return found


def position_name(columns: ColumnMap) -> str:
    """The column that numbers the measuring positions."""
    return columns.label("position") or "position"


def experiment_name(columns: ColumnMap) -> str:
    """The column that numbers the runs of the programme."""
    return columns.label("experiment") or "experiment"


def time_name(columns: ColumnMap) -> str:
    """The clock. Raises `ValueError` where the campaign says there is none."""
    said = columns.time
    if isinstance(said, TimeColumn) and said.rate is not None:
        raise ValueError(
            "[columns] time: rate is for logs without a clock; a fleet's Parquet files need a time column."
        )
    if isinstance(said, TimeColumn) and said.mend:
        raise ValueError(
            "[columns] time: mend is for logs of one device; a fleet's Parquet files need stamps in order."
        )
    return said if isinstance(said, str) else (said.name if said and said.name else "time")


def temperature_name(columns: ColumnMap) -> str:
    """The device's probe."""
    said = columns.temperature
    if isinstance(said, ProbeColumns):
        return said.name or (said.names[0] if said.names else "temperature")
    return said or "temperature"


def triad_names(said: TriadColumns | None, triad: str) -> list[str]:
    """A triad's three columns."""
    return list(said.names) if said and said.names else [f"{triad}_{axis}" for axis in AXES]
