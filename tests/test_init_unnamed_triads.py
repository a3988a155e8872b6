"""`inertiax init` on triads without names: means of counts, and an acceleration with its parts."""

import numpy as np
import pytest

from hand_log_data import ACCEL_BIAS, CANONICAL, DEGREE, draft, G, hand_log, written
from inertiax.campaign_draft import draft_campaign
from inertiax.data.campaign import load_campaign


TIME, ACCEL, GYRO = hand_log()
RNG = np.random.default_rng(3)


def means_of_poses(per_g, poses=24):
    """Means of counts in poses all over the sphere, with the errors of a consumer part."""
    up = RNG.standard_normal((poses, 3))
    up /= np.linalg.norm(up, axis=1, keepdims=True)
    return per_g * (up * [1.01, 0.99, 1.02] + [0.01, -0.02, 0.015])


def test_means_of_counts_near_a_data_sheet_are_accelerometers(tmp_path):
    """A public file of 29 poses at 16384 counts per g was a magnetometer's in nT, 16.5 µT: nowhere on Earth."""
    found = draft(written(tmp_path / "kerf.txt", (means_of_poses(16384.0),)))["columns"]
    assert (found["accel"]["unit"], found["accel"]["scale"]) == ("count", 16384.0)
    assert "mag" not in found
    assert "may be a magnetometer's as well" in (tmp_path / "campaign.toml").read_text()


@pytest.mark.parametrize("per_g, unit", [(8192.0, "count"), (9806.65, "mm/s^2"), (1000.0, "mg")])
def test_means_of_poses_have_the_nearest_of_units_and_counts(tmp_path, per_g, unit):
    """8192 counts per g are 16 % off mm/s²: the nearer of the two is taken for means of many poses."""
    columns = (means_of_poses(per_g),)
    found = draft(written(tmp_path / "acc.csv", columns, "ax,ay,az"))["columns"]["accel"]
    assert found["unit"] == unit
    assert found.get("scale", per_g) == per_g


def test_a_field_of_the_earth_near_a_data_sheet_stays_a_magnetometers(tmp_path):
    """51 µT in mG: it is to be checked, and the other reading stands beside it."""
    found = draft(written(tmp_path / "field.txt", (means_of_poses(512.0),)))["columns"]
    assert found["mag"]["unit"] == "mgauss" and "accel" not in found
    text = (tmp_path / "campaign.toml").read_text()
    assert "CHECK mag: no gravity but in 512 counts per g" in text


def parts(accel):
    """Acceleration, its part without gravity, and gravity, as a BNO055's library prints them, two digits each."""
    force = accel - ACCEL_BIAS
    gravity = G * force / np.linalg.norm(force, axis=1, keepdims=True)
    gravity, linear = np.round(gravity, 2), np.round(accel - gravity, 2)
    return np.round(gravity + linear, 2), linear, gravity


def test_an_acceleration_without_gravity_is_no_gyros_at_rest(tmp_path):
    """A public log at rest has a field, rates, angles, acceleration, linear acceleration, gravity and a quaternion."""
    accel = ACCEL[:190]
    field = np.round(np.array([8.0, -6.5, -39.5]) + 0.3 * RNG.standard_normal(accel.shape), 4)
    rate = np.round(16.0 * 0.1 * RNG.standard_normal(accel.shape)) / 16.0
    angles = np.tile([2.875, -10.5, 2.0625], (len(accel), 1))
    found = draft(written(tmp_path / "log.csv", (field, rate, angles, *parts(accel))))
    names = found["recordings"]["names"]
    assert names[3:6] == ["gyro_x", "gyro_y", "gyro_z"] and names[9:12] == [
        "accel_x",
        "accel_y",
        "accel_z",
    ]
    assert "are parts of it, left aside" in (tmp_path / "campaign.toml").read_text()


def test_of_several_triads_beside_the_parts_gravity_tells_the_gyros(tmp_path):
    """Angles of a device that is turned are as unsteady as rates."""
    angles = np.cumsum(GYRO, axis=0) / 50.0 / DEGREE
    path = written(tmp_path / "log.csv", (TIME, *parts(ACCEL), angles, GYRO))
    names = draft(path)["recordings"]["names"]
    assert names.index("gyro_x") == 13 and names.index("accel_x") == 1
    (recording,) = load_campaign(tmp_path).recordings
    assert np.allclose(recording.gyro, GYRO, atol=1e-6)


def test_without_gyros_they_are_left_out(tmp_path):
    found = draft(written(tmp_path / "log.csv", (TIME, *parts(ACCEL))))
    assert "gyro" not in found["columns"] and found["recordings"]["names"][1] == "accel_x"
    assert "which columns are the gyros'" in (tmp_path / "campaign.toml").read_text()


def test_two_accelerometers_and_gyros_are_no_parts(tmp_path):
    """Beside a second, noisier accelerometer the gyros stay what they are."""
    other = np.round(ACCEL + 0.05 * RNG.standard_normal(ACCEL.shape), 3)
    names = draft(written(tmp_path / "log.csv", (TIME, ACCEL, GYRO, other)))["recordings"]["names"]
    assert names[1:7] == ["accel_x", "accel_y", "accel_z", "gyro_x", "gyro_y", "gyro_z"]


def turning(radius, spread, center=0.0, rows=600):
    """Counts of a vector seen by a device that a hand turns all ways and never lays down."""
    t = np.arange(rows) / 100.0
    up = np.stack(
        [np.sin(2.1 * t), np.cos(2.1 * t) * np.sin(1.3 * t), np.cos(2.1 * t) * np.cos(1.3 * t)],
        axis=1,
    )
    return np.round(radius * up + center + RNG.normal(0.0, spread, up.shape))


def test_counts_that_turn_all_ways_without_poses_may_be_a_field(tmp_path):
    """A public magnetometer's counts, 500 at any attitude, were accelerometers of 512 per g without a word."""
    draft(written(tmp_path / "raw.txt", (turning(500.0, 3.0, center=[-30.0, 20.0, 40.0]),)))
    text = tmp_path / "campaign.toml"
    assert "may be a magnetometer's as well" in text.read_text()
    draft(written(tmp_path / "Accelero_7.txt", (turning(500.0, 3.0),)))  # as the file says
    assert "may be a magnetometer's as well" not in text.read_text()


def test_counts_at_rest_by_a_data_sheet_are_no_field(tmp_path):
    counts = np.round([20.0, -30.0, 16384.0] + RNG.normal(0.0, 20.0, (600, 3)))
    draft(written(tmp_path / "raw.txt", (counts,)))
    assert "may be a magnetometer's as well" not in (tmp_path / "campaign.toml").read_text()


def test_a_quaternion_whose_norm_is_not_kept_is_no_further_triad(tmp_path):
    attitude = 0.98 * np.tile([0.1, -0.2, 0.3, np.sqrt(0.86)], (len(TIME), 1))
    path = written(
        tmp_path / "log.csv", (TIME, ACCEL, GYRO, attitude), f"time_s,{CANONICAL},x,y,z,w"
    )
    draft(path)
    text = (tmp_path / "campaign.toml").read_text()
    assert "# x, y, z, w: a quaternion by their names, left aside" in text
    assert "further accel" not in text and "Not read" not in text


@pytest.mark.parametrize(
    ("zero", "said"),
    [(0.9, "are likely a magnetometer's"), (0.05, "may be a magnetometer's as well")],
)
def test_counts_whose_zero_lies_far_beside_0_are_likely_a_field(tmp_path, zero, said):
    """A device turned all ways in a hand, with iron beside its magnetometer; `init` says it, not the file alone."""
    rng = np.random.default_rng(6)
    up = rng.standard_normal((40, 3))
    path = np.concatenate([np.linspace(a, b, 30) for a, b in zip(up[:-1], up[1:])])
    path /= np.linalg.norm(path, axis=1, keepdims=True)
    counts = np.round(
        3550.0 * (path + zero * np.array([-0.3, 0.8, 0.2])) + rng.normal(0, 5, path.shape)
    )
    found = draft_campaign(written(tmp_path / "cal.csv", (counts,)), tmp_path)
    assert said in found.untold["accel"]
