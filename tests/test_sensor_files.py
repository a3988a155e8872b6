"""An app's folder, in which each sensor has a file: which files become the recording."""

from pathlib import Path

import numpy as np
import pytest

from inertiax.campaign_draft import draft_campaign
from inertiax.campaign_draft.sensor_files import sensor_files
from inertiax.data.campaign import load_campaign


@pytest.mark.parametrize(
    "names, accel, gyro",
    [
        # Sensor Logger 1.x, as its help lists a recording's files.
        (
            "Accelerometer AccelerometerUncalibrated Annotation Barometer Gravity Gyroscope GyroscopeUncalibrated "
            "Location Magnetometer MagnetometerUncalibrated Metadata Orientation TotalAcceleration",
            "TotalAcceleration",
            "Gyroscope",
        ),
        # phyphox, whose "Linear Accelerometer" has no gravity.
        ("Accelerometer Gyroscope Linear_Accelerometer Magnetometer", "Accelerometer", "Gyroscope"),
        ("acc_1 gyr_1", "acc_1", "gyr_1"),
        ("Beschleunigung Gyroskop", "Beschleunigung", "Gyroskop"),
    ],
)
def test_one_file_of_each_triad_is_taken(names, accel, gyro):
    paths = [Path(f"{name}.csv") for name in names.split()]
    found = sensor_files(paths)
    assert found is not None
    assert (found.accel.stem, found.gyro.stem) == (accel, gyro)
    assert {p.stem for p in found.aside} == set(names.split()) - {accel, gyro}


@pytest.mark.parametrize(
    "names",
    [
        "acc_1 gyr_1 acc_2 gyr_2",  # two recordings
        "acc_1 gyr_1 run_2",  # a log that its name does not tell
        "acc_1 acc_2",
        "acc_gyro gyro_acc",
    ],
)
def test_other_files_are_recordings_of_their_own(names):
    assert sensor_files([Path(f"{name}.csv") for name in names.split()]) is None


def app(folder):
    """16 poses of 2 s by hand, each sensor in a file, columns in an app's order; gyros with a bias of 0.02 rad/s."""
    rng = np.random.default_rng(3)
    up = np.repeat(rng.standard_normal((16, 3)), 100, axis=0)
    force = 9.8 * up / np.linalg.norm(up, axis=1, keepdims=True)
    time = np.arange(len(up)) / 50.0
    outputs = {
        "TotalAcceleration": force + 0.01 * rng.standard_normal(up.shape),
        "Accelerometer": 0.01 * rng.standard_normal(up.shape),
        "Gyroscope": 0.02 + 1e-3 * rng.standard_normal(up.shape),
        "Magnetometer": 40.0 * up,
    }
    folder.mkdir()
    for name, values in outputs.items():
        rows = "".join(
            f"{1_780_000_000_000_000_000 + round(1e9 * t)},{t},{z:.6f},{y:.6f},{x:.6f}\n"
            for t, (x, y, z) in zip(time, values, strict=True)
        )
        (folder / f"{name}.csv").write_text(f"time,seconds_elapsed,z,y,x\n{rows}")
    (folder / "Metadata.csv").write_text("version,device\n3,phone\n")
    warm = "".join(
        f"{1_780_000_000_000_000_000 + 10**9 * k},{20 + k / 10}\n" for k in range(-1, 34)
    )
    (folder / "Temperature.csv").write_text(f"time,celsius\n{warm}")
    return force


@pytest.mark.parametrize("given", ["folder", "files", "one"])
def test_init_takes_an_apps_folder_its_files_or_one_of_them(tmp_path, given):
    force = app(tmp_path / "app")
    files = sorted((tmp_path / "app").iterdir())
    logs = {
        "folder": [tmp_path / "app"],
        "files": files,
        "one": [tmp_path / "app" / "TotalAcceleration.csv"],
    }[given]
    draft = draft_campaign(logs[0], tmp_path, others=logs[1:])
    (tmp_path / "campaign.toml").write_text(draft.text)
    (recording,) = load_campaign(tmp_path).recordings
    assert recording.accel is not None and recording.gyro is not None
    np.testing.assert_allclose(recording.accel, force, atol=0.06)
    np.testing.assert_allclose(recording.gyro.mean(axis=0), 0.02, atol=1e-4)
    if given != "one":
        assert recording.temperature is not None
        np.testing.assert_allclose(
            recording.temperature[:, 0], 20.0 + (recording.time - recording.time[0]) / 10, atol=1e-4
        )
    aside = '"Accelerometer.csv", "Magnetometer.csv", "Metadata.csv"'
    assert any(aside in said for said in draft.unread) == (given != "one")


def test_two_whole_logs_called_after_their_use_stay_two(tmp_path):
    rng = np.random.default_rng(1)
    names = "time,accel_x,accel_y,accel_z,gyro_x,gyro_y,gyro_z"
    for name in ("accel_test", "gyro_test"):
        rows = np.column_stack(
            [np.arange(200) / 50.0, 9.8 * np.eye(3)[np.full(200, 2)], np.zeros((200, 3))]
        )
        rows[:, 1:] += 1e-3 * rng.standard_normal((200, 6))
        np.savetxt(
            tmp_path / f"{name}.csv", rows, delimiter=",", header=names, comments="", fmt="%.6f"
        )
    logs = [tmp_path / "accel_test.csv", tmp_path / "gyro_test.csv"]
    draft = draft_campaign(logs[0], tmp_path, others=logs[1:])
    (tmp_path / "campaign.toml").write_text(draft.text)
    assert len(load_campaign(tmp_path).recordings) == 2


def test_a_folder_of_other_logs_is_refused_with_one_of_them(tmp_path):
    app(tmp_path / "app")
    (tmp_path / "app" / "Gyroscope.csv").unlink()
    with pytest.raises(ValueError, match="is a folder, .*; name its logs, such as inertiax init"):
        draft_campaign(tmp_path / "app", tmp_path)
