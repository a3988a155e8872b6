"""Units that no name says and no whole number tells: how fast the device turns tells them."""

import tomllib

import numpy as np
import pytest

from hand_log_data import DEGREE, draft, G, hand_log, written
from inertiax.data.campaign import load_campaign
from inertiax.plausibility import check_campaign


TIME, ACCEL, GYRO = hand_log()
NAMES = "time,acc_x,acc_y,acc_z,gyr_x,gyr_y,gyr_z"


@pytest.mark.parametrize("scale", [1000.0, 131.0])
def test_fractions_of_thousandths_or_counts_are_told_by_gravity(tmp_path, scale):
    """A logger that filters before it writes: the scale stays, whole numbers do not."""
    gyro = GYRO / DEGREE * scale + 0.25
    found = draft(written(tmp_path / "log.csv", (TIME, ACCEL / G * 1e3, gyro), NAMES))["columns"]
    assert (found["accel"]["unit"], found["gyro"]["unit"]) == ("mg", "count")
    assert found["gyro"]["scale"] == scale
    assert "CHECK gyro" not in (tmp_path / "campaign.toml").read_text()
    (recording,) = load_campaign(tmp_path).recordings
    np.testing.assert_allclose(recording.gyro, GYRO + 0.25 * DEGREE / scale, atol=1e-5)


@pytest.mark.parametrize("scale", [1000.0, 131.0])
def test_check_gives_the_line_for_them(tmp_path, scale):
    path = tmp_path / "log.csv"
    draft(written(path, (TIME, ACCEL, GYRO / DEGREE * scale + 0.25), NAMES))
    toml = tmp_path / "campaign.toml"
    kept = [x for x in toml.read_text().splitlines() if not x.startswith(("gyro", "[site", "grav"))]
    line = 'gyro = { names = ["gyr_x", "gyr_y", "gyr_z"], unit = "deg/s" }'
    toml.write_text("\n".join([*kept, line, "[site]", f"gravity = {G}"]) + "\n")
    seen = check_campaign(load_campaign(tmp_path)).findings
    found = next(f for f in seen if f.kind == "gyro_unit" and f.remedy)
    gyro = tomllib.loads(found.remedy)["columns"]["gyro"]
    assert (gyro["unit"], gyro["scale"]) == ("count", scale)


def test_whole_stamps_are_seconds_where_in_milliseconds_no_device_would_turn_so_fast(tmp_path):
    """A table's log at 1 Hz: right angles in two rows are 45 000 deg/s at 1000 Hz."""
    faces = np.eye(3)[[0, 1, 2, 0, 2, 1, 0]]
    up = np.repeat(faces, 30, axis=0)
    up[29::30][:-1] = (faces[:-1] + faces[1:]) / np.sqrt(2.0)  # on the way
    accel = G * up + np.random.default_rng(1).normal(scale=2e-3, size=up.shape)
    path = written(tmp_path / "log.csv", (np.arange(len(up)), accel), "t,ax,ay,az")
    assert draft(path)["columns"]["time"] == {"name": "t", "unit": "s"}
    assert "CHECK time: in ms the device would turn" in (tmp_path / "campaign.toml").read_text()


def test_whole_stamps_of_a_hand_at_a_thousand_rows_a_second_stay_milliseconds(tmp_path):
    _, accel, _ = hand_log(rate=1000.0, rests=3)
    path = written(tmp_path / "log.csv", (np.arange(len(accel)), accel), "t,ax,ay,az")
    assert draft(path)["columns"]["time"] == {"name": "t", "unit": "ms"}
