"""PX4's ULog, through pyulog: the raw `sensor_accel` and `sensor_gyro`, with their temperature.

The magnetometer `sensor_mag` (gauss), the barometer `sensor_baro` and the battery's current come with the IMU of the
same number, in the rows nearest to their samples.

Each instance (IMU) of the log is a device of its own, named `imu0`, `imu1`, …; `[recordings] instance`
reads one alone. The gyros are put onto the accelerometers' stamps by straight lines where their stamps
differ. `[recordings] topic = "sensor_combined"` reads what PX4 has corrected instead; where the log states such
corrections the recordings say so (`ulog_corrections`).
"""

import contextlib
import io
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import polars as pl

from ..recording import Recording, restated
from .columns import AS_FOUND, AXES, ColumnMap, Layout, shown
from .optional import load
from .streams import onto, placed, shared
from .table import to_recordings
from .ulog_corrections import doubt_about


NAME = "ulog"
SUFFIXES = (".ulg", ".ulog")
KEYS = ("topic", "instance")
MAGIC = b"ULog\x01\x12\x35"
_TOPICS = ("sensor_accel", "sensor_gyro", "sensor_combined")
_SLOWER = ("sensor_mag", "sensor_baro", "battery_status")
_GAUSS = 1e-4  # T
_HEAD = 4 << 20  # bytes: definitions, parameters and the first rows of every topic
_MBAR = 100.0  # Pa
_MOST_MBAR = 2000.0  # no air has so many; PX4 logged mbar before version 1.14, Pa since
_COMBINED = {"gyro": "gyro_rad[{}]", "accel": "accelerometer_m_s2[{}]"}


def read(path: Path, columns: ColumnMap, layout: Layout = AS_FOUND) -> tuple[Recording, ...]:
    """Recordings in a ULog, one per IMU. Raises `ValueError` naming file, topic and field."""
    topic = layout.topic or "sensor_accel"
    if topic not in _TOPICS:
        raise ValueError(
            f"{path.name}: topic '{topic}' is not read; one of {', '.join(_TOPICS)} is needed (a "
            "sensor_accel comes with its sensor_gyro)."
        )
    log = _log(path)
    data = _datasets(log)
    imus = sorted({name for name, _ in data} - set(_SLOWER))
    names = ("sensor_combined",) if topic == "sensor_combined" else _TOPICS[:2]
    instances = sorted({i for name, i in data if name in names})
    if not instances:
        other = "sensor_combined"
        cure = (
            f' [recordings] topic = "{other}" reads that, which PX4 has corrected.'
            if other in imus and topic != other
            else ""
        )
        raise ValueError(
            f"{path.name}: no topic {' or '.join(names)} in the log; it has "
            f"{imus or 'none of ' + str(_TOPICS)}. Log raw sensor "
            f"topics (SDLOG_PROFILE, sensor comparison).{cure}"
        )
    if layout.instance is not None:
        if layout.instance not in instances:
            raise ValueError(
                f"{path.name}: instance {layout.instance} of {names[0]} is missing; the log has "
                f"{instances}."
            )
        instances = [layout.instance]
    recordings: list[Recording] = []
    for i in instances:
        label = f"{path.name} {names[0]}[{i}]"
        table = _table({name: data.get((name, i)) for name in names}, label)
        if topic != "sensor_combined":
            table = table.with_columns(_slower(data, i, table["time"].to_numpy(), path.name))
        if len(instances) > 1 and columns.device is None:
            table = table.with_columns(pl.lit(f"imu{i}").alias("device"))
        ids = {int(f["device_id"][0]) for (_, k), f in data.items() if k == i and _has_id(f)}
        release = log.msg_info_dict.get("ver_sw_release")
        release = release if isinstance(release, int) else None
        doubt = doubt_about(names[0], log.initial_parameters, release, ids)
        said = () if doubt is None else (f"{label}: {doubt}",)
        read = to_recordings(table, columns, layout, name=label)
        recordings += [restated(r, reservations=said) for r in read]
    return tuple(recordings)


def _has_id(fields: dict[str, np.ndarray]) -> bool:
    return "device_id" in fields and len(fields["device_id"]) > 0


def sensor_ids(path: Path) -> dict[int, dict[str, int]]:
    """PX4's numbers of each IMU's sensors, `device_id` of its topics: {0: {"accel_id": 1310988, …}, …}.

    The log's first rows tell them. Raises `ValueError` where the log cannot be read.
    """
    found: dict[int, dict[str, int]] = {}
    for (topic, instance), fields in _datasets(_log(path, most=_HEAD)).items():
        if _has_id(fields):
            key = f"{topic.removeprefix('sensor_')}_id"
            found.setdefault(instance, {})[key] = int(fields["device_id"][0])
    return found


def _datasets(log: Any) -> dict[tuple[str, int], dict[str, np.ndarray]]:
    """Topics of pyulog's log, by name and instance."""
    return {(d.name, d.multi_id): d.data for d in log.data_list}


def _log(path: Path, most: int | None = None) -> Any:
    """pyulog's log of a file; of its first `most` bytes alone, where that is given. Raises `ValueError` for none."""
    pyulog = load("pyulog", "px4", path)
    with path.open("rb") as file:
        if file.read(len(MAGIC)) != MAGIC:
            raise ValueError(f"{path.name}: not a ULog: it does not begin with ULog's header.")
    said = io.StringIO()  # pyulog prints what it meets
    with path.open("rb") as file, contextlib.redirect_stdout(said):
        try:
            whole = file if most is None else io.BytesIO(file.read(most))
            once = _Once(whole, path.stat().st_size)
            log = pyulog.ULog(once, message_name_filter_list=[*_TOPICS, *_SLOWER])
        # pyulog meets a damaged file with whatever its parsing runs into (struct.error,
        # TypeError, ValueError, IndexError, KeyError, UnicodeDecodeError), and promises none of it.
        except Exception as error:
            reason = " ".join(f"{type(error).__name__} {error}".split())[:200]
            raise ValueError(f"{path.name}: the ULog is damaged: {reason}.") from None
    if log.file_corruption and most is None:
        raise ValueError(f"{path.name}: the ULog has corrupt parts; download it again.")
    return log


class _Once:
    """A file that may be read about once: pyulog goes back in some damaged logs again and again."""

    def __init__(self, file: BinaryIO | io.BytesIO, size: int):
        self._file, self._left = file, 8 * size + 65536
        self.seek, self.tell, self.close = file.seek, file.tell, file.close

    def read(self, count: int) -> bytes:
        """The next bytes. Raises `EOFError` where far more were read than there are."""
        self._left -= count + 1
        if self._left < 0:
            raise EOFError("its parts point back at each other")
        return self._file.read(count)


def _table(data: dict[str, dict[str, np.ndarray] | None], where: str) -> pl.DataFrame:
    triads: dict[str, tuple[np.ndarray, np.ndarray]] = {}
    temperature = None
    for topic, fields in data.items():
        if fields is None:
            continue
        combined = topic == "sensor_combined"
        stamp = fields.get("timestamp_sample", fields.get("timestamp"))
        if combined or stamp is None or not np.any(stamp):
            stamp = _field(fields, "timestamp", where)
        time = stamp.astype(float) * 1e-6
        for key in ("gyro", "accel") if combined else (topic.removeprefix("sensor_"),):
            pattern = _COMBINED[key] if combined else "{}"
            columns = range(3) if combined else AXES
            values = [_field(fields, pattern.format(c), where) for c in columns]
            triads[key] = time, np.stack(values, axis=1).astype(float)
        if "temperature" in fields and not np.isnan(fields["temperature"]).all():
            # The accelerometers come first and their probe is the device's.
            temperature = temperature or (time, fields["temperature"].astype(float)[:, None])
    return _joined(triads, temperature, where)


def _slower(
    data: dict[tuple[str, int], dict[str, np.ndarray]], instance: int, time: np.ndarray, where: str
) -> list[pl.Series]:
    """Magnetometer (T), air pressure (Pa) and the battery's current (A) in an IMU's rows, where they were logged."""
    made: list[pl.Series] = []

    def add(topic: str, number: int, fields: tuple[str, ...], names: tuple[str, ...]) -> None:
        found = data.get((topic, number))
        if found is None:
            return
        label = f"{where} {topic}[{number}]"
        stamp = found.get("timestamp_sample", found.get("timestamp"))
        if stamp is None or not np.any(stamp):
            stamp = _field(found, "timestamp", label)
        values = np.stack([_field(found, f, label) for f in fields], axis=1).astype(float)
        if topic == "sensor_mag":
            values = _GAUSS * values
        elif topic == "sensor_baro" and np.nanmax(values, initial=0.0) < _MOST_MBAR:
            values = _MBAR * values
        rows = placed(time, stamp.astype(float) * 1e-6, values)
        if not np.isnan(rows).all():
            made.extend(pl.Series(n, rows[:, k]) for k, n in enumerate(names))

    add("sensor_mag", instance, AXES, tuple(f"mag_{a}" for a in AXES))
    add("sensor_baro", instance, ("pressure",), ("pressure",))
    if any(series.name == "mag_x" for series in made):
        add("battery_status", 0, ("current_a",), ("current",))
    return made


def _joined(
    triads: dict[str, tuple[np.ndarray, np.ndarray]],
    temperature: tuple[np.ndarray, np.ndarray] | None,
    where: str,
) -> pl.DataFrame:
    time = next(iter(triads.values()))[0]
    kept = slice(None)
    for other, _ in list(triads.values())[1:]:
        kept = shared(time, other, where)
    columns = {"time": time[kept]}
    streams = triads | ({"temperature": temperature} if temperature is not None else {})
    for key, (stamps, values) in streams.items():
        put = values[kept] if stamps is time else onto(time[kept], stamps, values, where)
        names = [key] if key == "temperature" else [f"{key}_{a}" for a in AXES]
        columns |= {n: put[:, k] for k, n in enumerate(names)}
    return pl.DataFrame(columns)


def _field(fields: dict[str, np.ndarray], name: str, where: str) -> np.ndarray:
    if name not in fields:
        raise ValueError(
            f"{where}: field '{name}' is missing; the topic has {shown(sorted(fields))}."
        )
    return fields[name]
