"""ROS 1 and ROS 2 bags and MCAP, through rosbags: `sensor_msgs/Imu`, no ROS needed.

A `.bag` file, a ROS 2 bag folder (`metadata.yaml` with `.db3` or `.mcap`) or such a file alone.
`[recordings] topic` names the IMU's topic where there are several, `temperature_topic` a
`sensor_msgs/Temperature` that is put onto its stamps. Stamps are the message's own (`header.stamp`), or
those of reception where it has none. A triad whose covariance begins with −1 is absent, as ROS says.

Only these two message types are decoded, by the library's own definitions and never by those in a bag.
"""

import contextlib
import functools
import importlib
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from ..recording import Recording
from .columns import AS_FOUND, AXES, ColumnMap, Layout, nearest, shown
from .optional import load
from .ros_chunks import bounded
from .streams import onto
from .table import to_recordings


NAME = "ros"
SUFFIXES = (".bag", ".mcap", ".db3")
KEYS = ("topic", "temperature_topic")
MAGICS = (b"#ROSBAG V2.0", b"\x89MCAP0\r\n", b"SQLite format 3\0")
_IMU, _TEMPERATURE = "sensor_msgs/msg/Imu", "sensor_msgs/msg/Temperature"
_IN_A_COMMAND = re.compile(r"[\w ./-]+")  # what needs no care between quotes
# The IMU's message in a field of one of its own type, as columns.
_COMMAND = (
    "; write the field '{field}' of {topic} as columns: "
    'python -c "from pathlib import Path; from rosbags.highlevel import AnyReader; '
    "r = AnyReader([Path('{bag}')]); r.open(); print('time,accel_x,accel_y,accel_z,gyro_x,gyro_y,gyro_z'); "
    "[print(m.header.stamp.sec + m.header.stamp.nanosec / 1e9, "
    "*(getattr(v, a) for v in (m.linear_acceleration, m.angular_velocity) for a in 'xyz'), sep=',') "
    "for c, t, raw in r.messages([c for c in r.connections if c.topic == '{topic}']) "
    'for m in [r.deserialize(raw, c.msgtype).{field}]]" > imu.csv'
)

# Bags of ROS 2 before Iron hold no definitions of messages; who recorded them has these.
_UNTOLD = (
    "; the bag does not hold what these types are: in a shell that knows them, `ros2 topic echo --csv {topic} > "
    "imu.csv` beside `ros2 bag play '{bag}'` writes text, whose columns are to be named time, accel_x to _z (m/s^2) "
    "and gyro_x to _z (rad/s)"
)


def is_bag(folder: Path) -> bool:
    """Whether a folder is a ROS 2 bag."""
    return (folder / "metadata.yaml").is_file()


def read(path: Path, columns: ColumnMap, layout: Layout = AS_FOUND) -> tuple[Recording, ...]:
    """The recording of one topic. Raises `ValueError` naming file, topic and what is wrong."""
    with _opened(path) as (reader, one):
        topic = _topic(reader, layout.topic, _IMU, "topic", path.name)
        imu = _messages(reader, topic, _IMU, one, path)
        probe = None
        if layout.temperature_topic is not None:
            said = layout.temperature_topic
            chosen = _topic(reader, said, _TEMPERATURE, "temperature_topic", path.name)
            probe = _messages(reader, chosen, _TEMPERATURE, one, path)
    label = f"{path.name} {topic}"
    return to_recordings(_table(imu, probe, label), columns, layout, name=label)


def topics(path: Path) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Names of a bag's topics of IMUs and of temperatures. Raises `ValueError` where it is damaged or has no IMU."""
    with _opened(path) as (reader, _):
        imus, probes = (_topics(reader, kind) for kind in (_IMU, _TEMPERATURE))
        if not imus:
            _topic(reader, None, _IMU, "topic", path.name)
        return tuple(imus), tuple(probes)


@contextlib.contextmanager
def _opened(path: Path) -> Iterator[tuple[Any, bool]]:
    """A reader of the bag, and whether it is one of ROS 1."""
    rosbag1 = load("rosbags.rosbag1", "ros", path)
    rosbag2 = load("rosbags.rosbag2", "ros", path)
    one = path.suffix == ".bag" and not path.is_dir()
    kind = rosbag1.Reader if one else rosbag2.Reader
    with bounded():
        try:
            reader = kind(path)
            reader.open()
        # rosbags meets a damaged file with whatever its parsing runs into: its own ReaderError, and those of
        # sqlite3, struct, YAML, zstandard and lz4, AssertionError, KeyError, IndexError.
        except Exception as error:
            raise _damaged(path, error) from None
        try:
            yield reader, one
        finally:
            reader.close()


def _topics(reader: Any, kind: str) -> list[str]:
    return sorted({c.topic for c in reader.connections if c.msgtype == kind})


def _damaged(path: Path, error: Exception) -> ValueError:
    reason = (str(error).splitlines() or [type(error).__name__])[0].rstrip(".")
    cure = (
        "mcap recover"
        if path.suffix == ".mcap"
        else "rosbag reindex (ROS 1), ros2 bag reindex (ROS 2)"
    )
    return ValueError(
        f"{path.name}: the bag is damaged or cut off: {reason[:200]}. What is whole in it comes back with: {cure}."
    )


def _topic(reader, asked: str | None, kind: str, key: str, where: str) -> str:
    found = _topics(reader, kind)
    plain = kind.replace("/msg/", "/")
    if asked is None:
        if len(found) != 1:
            raise ValueError(
                f"{where}: {len(found) or 'no'} topics of type {plain}"
                + (
                    f" ({', '.join(shown(found))}); choose one with [recordings] {key}."
                    if found
                    else f"; the bag has {_all(reader)}{_cure(reader, kind, where)}."
                )
            )
        return found[0]
    if asked not in found:
        raise ValueError(
            f"{where}: topic '{asked}' of type {plain} is missing; {nearest(asked, found)}the bag has "
            f"{shown(found) or _all(reader)}."
        )
    return asked


def _cure(reader, kind: str, where: str) -> str:
    """How messages of a type of its own that hold an IMU's come into columns: by the definition in the bag, which the
    user's command follows and this reader does not."""
    if kind != _IMU:
        return ""
    for connection in reader.connections:
        definition = str(getattr(connection.msgdef, "data", "")).partition("\n====")[0]
        field = re.search(
            r"^\s*sensor_msgs/(?:msg/)?Imu\s+(\w+)\s*(?:#|$)", definition, re.MULTILINE
        )
        if field is not None and _IN_A_COMMAND.fullmatch(f"{where}{connection.topic}"):
            return _COMMAND.format(field=field[1], topic=connection.topic, bag=where)
    foreign = [c for c in reader.connections if c.msgtype not in _types(True).fielddefs]
    if not foreign:
        return ""  # no type of its own, in which an IMU's could be
    untold = [c.topic for c in foreign if not str(getattr(c.msgdef, "data", "")).strip()]
    likely = sorted(untold, key=lambda topic: "imu" not in topic.lower())[:1]
    if likely and _IN_A_COMMAND.fullmatch(f"{where}{likely[0]}"):
        return _UNTOLD.format(topic=likely[0], bag=where)
    return (
        "; write accelerations (m/s^2) and rates (rad/s) as text: time, accel_x to _z, gyro_x to _z"
    )


def _all(reader) -> list[str]:
    return shown(
        sorted({f"{c.topic} ({c.msgtype.replace('/msg/', '/')})" for c in reader.connections})
    )


def _messages(reader, topic: str, kind: str, one: bool, path: Path) -> list:
    """(stamp in ns, message) of each message of a topic, decoded by the library's definitions."""
    load("rosbags.typesys", "ros", path)
    store = _types(one)
    decode = store.deserialize_ros1 if one else store.deserialize_cdr
    connections = [c for c in reader.connections if c.topic == topic]
    messages = []
    try:
        for _, received, raw in reader.messages(connections=connections):
            message = decode(raw, kind)
            stamp = message.header.stamp
            own = stamp.sec * 1_000_000_000 + stamp.nanosec
            messages.append((own or received, message))
    # As above, and what decoding runs into where lengths in the message are wrong.
    except Exception as error:
        raise _damaged(path, error) from None
    if not messages:
        raise ValueError(f"{path.name}: topic '{topic}' has no messages.")
    return messages


@functools.cache
def _types(one: bool):
    """The library's own definitions of ROS 1 or 2; making them takes longer than a small bag."""
    systems = importlib.import_module("rosbags.typesys")
    return systems.get_typestore(systems.Stores.ROS1_NOETIC if one else systems.Stores.ROS2_HUMBLE)


def _table(imu: list, probe: list | None, where: str) -> pl.DataFrame:
    time = np.array([stamp for stamp, _ in imu], np.int64) / 1e9
    first = imu[0][1]
    columns: dict[str, np.ndarray] = {"time": time}
    for key, field in (("accel", "linear_acceleration"), ("gyro", "angular_velocity")):
        if getattr(first, f"{field}_covariance")[0] == -1:
            continue
        vectors = [getattr(m, field) for _, m in imu]
        columns |= {f"{key}_{a}": np.array([getattr(v, a) for v in vectors]) for a in AXES}
    if probe is not None:
        stamps = np.array([stamp for stamp, _ in probe], np.int64) / 1e9
        values = np.array([m.temperature for _, m in probe])[:, None]
        columns["temperature"] = onto(time, stamps, values, f"{where}, temperature")[:, 0]
    return pl.DataFrame(columns)
