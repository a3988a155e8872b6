"""ArduPilot's dataflash `.bin`: the `IMU` messages, with their temperature.

Each IMU of the log is a device of its own, named `imu0`, `imu1`, …; `[recordings] instance` reads one alone
(ArduPilot's `I`, from 0). The messages hold values after the corrections that were active (INS_ACCOFFS,
INS_TCAL, …); for raw ones these must have been off.
"""

from pathlib import Path

import numpy as np
import polars as pl

from ..recording import Recording
from .columns import AS_FOUND, AXES, ColumnMap, Layout, shown
from .dataflash_messages import HEAD, messages
from .table import to_recordings


NAME = "dataflash"
SUFFIXES = (".bin",)
KEYS = ("instance",)
MAGIC = HEAD + b"\x80"
_FIELDS = tuple(f"Acc{a.upper()}" for a in AXES) + tuple(f"Gyr{a.upper()}" for a in AXES)
_COLUMNS = tuple(f"{triad}_{a}" for triad in ("accel", "gyro") for a in AXES)
_NAMES = ("IMU", "IMU2", "IMU3")  # older logs number the message instead of a field `I`
_PROBES = ("T", "Temp")
_STAMPS = {"TimeUS": 1e-6, "TimeMS": 1e-3}  # s; milliseconds before ArduPilot 3.3 (2015)


def read(path: Path, columns: ColumnMap, layout: Layout = AS_FOUND) -> tuple[Recording, ...]:
    """Recordings in a dataflash log, one per IMU. Raises `ValueError` naming file and field."""
    tables = _tables(path)
    if not tables:
        raise ValueError(
            f"{path.name}: no IMU messages in the log; switch IMU logging on (LOG_BITMASK)."
        )
    instances = sorted(tables)
    if layout.instance is not None:
        if layout.instance not in tables:
            raise ValueError(
                f"{path.name}: instance {layout.instance} of IMU is missing; the log has {instances}."
            )
        instances = [layout.instance]
    recordings: list[Recording] = []
    for i in instances:
        table = tables[i]
        if len(instances) > 1 and columns.device is None:
            table = table.with_columns(pl.lit(f"imu{i}").alias("device"))
        recordings += to_recordings(table, columns, layout, name=f"{path.name} IMU[{i}]")
    return tuple(recordings)


def _tables(path: Path) -> dict[int, pl.DataFrame]:
    """Time, accel, gyro and perhaps temperature, in SI, of each IMU."""
    content = path.read_bytes()
    if not content.startswith(MAGIC):
        raise ValueError(f"{path.name}: not a dataflash log: it does not begin with its header.")
    try:
        found = messages(content, _NAMES)
    except ValueError as error:
        raise ValueError(f"{path.name}: the dataflash log is damaged: {error}.") from None
    tables: dict[int, pl.DataFrame] = {}
    for name, fields in found:
        for i, table in _by_instance(name, fields, path.name).items():
            if i in tables and tables[i].columns != table.columns:
                raise ValueError(
                    f"{path.name}: only some messages of IMU[{i}] have a temperature; cut the log where "
                    "its messages change."
                )
            tables[i] = pl.concat([tables[i], table]) if i in tables else table
    return tables


def _by_instance(name: str, fields: dict[str, np.ndarray], where: str) -> dict[int, pl.DataFrame]:
    probe = [p for p in _PROBES if p in fields][:1]
    stamp = next((t for t in _STAMPS if t in fields), "TimeUS")
    for field in (stamp, *_FIELDS):
        if field not in fields:
            raise ValueError(
                f"{where}: field '{field}' is missing in {name}; it has {shown(fields)}."
            )
    for field in (stamp, *_FIELDS, *probe, *(["I"] if "I" in fields else [])):
        if fields[field].dtype.kind not in "fiu":
            raise ValueError(f"{where}: field '{field}' of {name} holds no numbers.")
    columns = {"time": _STAMPS[stamp] * fields[stamp]}
    columns |= {c: fields[f].astype(float) for c, f in zip(_COLUMNS, _FIELDS, strict=True)}
    if probe:
        columns["temperature"] = fields[probe[0]].astype(float)
    table = pl.DataFrame(columns)
    if "I" not in fields:
        return {_NAMES.index(name): table}
    instance = fields["I"].astype(int)
    return {int(i): table.filter(pl.Series(instance == i)) for i in np.unique(instance)}
