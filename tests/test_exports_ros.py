"""Kalibr's files of ROS bags: topic and rate of the recordings, and noise without a calibration."""

import numpy as np
import pytest

from command_runs import run
from hand_log_data import hand_log
from readers_data import bag


yaml = pytest.importorskip("ruamel.yaml", reason="ruamel.yaml is not installed (with rosbags)")
pytest.importorskip("rosbags", reason="rosbags is not installed (inertiax[ros])")
NOISE = {
    "accelerometer_noise_density": 2e-3,
    "accelerometer_random_walk": 3e-5,
    "gyroscope_noise_density": 1e-4,
    "gyroscope_random_walk": 2e-6,
}
SETS = [a for key, value in NOISE.items() for a in ("--set", f"{key}={value!r}")]


def at_rest(rate):
    rng = np.random.default_rng(4)
    accel = [0.0, 0.0, 9.80665] + 0.02 * rng.standard_normal((4096, 3))
    return np.arange(4096) / rate, accel, 8.73e-4 * rng.standard_normal((4096, 3))


def write(folder, rate, topics=("/imu/data_raw",), log=hand_log):
    time, accel, gyro = log(rate)
    folder.mkdir()
    data = {"time": 100.0 + time, "accel": accel, "gyro": gyro}
    bag(folder / "run", "mcap", data, topics=topics, probe=False)
    said = 'topic = "/imu/data_raw"\n' if len(topics) > 1 else ""
    text = f'[site]\ngravity = 9.80665\n[recordings]\nfiles = ["run"]\n{said}'
    (folder / "campaign.toml").write_text(text)
    return folder


def parsed(path):
    return yaml.YAML(typ="safe").load(path.read_text())


@pytest.mark.slow
def test_topic_and_rate_are_those_of_the_bag_that_was_calibrated(tmp_path, capsys, monkeypatch):
    campaign = write(tmp_path / "c", 40.0, ("/imu/data_raw", "/imu/second"))
    made, out = tmp_path / "made", tmp_path / "imu.yaml"
    assert run(capsys, monkeypatch, "calibrate", campaign, "-o", made)[0] == 0
    command = ["export", made / "calibration.json", "--to", "kalibr", "-o", out, *SETS]
    status, _, err = run(capsys, monkeypatch, *command)
    assert status == 0
    assert "update_rate = 40, rostopic = /imu/data_raw: of the recordings" in err
    imu = parsed(out)["imu0"]
    assert (imu["rostopic"], imu["update_rate"]) == ("/imu/data_raw", pytest.approx(40.0))
    # What the user says goes before.
    status, _, err = run(capsys, monkeypatch, *command, "--set", "rostopic=/other")
    assert status == 0 and parsed(out)["imu0"]["rostopic"] == "/other"
    # A calibration that the record does not belong to has neither.
    text = (made / "calibration.json").read_text()
    (made / "calibration.json").write_text(text + "\n")
    assert run(capsys, monkeypatch, *command)[0] == 0
    assert parsed(out)["imu0"]["rostopic"] == "/imu0"


@pytest.mark.slow
def test_noise_without_a_calibration(tmp_path, capsys, monkeypatch):
    campaign = write(tmp_path / "c", 40.0, log=at_rest)
    noise, out = tmp_path / "noise", tmp_path / "imu.yaml"
    assert run(capsys, monkeypatch, "noise", campaign, "-o", noise)[0] == 0
    command = ["export", "--to", "kalibr", "--noise", noise / "noise.json", "-o", out]
    walks = [a for a in SETS if a == "--set" or "random_walk" in a]
    walks = [x for a in walks if a != "--set" for x in ("--set", a)]
    status, text, err = run(capsys, monkeypatch, *command, *walks)
    assert (status, err) == (0, "") and text == f"kalibr, noise alone: {out}\n"
    imu = parsed(out)
    assert imu.keys() == {*NOISE, "rostopic", "update_rate"}
    assert (imu["rostopic"], imu["update_rate"]) == ("/imu/data_raw", pytest.approx(40.0))
    # The worst of three axes of 4096 samples, which tell it to 1.1 %; a filter's attenuation is left open to 2.4 %.
    assert imu["accelerometer_noise_density"] == pytest.approx(0.02 / 40**0.5, rel=0.07)
    assert imu["gyroscope_noise_density"] == pytest.approx(8.73e-4 / 40**0.5, rel=0.07)


def test_another_format_needs_the_calibration(tmp_path, capsys, monkeypatch):
    (tmp_path / "n.json").write_text("{}")
    status, _, err = run(
        capsys, monkeypatch, "export", "--to", "basalt", "--noise", tmp_path / "n.json"
    )
    assert status == 2 and "CALIBRATION is needed: basalt holds no noise without one" in err
