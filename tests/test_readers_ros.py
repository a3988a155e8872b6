"""Bags of ROS 1 and ROS 2 and MCAP, written by rosbags, become the same recording."""

import sqlite3
import subprocess
import sys

import numpy as np
import pytest

from inertiax.campaign_draft.pipeline import draft_campaign
from inertiax.data.formats import Layout, read_recordings
from readers_cases import campaign, check, made_up, refusal
from readers_data import bag


pytest.importorskip("rosbags", reason="rosbags is not installed (inertiax[ros])")

KINDS = ["ros1", "sqlite3", "mcap"]


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


@pytest.mark.parametrize("topics", [("/imu0",), ("/imu0", "/imu1")])
def test_a_draft_names_the_topics_that_must_be_named(tmp_path, topics):
    bag(tmp_path / "run", "mcap", made_up(), topics=topics)
    draft = draft_campaign(tmp_path / "run", tmp_path / "campaign", latitude=48.0)
    assert 'temperature_topic = "/probe"' in draft.text
    assert ("topic" in draft.untold) is (len(topics) == 2)
    assert ('\ntopic = "/imu0"' in draft.text) is (len(topics) == 2)


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
        "a.bag: reading it needs the library rosbags: pip install 'inertiax[ros]'."
    )


IMU_IN_A_FIELD = "std_msgs/Header header\nsensor_msgs/Imu imu\nstring raw"


def test_an_imu_in_a_field_of_a_message_of_its_own_comes_out_by_the_command(tmp_path):
    """VectorNav's drivers of many courses; `init` wrote a campaign that nothing could read, and ended with 0."""
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import get_types_from_msg, get_typestore, Stores

    store = get_typestore(Stores.ROS1_NOETIC)
    store.register(get_types_from_msg(IMU_IN_A_FIELD, "vn_driver/msg/Vectornav"))
    kinds = store.types
    vector, header = kinds["geometry_msgs/msg/Vector3"], kinds["std_msgs/msg/Header"]
    with Writer(tmp_path / "a.bag") as writer:
        to = writer.add_connection("/imu", "vn_driver/msg/Vectornav", typestore=store)
        for k in range(3):
            top = header(k, kinds["builtin_interfaces/msg/Time"](100 + k, 5 * 10**8), "imu")
            still = kinds["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0)
            none = np.zeros(9)
            imu = kinds["sensor_msgs/msg/Imu"](
                top, still, none, vector(0.1, 0.2, 0.3 + k), none, vector(1.0, 2.0, 9.8), none
            )
            message = kinds["vn_driver/msg/Vectornav"](top, imu, "$VNYMR")
            writer.write(to, k, store.serialize_ros1(message, "vn_driver/msg/Vectornav"))
    with pytest.raises(ValueError, match="no topics of type sensor_msgs/Imu") as refused:
        draft_campaign(tmp_path / "a.bag", tmp_path / "campaign")
    command = str(refused.value).split("columns: python ")[1].removesuffix(".")
    subprocess.run(f"{sys.executable} {command}", shell=True, check=True, cwd=tmp_path)
    (recording,) = read_recordings(tmp_path / "imu.csv")
    np.testing.assert_array_equal(recording.time, [100.5, 101.5, 102.5])
    np.testing.assert_array_equal(recording.accel, np.tile([1.0, 2.0, 9.8], (3, 1)))
    np.testing.assert_array_equal(recording.gyro[:, 2], [0.3, 1.3, 2.3])


def test_a_bag_that_does_not_hold_its_types_is_told_how_ros_writes_it(tmp_path):
    """As ROS 2 before Iron records: the bag was refused without a command."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import get_types_from_msg, get_typestore, Stores

    store = get_typestore(Stores.ROS2_HUMBLE)
    store.register(get_types_from_msg(IMU_IN_A_FIELD, "imu_msg/msg/IMUmsg"))
    plugin = StoragePlugin.SQLITE3
    with Writer(tmp_path / "run", version=9, storage_plugin=plugin) as writer:
        for topic in ("/a", "/imu"):
            to = writer.add_connection(topic, "imu_msg/msg/IMUmsg", typestore=store)
            writer.write(to, 1, b"\0" * 64)
    (file,) = (tmp_path / "run").glob("*.db3")
    with sqlite3.connect(file) as database:
        database.execute("DELETE FROM message_definitions")
    said = refusal(read_recordings, tmp_path / "run")
    assert "ros2 topic echo --csv /imu > imu.csv` beside `ros2 bag play 'run'" in said
