"""`inertiax init` on the registers of Bosch's BNO055: 100 counts per m/s², 16 per deg/s, 16 per µT (its data sheet)."""

import numpy as np
import pytest

from hand_log_data import CANONICAL, DEGREE, draft, G, hand_log, written
from inertiax.data.campaign import load_campaign


TIME, ACCEL, GYRO = hand_log()
RNG = np.random.default_rng(4)
NAMES = f"t,{CANONICAL},mag_x,mag_y,mag_z"


def field(rows):
    """48 µT, of a device that lies."""
    return np.round(16.0 * (np.array([19.0, 6.0, -43.6]) + 0.2 * RNG.standard_normal((rows, 3))))


def lying(reads, rows=3000):
    """On a table, where gravity reads so much; turned about the vertical, where gravity tells nothing of gyros."""
    gyro = 0.1 * RNG.standard_normal((rows, 3))
    gyro[1000:1200, 2] += 45.0
    accel = np.array([0.0, 0.0, reads]) + 2.0 * RNG.standard_normal((rows, 3))
    return np.arange(rows) / 100.0, np.round(accel), np.round(16.0 * gyro), field(rows)


def test_one_pose_takes_the_nearest_scale_and_marks_it(tmp_path):
    """A public log reads 970.7: it was 1024 per g without a mark, 131 counts per deg/s, and a field in mG."""
    found = draft(written(tmp_path / "log.csv", lying(970.7), NAMES))["columns"]
    assert (found["accel"]["unit"], found["accel"]["scale"]) == ("count", 980.665)
    assert (found["gyro"]["unit"], found["gyro"]["scale"]) == ("count", 16.0)
    assert (found["mag"]["scale"], found["mag"]["scale_unit"]) == (16.0, "count per uT")
    text = (tmp_path / "campaign.toml").read_text()
    assert all(f"CHECK {k}" in text for k in ("accel", "gyro", "mag"))
    assert "1024 per g or mg" in text
    (recording,) = load_campaign(tmp_path).recordings
    assert np.median(recording.accel[:, 2]) == pytest.approx(9.707, abs=0.01)
    assert np.median(np.linalg.norm(recording.mag, axis=1)) == pytest.approx(48e-6, rel=0.02)


@pytest.mark.parametrize("reads, scale, sure", [(1024.0, 1024.0, False), (1120.0, 1024.0, True)])
def test_a_scale_of_1024_keeps_its_own(tmp_path, reads, scale, sure):
    """Beside 1024 a bias of 4 % makes 981; 9 % from it nothing else is as near."""
    found = draft(written(tmp_path / "log.csv", lying(reads), NAMES))["columns"]
    assert found["accel"]["scale"] == scale and found["gyro"]["scale"] == 131.0
    assert ("CHECK accel" not in (tmp_path / "campaign.toml").read_text()) == sure


@pytest.mark.parametrize("reads", [512.0, 2048.0, 4096.0, 16384.0])
def test_other_scales_are_as_sure_as_before(tmp_path, reads):
    found = draft(written(tmp_path / "log.csv", lying(reads), NAMES))["columns"]
    assert found["accel"]["scale"] == reads
    assert "CHECK accel" not in (tmp_path / "campaign.toml").read_text()


def test_gravity_tells_the_chip_in_poses_and_motions(tmp_path):
    """12 poses tell 980.7 from 1024, and motions 16 from 16.4."""
    counts = np.round(100.0 * ACCEL), np.round(16.0 * GYRO / DEGREE)
    found = draft(written(tmp_path / "log.csv", (TIME, *counts, field(len(TIME))), NAMES))
    assert found["columns"]["accel"]["scale"] == 980.665
    assert (found["columns"]["gyro"]["scale"], found["columns"]["mag"]["scale"]) == (16.0, 16.0)
    text = (tmp_path / "campaign.toml").read_text()
    assert "CHECK accel" not in text and "CHECK gyro" not in text
    (recording,) = load_campaign(tmp_path).recordings
    # Half a count is 0.005 m/s² and 0.03 deg/s.
    assert np.abs(recording.accel - ACCEL).max() < 0.0051
    assert np.abs(recording.gyro - GYRO).max() < 0.032 * DEGREE


def test_gyros_of_16_4_beside_other_accelerometers_stay_so(tmp_path):
    counts = np.round(ACCEL / G * 2048.0), np.round(16.1 * GYRO / DEGREE)
    found = draft(written(tmp_path / "log.csv", (TIME, *counts), f"t,{CANONICAL}"))["columns"]
    assert found["gyro"]["scale"] == 16.4
