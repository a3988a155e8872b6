"""Rows of two devices in turn, read as one, are told; a line at half the sampling rate and held rows are not."""

import numpy as np
import pytest

from hand_log_data import G, hand_log
from inertiax.data.recording import Campaign, Recording, Site
from inertiax.plausibility import check_campaign


TIME, ACCEL, GYRO = hand_log()


def interleaved(accel, gyro):
    recording = Recording(time=np.arange(len(accel)) * 0.01, accel=accel, gyro=gyro)
    found = check_campaign(Campaign((recording,), Site(gravity=G))).findings
    return [f for f in found if f.kind == "interleaved"]


def test_rows_of_two_devices_in_turn_are_told():
    """With rows lost here and there, after which the order is the other."""
    rng = np.random.default_rng(4)
    accel, gyro = np.repeat(ACCEL, 2, axis=0), np.repeat(GYRO, 2, axis=0)
    accel = accel + 0.01 * rng.standard_normal(accel.shape)
    gyro = gyro + 0.001 * rng.standard_normal(gyro.shape)
    accel[1::2] += [0.2, -0.25, 0.1]
    gyro[1::2] += [0.02, 0.01, -0.015]
    kept = rng.random(len(accel)) > 0.003
    (found,) = interleaved(accel[kept], gyro[kept])
    assert found.severity == "warning"
    assert "every second row is of another level" in found.statement
    assert set(dict(found.evidence)["channels"]) >= {"gyro_x", "gyro_y", "gyro_z"}


@pytest.mark.parametrize("what", ["nothing", "a line", "held rows"])
def test_one_device_is_not(what):
    accel, gyro = ACCEL.copy(), GYRO.copy()
    if what == "a line":  # 0.05 Hz off half of 100 Hz
        line = np.cos(2 * np.pi * 49.95 * 0.01 * np.arange(len(accel)))[:, None]
        accel, gyro = accel + 0.5 * line, gyro + 0.05 * line
    if what == "held rows":
        accel, gyro = np.repeat(ACCEL, 2, axis=0), np.repeat(GYRO, 2, axis=0)
    assert not interleaved(accel, gyro)
