"""`inertiax init` on devices that move all along, and on gyros without accelerometers; made with SciPy's rotations."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hand_log_data import CANONICAL, DEGREE, draft, G, hand_log, written
from inertiax.data.campaign import load_campaign
from inertiax.plausibility import check_campaign


TIME, ACCEL, GYRO = hand_log()


def moved(rate=100.0, seconds=60.0):
    """A device that turns all along and is shaken: time, accel (m/s²) and gyro (rad/s) from SciPy's rotations."""
    rng = np.random.default_rng(8)
    time = np.arange(round(seconds * rate)) / rate
    gyro = np.stack([np.sin(0.7 * time + k) + np.sin(1.9 * time + 2 * k) for k in range(3)], axis=1)
    turns = Rotation.from_rotvec(gyro / rate)
    attitude, up = Rotation.identity(), np.empty_like(gyro)
    for k in range(len(time)):
        up[k] = attitude.inv().apply([0.0, 0.0, G])
        attitude = attitude * turns[k]
    gyro += 0.05 * rng.normal(size=gyro.shape)
    return time, up + 0.3 * rng.normal(size=up.shape), gyro, attitude


@pytest.mark.slow
def test_the_force_in_motion_tells_the_gyros_unit(tmp_path):
    """By magnitude alone shaken gyros in rad/s were likely deg/s; noisy ones as they are."""
    time, accel, gyro, _ = moved()
    for unit, factor in (("rad/s", 1.0), ("deg/s", 1 / DEGREE)):
        path = written(tmp_path / "log.csv", (time, accel, factor * gyro), f"t,{CANONICAL}")
        assert draft(path)["columns"]["gyro"]["unit"] == unit
        toml = tmp_path / "campaign.toml"
        assert "CHECK gyro" not in toml.read_text()
        told = lambda: [
            f for f in check_campaign(load_campaign(tmp_path)).findings if f.kind == "gyro_unit"
        ]
        assert not told()
        other = {"rad/s": "deg/s", "deg/s": "rad/s"}[unit]
        toml.write_text(toml.read_text().replace(f'unit = "{unit}"', f'unit = "{other}"'))
        found = told()[-1]  # rates beyond all gyros' are an error before
        assert f'likely unit "{unit}"' in found.statement


@pytest.mark.parametrize("unit, factor", [("rad/s", DEGREE), ("deg/s", 1.0)])
def test_a_converters_steps_tell_the_unit_of_gyros_alone(tmp_path, unit, factor):
    """16 bits of 2000 deg/s, printed with six digits."""
    steps = np.round(10.0 * np.random.default_rng(2).normal(size=(4000, 3)) + 3.0)
    gyro = steps * (2000.0 / 32768.0) * factor
    path = written(tmp_path / "log.csv", (np.arange(4000) / 100.0, gyro), "time,Gyr_X,Gyr_Y,Gyr_Z")
    assert draft(path)["columns"]["gyro"]["unit"] == unit


def test_a_packet_counter_is_no_clock_and_a_column_of_steps_counts_rows(tmp_path):
    """Of an x-IMU every second packet is of another kind; a sketch for Arduino wrote the milliseconds of each loop."""
    packets = np.cumsum(1 + (np.arange(len(TIME)) % 2))
    header = "Packet number,Gyr X (deg/s),Gyr Y (deg/s),Gyr Z (deg/s),Acc X (g),Acc Y (g),Acc Z (g)"
    path = written(tmp_path / "log.csv", (packets, GYRO / DEGREE, ACCEL / G), header)
    assert draft(path)["columns"]["time"] == {"rate": 50.0}  # by gravity's turns
    assert "CHECK time: the file has no clock" in (tmp_path / "campaign.toml").read_text()
    time, accel, _, attitude = moved()
    steps = 14 + (np.arange(len(time)) * 7) % 3  # 15 ms in the mean
    quaternion = np.tile(attitude.as_quat()[[3, 0, 1, 2]], (len(time), 1))
    path = written(tmp_path / "log.csv", (steps, quaternion, accel / G), "t,w,x,y,z,ax,ay,az")
    found = draft(path)["columns"]
    assert found["time"]["rate"] == pytest.approx(1000.0 / 15.0, rel=1e-3)
    assert found["accel"] == {"names": ["ax", "ay", "az"], "unit": "g"}  # not those of the attitude


def test_the_field_in_motion_tells_the_gyros_unit_where_the_force_does_not(tmp_path):
    """A multicopter's force stays along its axis, however it turns."""
    time, accel, gyro, _ = moved()
    attitude = Rotation.identity()
    field = np.empty_like(accel)
    for k, turn in enumerate(Rotation.from_rotvec(gyro / 100.0)):
        field[k] = attitude.inv().apply([20.0, 0.0, -45.0])
        attitude = attitude * turn
    along = np.array([0.0, 0.0, G]) + 0.5 * np.random.default_rng(1).normal(size=accel.shape)
    columns = (time, along, gyro, field + [12.0, -5.0, 30.0])
    path = written(tmp_path / "log.csv", columns, f"t,{CANONICAL},mx,my,mz")
    assert draft(path)["columns"]["gyro"]["unit"] == "rad/s"
    assert "the field turns as the outputs do" in (tmp_path / "campaign.toml").read_text()


def test_a_shaken_phone_does_not_turn_by_less_than_five_degrees_a_second(tmp_path):
    """A walk: the force tells no turn, for it goes as much to and fro as the phone tilts."""
    rng = np.random.default_rng(3)
    time = np.arange(3000) / 60.0
    walk = np.sin(2 * np.pi * 0.9 * time)[:, None] * [0.3, 0.4, 1.5]
    accel = np.array([1.0, 3.0, -9.0]) + walk + 0.4 * rng.normal(size=(3000, 3))
    gyro = 0.3 * rng.normal(size=(3000, 3))
    path = written(tmp_path / "walk.csv", (time, accel / G, gyro), f"t,{CANONICAL}")
    assert draft(path)["columns"]["gyro"]["unit"] == "rad/s"
    assert "CHECK gyro" in (tmp_path / "campaign.toml").read_text()
