"""Columns whose names say first whose they are: a struct, a device, a chip."""

import numpy as np
import pytest

from hand_log_data import DEGREE, draft, G, hand_log, written
from inertiax.campaign_draft.column_words import behind_owner
from inertiax.data.campaign import load_campaign


TIME, ACCEL, GYRO = hand_log()
# Turned as gravity is: any field does whose size is the Earth's, gauss.
FIELD = ACCEL[:, [1, 2, 0]] / G * 0.5


def header(*groups):
    return ",".join(["Time", *(f"{group}{axis}" for group in groups for axis in "xyz")])


@pytest.mark.parametrize(
    ("accel", "gyro", "mag"),
    [
        ("KX_IMU_a", "IMU_g", "IMU_m"),
        ("lowG_data.a", "lowG_data.g", "lowG_data.m"),
        ("KX134_raw_a", "LSM6_raw_w", "LIS3_raw_b"),
        ("packet.imu.accel_", "packet.imu.gyro_", "packet.mag."),
    ],
)
def test_a_triad_is_what_stands_behind_its_owner(tmp_path, accel, gyro, mag):
    """Public logs of rockets: `KX_IMU_ax` was not read beside `IMU_gx`, and of `lowG_data.ax` nothing was."""
    columns = (TIME, ACCEL / G, GYRO / DEGREE, FIELD)
    found = draft(written(tmp_path / "log.csv", columns, header(accel, gyro, mag)))["columns"]
    for key, name in (("accel", accel), ("gyro", gyro), ("mag", mag)):
        assert found[key]["names"] == [f"{name}{axis}" for axis in "xyz"]


def test_a_name_that_says_it_by_itself_comes_first(tmp_path):
    columns = (TIME, 0.5 * ACCEL, ACCEL, GYRO)
    path = written(tmp_path / "log.csv", columns, header("kalman.a", "acc_", "gyro_"))
    assert draft(path)["columns"]["accel"]["names"] == ["acc_x", "acc_y", "acc_z"]


@pytest.mark.parametrize(
    ("name", "field"),
    [
        ("lowg_data.a_x", "a_x"),
        ("kx_imu_a_x", "a_x"),
        ("imu.mpu_g_x", "g_x"),
        ("acc_x", "acc_x"),
        ("motor_a_x", "motor_a_x"),
        ("x", "x"),
    ],
)
def test_words_of_owners(name, field):
    assert behind_owner(name) == field


def test_stamps_of_dashes_are_the_clock(tmp_path):
    """`2024-3-23--13-41-38-830` of a public log was a label, and its rows were counted at 100 Hz."""
    clock = [divmod(round(1e3 * t), 1000) for t in 2.0 * TIME]
    rows = [
        f"2024-3-23--13-{41 + s // 60}-{s % 60}-{ms},{','.join(f'{v:.6f}' for v in (*a, *w))}"
        for (s, ms), a, w in zip(clock, ACCEL, GYRO, strict=True)
    ]
    path = tmp_path / "log.csv"
    path.write_text("\n".join([header("KX_IMU_a", "IMU_g"), *rows]) + "\n")
    found = draft(path)["columns"]
    assert found["time"] == {"name": "Time"}
    (recording,) = load_campaign(tmp_path).recordings
    # Milliseconds are what was written, doubles near 1.7e9 s are 2.4e-7 s apart.
    np.testing.assert_allclose(recording.time - recording.time[0], 2.0 * TIME, atol=1.1e-3)
