"""ArduPilot's dataflash `.bin`: the `IMU` messages, with their temperature.

Each IMU of the log is a device of its own, named `imu0`, `imu1`, …; `[recordings] instance` reads one alone
(ArduPilot's `I`, from 0). The messages hold values after the corrections that were active (INS_ACCOFFS,
INS_TCAL, …); for raw ones these must have been off.

The compass `MAG` (mgauss), the barometer `BARO` and the battery's current in `BAT` come with the IMU of the same
number, in the rows nearest to their samples. The compass' offsets that the message names are taken away again.
"""

from pathlib import Path

import numpy as np
import polars as pl

from ..recording import Recording
from .columns import AS_FOUND, AXES, ColumnMap, Layout, shown
from .dataflash_messages import HEAD, messages
from .streams import placed
from .table import to_recordings


NAME = "dataflash"
SUFFIXES = (".bin",)
KEYS = ("instance",)
MAGIC = HEAD + b"\x80"
_FIELDS = tuple(f"Acc{a.upper()}" for a in AXES) + tuple(f"Gyr{a.upper()}" for a in AXES)
_COLUMNS = tuple(f"{triad}_{a}" for triad in ("accel", "gyro") for a in AXES)
_NAMES = ("IMU", "IMU2", "IMU3")  # older logs number the message instead of a field `I`
_COMPASSES, _BAROMETERS = ("MAG", "MAG2", "MAG3"), ("BARO", "BAR2", "BAR3")
_BATTERY = "BAT"
_MGAUSS = 1e-7  # T
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
        text = not any(b < 9 for b in content[:4096])
        cure = "; it looks like text: rename it to .txt" if text else ""
        raise ValueError(
            f"{path.name}: not a dataflash log: it does not begin with its header{cure}."
        )
    try:
        found = messages(content, (*_NAMES, *_COMPASSES, *_BAROMETERS, _BATTERY))
    except ValueError as error:
        raise ValueError(f"{path.name}: the dataflash log is damaged: {error}.") from None
    tables: dict[int, pl.DataFrame] = {}
    for name, fields in found:
        if name not in _NAMES:
            continue
        for i, table in _by_instance(name, fields, path.name).items():
            if i in tables and tables[i].columns != table.columns:
                raise ValueError(
                    f"{path.name}: only some messages of IMU[{i}] have a temperature; cut the log where "
                    "its messages change."
                )
            tables[i] = pl.concat([tables[i], table]) if i in tables else table
    slower = _slower(found, path.name)
    return {i: _with_slower(table, i, slower) for i, table in tables.items()}


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
    number = _instances(name, fields, _NAMES)
    return {int(i): table.filter(pl.Series(number == i)) for i in np.unique(number)}


def _instances(name: str, fields: dict[str, np.ndarray], names: tuple[str, ...]) -> np.ndarray:
    """Which sensor each message is of."""
    if "I" in fields:
        return fields["I"].astype(int)
    count = len(next(iter(fields.values())))
    return np.full(count, names.index(name))


def _slower(
    found: list[tuple[str, dict[str, np.ndarray]]], where: str
) -> dict[tuple[str, int], tuple[np.ndarray, np.ndarray]]:
    """Stamps (s) and values of compass (T), barometer (Pa) and current (A), by sensor and number."""
    made: dict[tuple[str, int], tuple[np.ndarray, np.ndarray]] = {}
    for name, fields in found:
        if name in _COMPASSES:
            kind, names, wanted = "mag", _COMPASSES, tuple(f"Mag{a.upper()}" for a in AXES)
        elif name in _BAROMETERS:
            kind, names, wanted = "pressure", _BAROMETERS, ("Press",)
        elif name == _BATTERY:
            kind, names, wanted = "current", (_BATTERY,), ("Curr",)
        else:
            continue
        stamp = next((t for t in _STAMPS if t in fields), None)
        if stamp is None or any(
            f not in fields or fields[f].dtype.kind not in "fiu" for f in wanted
        ):
            raise ValueError(
                f"{where}: {name} has {shown(fields)}; a stamp and {', '.join(wanted)} are needed."
            )
        values = np.stack([fields[f].astype(float) for f in wanted], axis=1)
        if kind == "mag":
            for offset in ("Ofs", "MO"):  # of the sensor, and of the motors' current
                own = [f"{offset}{a.upper()}" for a in AXES]
                if all(o in fields for o in own):
                    values = values - np.stack([fields[o].astype(float) for o in own], axis=1)
            values = _MGAUSS * values
        number = _instances(name, fields, names)
        for i in np.unique(number):
            mine = number == i
            made.setdefault((kind, int(i)), (_STAMPS[stamp] * fields[stamp][mine], values[mine]))
    return made


def _with_slower(
    table: pl.DataFrame,
    instance: int,
    slower: dict[tuple[str, int], tuple[np.ndarray, np.ndarray]],
) -> pl.DataFrame:
    """One IMU's table with the slower sensors of its number."""
    time, added = table["time"].to_numpy(), []
    for kind, number in (("mag", instance), ("pressure", instance), ("current", 0)):
        if (kind, number) not in slower or (kind == "current" and ("mag", instance) not in slower):
            continue
        rows = placed(time, *slower[kind, number])
        names = [f"mag_{a}" for a in AXES] if kind == "mag" else [kind]
        if not np.isnan(rows).all():
            added += [pl.Series(n, rows[:, k]) for k, n in enumerate(names)]
    return table.with_columns(added)
