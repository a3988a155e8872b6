"""Bags of ROS 1 and ROS 2 and MCAP, written by rosbags, become the same recording."""

import numpy as np
import pytest

from inertiax.data.formats import Layout, read_recordings
from readers_cases import campaign, check, made_up, refusal


pytest.importorskip("rosbags", reason="rosbags is not installed (inertiax[ros])")

from rosbags.rosbag1 import Writer as Writer1  # noqa: E402
from rosbags.rosbag2 import StoragePlugin, Writer as Writer2  # noqa: E402
from rosbags.typesys import get_typestore, Stores  # noqa: E402


IMU, TEMPERATURE = "sensor_msgs/msg/Imu", "sensor_msgs/msg/Temperature"
KINDS = ["ros1", "sqlite3", "mcap"]
RECEIVED = 15_000_000_000  # ns, when the first message arrived: 5 s after its own stamp


def header(types, kind, stamp):
    time = types["builtin_interfaces/msg/Time"](stamp // 10**9, stamp % 10**9)
    more = {"seq": 0} if kind == "ros1" else {}
    return types["std_msgs/msg/Header"](stamp=time, frame_id="imu", **more)


def imu_message(types, kind, stamp, accel, gyro, absent=()):
    vector, quaternion = types["geometry_msgs/msg/Vector3"], types["geometry_msgs/msg/Quaternion"]
    none, known = np.array([-1.0] + 8 * [0.0]), np.zeros(9)
    return types[IMU](
        header=header(types, kind, stamp),
        orientation=quaternion(0.0, 0.0, 0.0, 1.0),
        orientation_covariance=none,
        angular_velocity=vector(*gyro),
        angular_velocity_covariance=none if "gyro" in absent else known,
        linear_acceleration=vector(*accel),
        linear_acceleration_covariance=none if "accel" in absent else known,
    )


def bag(path, kind, data, *, topics=("/imu0",), probe=True, stamped=True, absent=()):
    """A bag with one IMU topic or several and a probe at a tenth of the rate."""
    store = get_typestore(Stores.ROS1_NOETIC if kind == "ros1" else Stores.ROS2_HUMBLE)
    types = store.types
    serialize = store.serialize_ros1 if kind == "ros1" else store.serialize_cdr
    plugin = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
    writer = Writer1(path) if kind == "ros1" else Writer2(path, version=9, storage_plugin=plugin)
    stamps = (1e9 * data["time"]).round().astype(int).tolist()
    with writer:
        connections = [writer.add_connection(t, IMU, typestore=store) for t in topics]
        heat = writer.add_connection("/probe", TEMPERATURE, typestore=store) if probe else None
        for k, stamp in enumerate(stamps):
            own = stamp if stamped else 0
            message = imu_message(types, kind, own, data["accel"][k], data["gyro"][k], absent)
            received = RECEIVED + k * 5_000_000
            for c in connections:
                writer.write(c, received, serialize(message, IMU))
            if heat is not None and (k % 10 == 0 or k == len(stamps) - 1):
                t = types[TEMPERATURE](header(types, kind, stamp), data["temperature"][k], 0.0)
                writer.write(heat, received, serialize(t, TEMPERATURE))


@pytest.mark.parametrize("kind", KINDS)
def test_bags_are_read_from_a_campaign(tmp_path, kind):
    data = made_up()
    name = "a.bag" if kind == "ros1" else "run"
    bag(tmp_path / name, kind, data)
    (recording,) = campaign(tmp_path, [name], 'temperature_topic = "/probe"')
    # The probe moves on a straight line, so a tenth of its readings say all.
    check(recording, data, rtol=1e-12)


def test_a_lone_mcap_file_is_read(tmp_path):
    data = made_up()
    bag(tmp_path / "run", "mcap", data)
    (file,) = (tmp_path / "run").glob("*.mcap")
    (recording,) = read_recordings(file)
    check(recording, data | {"temperature": None})


def test_the_topic_is_chosen_where_there_are_several(tmp_path):
    data = made_up()
    bag(tmp_path / "run", "mcap", data, topics=("/imu0", "/imu1"))
    said = refusal(read_recordings, tmp_path / "run")
    assert said == (
        "run: 2 topics of type sensor_msgs/Imu (/imu0, /imu1); choose one with [recordings] topic."
    )
    (recording,) = campaign(tmp_path, ["run"], 'topic = "/imu1"')
    check(recording, data | {"temperature": None})


def test_a_triad_that_ros_calls_absent_is_absent(tmp_path):
    data = made_up()
    bag(tmp_path / "a.bag", "ros1", data, absent=("gyro",))
    (recording,) = read_recordings(tmp_path / "a.bag")
    assert recording.gyro is None
    np.testing.assert_array_equal(recording.accel, data["accel"])


def test_reception_stamps_are_used_where_messages_have_none(tmp_path):
    data = made_up()
    bag(tmp_path / "run", "sqlite3", data, stamped=False)
    (recording,) = read_recordings(tmp_path / "run")
    np.testing.assert_allclose(recording.time, data["time"] + 5.0, rtol=1e-15)


@pytest.mark.parametrize("kind", KINDS)
def test_bad_bags_are_refused_in_one_line(tmp_path, kind):
    data = made_up()
    path = tmp_path / ("a.bag" if kind == "ros1" else "run")
    bag(path, kind, data)
    say = lambda **k: refusal(read_recordings, path, layout=Layout(**k))
    name = path.name
    assert say(topic="/imu") == (
        f"{name}: topic '/imu' of type sensor_msgs/Imu is missing; did you mean '/imu0'? the bag has "
        "['/imu0']."
    )
    assert say(topic="/probe").startswith(
        f"{name}: topic '/probe' of type sensor_msgs/Imu is missing"
    )
    assert "temperature_topic" not in say(topic="/imu") and "/nothing" in say(
        temperature_topic="/nothing"
    )
    assert "instance is for ulog, dataflash" in say(instance=1)
    stored = path if kind == "ros1" else next(p for p in path.iterdir() if p.suffix != ".yaml")
    whole = stored.read_bytes()
    for part in (whole[: len(whole) // 2], whole[:40]):
        stored.write_bytes(part)
        assert "damaged or cut off" in say()


def test_bags_without_an_imu_say_what_they_have(tmp_path):
    bag(tmp_path / "a.bag", "ros1", made_up(), topics=())
    assert refusal(read_recordings, tmp_path / "a.bag") == (
        "a.bag: no topics of type sensor_msgs/Imu; the bag has ['/probe (sensor_msgs/Temperature)']."
    )


def test_wrong_samples_in_a_bag_are_refused_in_one_line(tmp_path):
    data = made_up()
    bag(tmp_path / "a.bag", "ros1", data | {"time": data["time"][::-1]})
    message = refusal(read_recordings, tmp_path / "a.bag")
    assert message.startswith("a.bag /imu0: time must increase strictly")
    bad = np.where(np.arange(400)[:, None] == 5, np.nan, data["gyro"])
    bag(tmp_path / "b.bag", "ros1", data | {"gyro": bad})
    assert "first in row 5" in refusal(read_recordings, tmp_path / "b.bag")


def test_missing_library_names_the_extra(tmp_path, monkeypatch):
    import sys

    bag(tmp_path / "a.bag", "ros1", made_up())
    monkeypatch.setitem(sys.modules, "rosbags.rosbag1", None)
    assert refusal(read_recordings, tmp_path / "a.bag") == (
        "a.bag: reading it needs the library rosbags; install inertiax[ros]."
    )
