"""A device that turns all along, as a car in circles: its own quietest stretches are no rests."""

import numpy as np
import pytest

from inertiax.data.recording import Recording
from inertiax.reduction.rests import find_rests


RATE, SECONDS = 50.0, 120.0


def one_pose(rate, *, accel_noise, gyro_noise, seed=0):
    """Upright, with white noise of a sample (m/s², rad/s) and a mean rate about z (rad/s) over time."""
    rng = np.random.default_rng(seed)
    time = np.arange(int(RATE * SECONDS)) / RATE
    accel = np.array([0.0, 0.0, 9.81]) + accel_noise * rng.normal(size=(len(time), 3))
    gyro = gyro_noise * rng.normal(size=(len(time), 3))
    gyro[:, 2] += rate(time)
    return Recording(time=time, accel=accel, gyro=gyro, name="log.csv")


def steered(time):
    """A circle at 18 °/s whose radius is held to a tenth, in tens of seconds."""
    wheel = np.sin(2 * np.pi * time / 23.0) + 0.7 * np.sin(2 * np.pi * time / 37.0 + 1.0)
    return np.radians(-18.0 + 1.8 * wheel)


def test_a_car_in_circles_does_not_rest():
    found = find_rests(one_pose(steered, accel_noise=0.3, gyro_noise=np.radians(1.0)), window=1.0)
    assert len(found.start) == 0
    assert found.statement == "no rest: it moves all along"


@pytest.mark.parametrize(
    "bias",
    [
        pytest.param(lambda t: np.full_like(t, np.radians(-18.0)), id="large"),
        pytest.param(lambda t: np.radians(3.0) * (1.0 - np.exp(-t / 40.0)), id="warming up"),
        pytest.param(lambda t: np.radians(1.0) * np.sin(2 * np.pi * 2.3 * t), id="tremor"),
    ],
)
def test_what_no_turn_makes_is_a_rest(bias):
    found = find_rests(one_pose(bias, accel_noise=0.05, gyro_noise=np.radians(0.3)), window=1.0)
    kept = float(np.sum(found.stop - found.start)) / (RATE * SECONDS)
    assert kept > 0.8


def test_a_bias_that_warms_up_quickly_is_no_motion_and_a_turn_about_the_vertical_is():
    """From a freezer, in one pose: the gyros' biases move by 50 mrad/s, a quarter of it in the first minute."""
    rng = np.random.default_rng(6)
    time = np.arange(0.0, 900.0, 0.02)
    warm = 1.0 - np.exp(-time / 200.0)
    gyro = np.outer(warm, [0.035, -0.02, 0.03]) + 1e-3 * rng.standard_normal((len(time), 3))
    accel = np.array([0.0, 0.0, 9.81]) + 0.02 * rng.standard_normal((len(time), 3))
    found = find_rests(Recording(time=time, accel=accel, gyro=gyro), window=1.0)
    assert found.start.tolist() == [0] and found.stop.tolist() == [len(time)]
    gyro[(time > 300.0) & (time < 330.0), 2] += 0.05
    found = find_rests(Recording(time=time, accel=accel, gyro=gyro), window=1.0)
    assert not any(time[a] < 315.0 < time[b - 1] for a, b in zip(found.start, found.stop))


def one_turn(rest, turn):
    """A table at rest, a turn about the vertical at 6 °/s, and a rest again (s), with a bias of 1 °/s."""
    time = np.arange(0.0, 2 * rest + turn, 1.0 / RATE)
    rng = np.random.default_rng(2)
    gyro = np.radians(1.0) + 2e-3 * rng.standard_normal((len(time), 3))
    turning = (time > rest) & (time < rest + turn)
    gyro[turning, 2] += np.radians(6.0)
    accel = np.array([0.0, 0.0, 9.81]) + 0.01 * rng.standard_normal((len(time), 3))
    return Recording(time=time, accel=accel, gyro=gyro, name="face.csv"), turning


@pytest.mark.parametrize("rest, turn", [(15.0, 60.0), (30.0, 60.0), (60.0, 30.0), (100.0, 720.0)])
def test_a_turn_that_lasts_longer_than_the_rests_is_none_of_them(rest, turn):
    recording, turning = one_turn(rest, turn)
    found = find_rests(recording, window=1.0)
    assert len(found.start) == 2
    for start, stop in zip(found.start, found.stop, strict=True):
        assert not turning[start:stop].any() and (stop - start) / RATE > 0.8 * rest
