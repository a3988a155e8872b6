"""Columns that begin with a g: gyros for most loggers, a force in g for Physics Toolbox and its like."""

import numpy as np
import pytest

from hand_log_data import DEGREE, draft, G, hand_log, written
from inertiax.campaign_draft.column_kinds import kind_of


TIME, ACCEL, GYRO = hand_log()


@pytest.mark.parametrize(
    ("names", "force", "rate"),
    [
        ("time,gFx,gFy,gFz,wx,wy,wz", "gF", "w"),
        ("time,imu_gFx,imu_gFy,imu_gFz,imu_wx,imu_wy,imu_wz", "imu_gF", "imu_w"),
        ("time,gx [g],gy [g],gz [g],rx [rad/s],ry [rad/s],rz [rad/s]", "g", None),
    ],
)
def test_a_force_in_g_is_the_accelerometers(tmp_path, names, force, rate):
    """Of `gFx` and `wx` the former were gyros in deg/s, and the latter "a further gyro triad"."""
    found = draft(written(tmp_path / "log.csv", (TIME, ACCEL / G, GYRO), names))["columns"]
    assert [n.split(" ")[0] for n in found["accel"]["names"]] == [f"{force}{a}" for a in "xyz"]
    assert found["accel"]["unit"] == "g"
    if rate is not None:
        assert found["gyro"]["names"] == [f"{rate}{a}" for a in "xyz"]
        assert found["gyro"]["unit"] == "rad/s"
        assert "CHECK gyro" not in (tmp_path / "campaign.toml").read_text()


def test_of_a_force_in_g_and_an_acceleration_the_latter_has_no_gravity(tmp_path):
    """Physics Toolbox's multi-record: g-force, linear acceleration, rates, field, in any order."""
    linear = np.random.default_rng(5).normal(0.0, 0.3, ACCEL.shape)
    names = "time,ax,ay,az,gFx,gFy,gFz,wx,wy,wz"
    path = written(tmp_path / "log.csv", (TIME, linear, ACCEL / G, GYRO), names)
    assert draft(path)["columns"]["accel"]["names"] == ["gFx", "gFy", "gFz"]


def test_what_reads_gravity_in_many_directions_is_no_gyros(tmp_path):
    """`gx, gy, gz` beside `wx, wy, wz`, without a word on units: their numbers tell."""
    path = written(tmp_path / "log.csv", (TIME, ACCEL / G, GYRO), "time,gx,gy,gz,wx,wy,wz")
    found = draft(path)["columns"]
    assert found["accel"]["names"] == ["gx", "gy", "gz"]
    assert found["gyro"]["names"] == ["wx", "wy", "wz"]
    assert "taken for the accelerometers, because" in (tmp_path / "campaign.toml").read_text()


def test_what_the_file_calls_gyroscope_is_marked_when_it_reads_gravity(tmp_path):
    path = written(tmp_path / "log.csv", (TIME, ACCEL), "time,gyro_x,gyro_y,gyro_z")
    draft(path)
    assert "CHECK gyro: the norm stays that of gravity" in (tmp_path / "campaign.toml").read_text()


def test_gyros_stay_gyros(tmp_path):
    """Rates of 1 rad/s about one axis, both ways, have a steady norm near 1 as well."""
    rate = np.zeros_like(GYRO)
    rate[:, 2] = np.where(np.arange(len(rate)) < len(rate) // 2, 1.0, -1.0)
    rate += 0.01 * np.random.default_rng(2).standard_normal(rate.shape)
    found = draft(written(tmp_path / "log.csv", (TIME, rate / DEGREE), "time,gx,gy,gz"))["columns"]
    assert "accel" not in found and found["gyro"]["names"] == ["gx", "gy", "gz"]


@pytest.mark.parametrize(
    ("name", "hint", "kind"),
    [
        ("g_f_x", "gfx", "accel"),
        ("gf_x", "gfx", "accel"),
        ("g_x", "gx", "gyro"),
        ("g_x", "gx [dps]", "gyro"),
        ("g_x", "gx (m/s^2)", "accel"),
        ("gyro_x", "gyro_x (g)", "gyro"),
        ("w_b_x", "wbx", "gyro"),
        ("a_b_x", "abx", "accel"),
    ],
)
def test_kinds_by_name(name, hint, kind):
    assert kind_of(name, hint) == kind
