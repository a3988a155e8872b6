"""PX4's own numbers of the sensors: from the ULog that was calibrated into the parameters that PX4 reads."""

import pytest

from inertiax.data.formats import ulog
from inertiax.data.inputs import sensor_ids
from inertiax.exports import by_name
from inertiax.exports.noise import known_settings
from readers_data import ulog as write_ulog


ROWS = [(1000 * k, 1000 * k, 0, 0.0, 0.0, 9.8, 30.0) for k in range(1, 60)]
IDS = {0: {"accel_id": 1310988, "gyro_id": 2162690}, 1: {"accel_id": 1310996, "gyro_id": 2162698}}


def of(number):
    return [(*row[:2], number, *row[3:]) for row in ROWS]


def log(path, imus):
    streams = [
        (f"sensor_{k.removesuffix('_id')}", i, of(n)) for i in imus for k, n in IDS[i].items()
    ]
    write_ulog(path, streams)
    return path


def campaign(folder, text=""):
    path = folder / "campaign.toml"
    path.write_text(f"[site]\ngravity = 9.8\n[recordings]\nfiles = ['*.ulg']\n{text}")
    return path


def test_numbers_are_the_logs(tmp_path):
    assert ulog.sensor_ids(log(tmp_path / "a.ulg", (0, 1))) == IDS
    said = campaign(tmp_path)
    assert sensor_ids(said, "imu1") == IDS[1]
    assert sensor_ids(said, "board 7") == {}  # which of the two nobody says
    assert sensor_ids(campaign(tmp_path, "instance = 0"), "board 7") == IDS[0]
    assert sensor_ids(None, "imu1") == {}


def test_of_one_imu_and_of_logs_that_differ(tmp_path):
    log(tmp_path / "a.ulg", (0,))
    assert sensor_ids(campaign(tmp_path), "") == IDS[0]
    log(tmp_path / "b.ulg", (1,))
    assert sensor_ids(campaign(tmp_path), "") == {}


def test_the_first_bytes_of_a_long_log_tell_them(tmp_path, monkeypatch):
    path = log(tmp_path / "a.ulg", (0, 1))
    monkeypatch.setattr(ulog, "_HEAD", path.stat().st_size // 2)
    assert ulog.sensor_ids(path)[0]["accel_id"] == IDS[0]["accel_id"]


@pytest.mark.parametrize(("name", "given"), [("px4", IDS[1]), ("ardupilot", {}), ("kalibr", {})])
def test_only_px4_has_a_place_for_them(name, given):
    assert known_settings(by_name(name), None, None, IDS[1]) == given
