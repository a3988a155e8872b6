"""ArduPilot's dataflash `.bin`, through pymavlink: the `IMU` messages, with their temperature.

Each IMU of the log is a device of its own, named `imu0`, `imu1`, …; `[recordings] instance` reads one alone
(ArduPilot's `I`, from 0). The messages hold values after the corrections that were active (INS_ACCOFFS,
INS_TCAL, …); for raw ones these must have been off.
"""

import contextlib
import io
import os
from collections.abc import Iterator
from pathlib import Path

import polars as pl

from ..recordings import Recording
from .columns import AS_FOUND, AXES, ColumnMap, Layout
from .optional import load
from .table import to_recordings


NAME = "dataflash"
SUFFIXES = (".bin",)
KEYS = ("instance",)
MAGIC = b"\xa3\x95\x80"
_FIELDS = tuple(f"Acc{a.upper()}" for a in AXES) + tuple(f"Gyr{a.upper()}" for a in AXES)
_NAMES = ("IMU", "IMU2", "IMU3")  # older logs number the message instead of a field `I`


def read(path: Path, columns: ColumnMap, layout: Layout = AS_FOUND) -> tuple[Recording, ...]:
    """Recordings in a dataflash log, one per IMU. Raises `ValueError` naming file and field."""
    rows = _messages(path)
    if not rows:
        raise ValueError(
            f"{path.name}: no IMU messages in the log; switch IMU logging on (LOG_BITMASK)."
        )
    instances = sorted(rows)
    if layout.instance is not None:
        if layout.instance not in rows:
            raise ValueError(
                f"{path.name}: instance {layout.instance} of IMU is missing; the log has {instances}."
            )
        instances = [layout.instance]
    recordings: list[Recording] = []
    for i in instances:
        table = pl.DataFrame(rows[i], schema=_schema(rows[i]), orient="row")
        if len(instances) > 1 and columns.device is None:
            table = table.with_columns(pl.lit(f"imu{i}").alias("device"))
        recordings += to_recordings(table, columns, layout, name=f"{path.name} IMU[{i}]")
    return tuple(recordings)


def _schema(rows: list[tuple[float, ...]]) -> list[str]:
    names = ["time", *(f"{t}_{a}" for t in ("accel", "gyro") for a in AXES), "temperature"]
    return names[: len(rows[0])]


def _messages(path: Path) -> dict[int, list[tuple[float, ...]]]:
    """Rows (time, accel, gyro[, temperature]) in SI of each IMU."""
    reader = load("pymavlink.DFReader", "ardupilot", path)
    with path.open("rb") as file:
        head = file.read(len(MAGIC))
    if head != MAGIC:
        raise ValueError(f"{path.name}: not a dataflash log: it does not begin with its header.")
    said = io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said), _plain_index():
        # Made in two steps, so that what a beginning that fails has opened is closed.
        log = object.__new__(reader.DFReader_binary)
        try:
            log.__init__(str(path))
            # pymavlink meets a damaged file with whatever its parsing runs into (struct.error,
            # ValueError, IndexError, KeyError, UnicodeDecodeError, OverflowError), and promises none of it.
            return _collect(log)
        except _Refused as error:
            raise ValueError(f"{path.name}: {error}") from None
        except Exception as error:
            raise _damaged(path, error) from None
        finally:
            for opened in ("data_map", "filehandle"):
                if hasattr(log, opened):
                    getattr(log, opened).close()


class _Refused(Exception):
    """What is wrong with the messages of a log that can be read."""


def _damaged(path: Path, error: Exception) -> ValueError:
    reason = " ".join(f"{type(error).__name__} {error}".split())
    return ValueError(f"{path.name}: the dataflash log is damaged: {reason[:200]}.")


@contextlib.contextmanager
def _plain_index() -> Iterator[None]:
    """pymavlink's index in Python: the one in C tells every damaged byte past `redirect_stderr`."""
    before = os.environ.get("PYMAVLINK_FAST_INDEX")
    os.environ["PYMAVLINK_FAST_INDEX"] = "0"
    try:
        yield
    finally:
        if before is None:
            del os.environ["PYMAVLINK_FAST_INDEX"]
        else:
            os.environ["PYMAVLINK_FAST_INDEX"] = before


def _collect(log) -> dict[int, list[tuple[float, ...]]]:
    rows: dict[int, list[tuple[float, ...]]] = {}
    while True:
        message = log.recv_match(type=set(_NAMES))
        if message is None:
            return rows
        name = message.get_type()
        fields = message.to_dict()
        for field in ("TimeUS", *_FIELDS):
            if field not in fields:
                raise _Refused(f"field '{field}' is missing in {name}; it has {[*fields][:20]}.")
        kept = {k: fields[k] for k in ("TimeUS", *_FIELDS, "I", "T", "Temp") if k in fields}
        text = [k for k, v in kept.items() if not isinstance(v, int | float)]
        if text:
            raise _Refused(f"field '{text[0]}' of {name} holds no number.")
        instance = int(kept.get("I", _NAMES.index(name)))
        probe = [float(kept[k]) for k in ("T", "Temp") if k in kept][:1]
        values = (1e-6 * kept["TimeUS"], *(float(kept[f]) for f in _FIELDS), *probe)
        mine = rows.setdefault(instance, [])
        if mine and len(mine[0]) != len(values):
            raise _Refused(f"only some messages of IMU[{instance}] have a temperature.")
        mine.append(values)
