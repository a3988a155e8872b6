"""imu_tk's text: `t x y z` per line, blanks or commas between, no header; one triad per file.

The suffix is often `.mat` although it is plain text. Accelerometer and gyro are two files of the
same length and stamps, named under `[recordings] files` and `gyro_files`.

**Reference:** Tedaldi, Pretto, Menegatti, *A robust and easy to implement method for IMU calibration
without external equipments*, ICRA 2014; the `imu_tk` library's data format.
"""

from pathlib import Path

import msgspec

from ..recording import Recording
from .columns import AS_FOUND, ColumnMap, Layout, TriadColumns
from .csv import read_table
from .table import to_recordings


NAME = "imu_tk"
SUFFIXES = (".mat",)
KEYS = ()
_COLUMNS = ("time", "x", "y", "z")


def read(path: Path, columns: ColumnMap, layout: Layout = AS_FOUND) -> tuple[Recording, ...]:
    """The one triad in the file (`layout.triad`, the accelerometers unless it says the gyros)."""
    key = layout.triad or "accel"
    said = getattr(columns, key) or TriadColumns()
    if said.names is None:
        said = msgspec.structs.replace(said, names=_COLUMNS[1:])
    mapped = msgspec.structs.replace(columns, **{key: said})
    table = read_table(path, layout.said_names or _COLUMNS)
    layout = msgspec.structs.replace(layout, triad=key)
    return to_recordings(table, mapped, layout, name=path.name)
