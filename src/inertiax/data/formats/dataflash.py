"""ArduPilot's dataflash `.bin`: the `IMU` messages, with their temperature.

Each IMU of the log is a device of its own, named `imu0`, `imu1`, …; `[recordings] instance` reads one alone
(ArduPilot's `I`, from 0). The messages hold values after the corrections that were active (INS_ACCOFFS, INS_TCAL, …),
which the log's parameters tell (`dataflash_corrections`): they are taken away again.

The compass `MAG` (mgauss), the barometer `BARO` and the battery's current in `BAT` come with the IMU of the same
number, in the rows nearest to their samples. The compass' offsets that the message names, and its matrix, are taken
away likewise.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np
import polars as pl

from ..recording import Recording, restated
from .columns import AS_FOUND, AXES, ColumnMap, Layout, shown
from .dataflash_corrections import field_uncorrected, PARAMETERS, Parameters, uncorrected
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
    tables, parameters, of_compass = _tables(path)
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
        label = f"{path.name} IMU[{i}]"
        table, undone, doubts = uncorrected(tables[i], parameters, i)
        notes = _notes(label, parameters, (*undone, *of_compass.get(i, ())))
        if len(instances) > 1 and columns.device is None:
            table = table.with_columns(pl.lit(f"imu{i}").alias("device"))
        doubts = tuple(f"{label}: {doubt}" for doubt in doubts)
        read = to_recordings(table, columns, layout, name=label)
        recordings += [restated(recording, notes=notes, reservations=doubts) for recording in read]
    return tuple(recordings)


def _notes(label: str, parameters: Parameters, undone: tuple[str, ...]) -> tuple[str, ...]:
    """What became of the corrections that ArduPilot made, in words."""
    if not parameters:
        return (
            f"{label}: the log has no parameters (PARM): its values are taken for uncorrected ones.",
        )
    if not undone:
        return ()
    return (
        f"{label}: its values are after {', '.join(undone)} (PARM), which are taken away again: the outputs are the "
        "sensors' own.",
    )


class _Log(NamedTuple):
    """What of a log is read."""

    tables: dict[int, pl.DataFrame]  # time, accel, gyro and perhaps temperature, in SI, of each IMU
    parameters: Parameters
    of_compass: dict[
        int, tuple[str, ...]
    ]  # parameters that were taken away from that of the number


def _tables(path: Path) -> _Log:
    """The IMUs of a log, with the slower sensors beside each. Raises `ValueError` where it is damaged, or none."""
    content = path.read_bytes()
    if not content.startswith(MAGIC):
        text = not any(b < 9 for b in content[:4096])
        cure = "; it looks like text: rename it to .txt" if text else ""
        raise ValueError(
            f"{path.name}: not a dataflash log: it does not begin with its header{cure}."
        )
    try:
        found = messages(content, (*_NAMES, *_COMPASSES, *_BAROMETERS, _BATTERY, PARAMETERS))
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
    parameters = Parameters(found, _STAMPS)
    slower, of_compass = _slower(found, path.name, parameters)
    tables = {i: _with_slower(table, i, slower) for i, table in tables.items()}
    return _Log(tables, parameters, of_compass)


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
    found: list[tuple[str, dict[str, np.ndarray]]], where: str, parameters: Parameters
) -> tuple[dict[tuple[str, int], tuple[np.ndarray, np.ndarray]], dict[int, tuple[str, ...]]]:
    """Stamps (s) and values of compass (T), barometer (Pa) and current (A), by sensor and number; and the parameters
    that were taken away from each compass."""
    made: dict[tuple[str, int], tuple[np.ndarray, np.ndarray]] = {}
    undone: dict[int, tuple[str, ...]] = {}
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
        number = _instances(name, fields, names)
        for i in map(int, np.unique(number)):
            mine = number == i
            time, own = _STAMPS[stamp] * fields[stamp][mine], values[mine]
            if kind == "mag":
                told = {f: v[mine] for f, v in fields.items()}
                own, undone[i] = _field(told, own, time, parameters, i)
            made.setdefault((kind, i), (time, own))
    return made, undone


def _field(
    fields: dict[str, np.ndarray],
    values: np.ndarray,
    time: np.ndarray,
    parameters: Parameters,
    instance: int,
) -> tuple[np.ndarray, tuple[str, ...]]:
    """A compass' own output, T: the current's part was added last, the offsets first; and what was taken away."""

    def told(name: str) -> np.ndarray:
        own = [f"{name}{a.upper()}" for a in AXES]
        if not all(o in fields for o in own):
            return np.zeros_like(values)
        return np.stack([fields[o].astype(float) for o in own], axis=1)

    found, names = field_uncorrected(values - told("MO"), time, parameters, instance)
    return _MGAUSS * (found - told("Ofs")), names


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
