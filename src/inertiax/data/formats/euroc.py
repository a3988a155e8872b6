"""EuRoC MAV's `imu0/data.csv`: stamps in ns, gyros before accelerometers, SI units.

The file, its folder, or a folder above it (`mav0`, or the sequence) may be named. `[columns]` is not needed.

**Reference:** Burri et al., *The EuRoC micro aerial vehicle datasets*, IJRR 35(10), 2016.
"""

from pathlib import Path

import msgspec

from ..recording import Recording
from .columns import AS_FOUND, ColumnMap, Layout, TimeColumn, TriadColumns
from .csv import read_table
from .table import to_recordings


NAME = "euroc"
SUFFIXES = ()
KEYS = ()
_PLACES = ("data.csv", "imu0/data.csv", "mav0/imu0/data.csv")
_TIME = "timestamp [ns]"
_GYRO = tuple(f"w_RS_S_{a} [rad s^-1]" for a in "xyz")
_ACCEL = tuple(f"a_RS_S_{a} [m s^-2]" for a in "xyz")


def is_euroc(head: bytes) -> bool:
    """Whether a file's first line is that of a EuRoC IMU."""
    line = head.split(b"\n", 1)[0]
    return line.lstrip(b"# ").startswith(_TIME.encode()) and _GYRO[0].encode() in line


def data_file(folder: Path) -> Path | None:
    """The IMU's file in a folder of EuRoC's layout, `None` where there is none."""
    for place in _PLACES:
        file = folder / place
        if file.is_file():
            with file.open("rb") as content:
                if is_euroc(content.read(512)):
                    return file
    return None


def read(path: Path, columns: ColumnMap, layout: Layout = AS_FOUND) -> tuple[Recording, ...]:
    """The recording in a EuRoC file or folder. Raises `ValueError` naming file, row and column."""
    file = data_file(path) if path.is_dir() else path
    if file is None:
        raise ValueError(f"{path.name}: no EuRoC IMU in this folder; {_PLACES[2]} is needed.")
    name = path.name if file == path else f"{path.name}/{file.relative_to(path)}"
    table = read_table(file, layout.names)
    mapped = msgspec.structs.replace(
        columns,
        time=columns.time or TimeColumn(name=_TIME, unit="ns"),
        accel=_with_names(columns.accel, _ACCEL),
        gyro=_with_names(columns.gyro, _GYRO),
    )
    return to_recordings(table, mapped, layout, name=name)


def _with_names(said: TriadColumns | None, names: tuple[str, ...]) -> TriadColumns:
    said = said or TriadColumns()
    return said if said.names is not None else msgspec.structs.replace(said, names=names)
