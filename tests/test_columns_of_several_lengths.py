"""HDF5 and MATLAB files that hold sensors of several rates, each in a group of its own."""

import numpy as np
import pytest
import scipy.io

from hand_log_data import DEGREE, draft, G, hand_log
from inertiax.campaign_draft import draft_campaign
from inertiax.data.campaign import load_campaign


h5py = pytest.importorskip("h5py")
TIME, ACCEL, GYRO = hand_log()
MS = (1.68e12 + np.round(1e3 * TIME)).astype(np.int64)
BEATS = np.random.default_rng(0).normal(size=(5 * len(TIME), 2))


def body_sensor(path, accel="ACCELEROMETER_3D"):
    """As a shirt with an electrocardiogram writes them, whose columns are five times as long."""
    with h5py.File(path, "w") as file:
        file["ECG_2_CH/0x026ffffe/t"] = 1_680_000_000_000 + 2 * np.arange(len(BEATS))[:, None]
        for k in range(2):
            file[f"ECG_2_CH/0x026ffffe/ch{k + 1}/v"] = BEATS[:, k, None]
        for group, values in ((accel, ACCEL), ("GYROSCOPE_3D", GYRO / DEGREE)):
            file[f"{group}/0x0268fd9f/t"] = MS[:, None]
            for k, axis in enumerate("xyz"):
                file[f"{group}/0x0268fd9f/{axis}/v"] = values[:, k, None]
        file["TEMPERATURE/0x0268fd9f/t"] = MS[:, None]
        file["TEMPERATURE/0x0268fd9f/0/v"] = 30.0 + 0.001 * TIME[:, None]
        file["EVENT/START/1/t"] = MS[:1, None]
    return path


def test_the_length_that_holds_triads_is_taken(tmp_path):
    """Of a public file of such a shirt only the heart's columns were seen: "no three columns"."""
    found = draft(body_sensor(tmp_path / "walk.h5"))["columns"]
    inside = "0x0268fd9f"
    assert found["accel"]["names"] == [f"ACCELEROMETER_3D/{inside}/{a}/v" for a in "xyz"]
    assert found["gyro"]["names"] == [f"GYROSCOPE_3D/{inside}/{a}/v" for a in "xyz"]
    assert found["time"] == {"name": f"ACCELEROMETER_3D/{inside}/t", "unit": "ms"}
    assert found["temperature"]["name"] == f"TEMPERATURE/{inside}/0/v"
    (recording,) = load_campaign(tmp_path).recordings
    np.testing.assert_array_equal(recording.accel, ACCEL)
    np.testing.assert_allclose(recording.gyro, GYRO, rtol=1e-12)


def test_further_files_of_such_columns(tmp_path):
    first, second = (body_sensor(tmp_path / f"{k}.h5") for k in "ab")
    text = draft_campaign(first, tmp_path, others=[second]).text
    (tmp_path / "campaign.toml").write_text(text)
    assert len(load_campaign(tmp_path).recordings) == 2


def test_what_other_lengths_hold_is_told(tmp_path):
    path = tmp_path / "walk.h5"
    with h5py.File(path, "w") as file:
        file["ECG/ch1"] = BEATS[:, 0]
        file["BREATH/abd"] = BEATS[:900, 1]
    with pytest.raises(ValueError, match=r"no triads either \(900 rows: BREATH/abd\)"):
        draft(path)


def test_structs_of_a_matlab_file(tmp_path):
    names = [f"{k}{a}" for k in ("a", "g") for a in "xyz"]
    imu = dict(zip(names, np.hstack([ACCEL / G, GYRO / DEGREE]).T, strict=True)) | {"t": TIME}
    path = tmp_path / "log.mat"
    scipy.io.savemat(path, {"gps": {"lat": BEATS[:, 0], "lon": BEATS[:, 1]}, "imu": imu})
    found = draft(path)["columns"]
    assert found["accel"]["names"] == [f"imu/a{a}" for a in "xyz"]
    assert load_campaign(tmp_path).recordings[0].num_samples == len(TIME)


def test_recordings_of_other_lengths_are_named(tmp_path):
    """One public file holds seven logs, of which the longest was taken without a word of the others."""
    path, stored = tmp_path / "logs.mat", {}
    for k, last in enumerate((len(TIME), len(TIME) - 900, len(TIME) - 500)):
        stored |= {f"time{k}": TIME[:last]}
        for name, values in (("acc", ACCEL), ("rate", GYRO)):
            stored |= {f"{name}{a}{k}": values[:last, i] for i, a in enumerate("xyz")}
    scipy.io.savemat(path, stored)
    text = draft_campaign(path, tmp_path).text
    (told,) = [line for line in text.splitlines() if "other lengths" in line]
    assert f"accx1 ({len(TIME) - 900} rows)" in told and f"accx2 ({len(TIME) - 500} rows)" in told
    assert '["accx0", "accy0", "accz0"]' in text and "accx0 (" not in told


def test_navigation_toolboxes_name_both_triads_in_body_axes(tmp_path):
    """As NaveGo stores an IMU: fb and wb, of which the rates were "not read" where no turn told them."""
    path, rng = tmp_path / "imu.mat", np.random.default_rng(0)
    still = {"t": TIME, "fb": np.array([0.1, 0.2, G]) + 0.02 * rng.normal(size=ACCEL.shape)}
    still |= {"wb": 1e-3 * rng.normal(size=GYRO.shape), "arw": np.zeros(3)}
    scipy.io.savemat(path, {"imu1": still})
    found = draft(path)["columns"]
    assert found["accel"]["names"] == [f"imu1/fb_{a}" for a in "xyz"]
    assert found["gyro"] == {"names": [f"imu1/wb_{a}" for a in "xyz"], "unit": "rad/s"}
