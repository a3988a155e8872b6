"""Rests that were found in the data, and in which the device moved all the same."""

import numpy as np
import pytest

from inertiax.data.recording import Campaign, ModelChoice, Recording, Rig, Site
from inertiax.diagnose import diagnose
from inertiax.reduction.handling import knocked


RATE = 100.0  # Hz
WHITE = 1e-3  # rad/s, of one sample


def rests(num, seconds, rng):
    """Gyros over rests that each begin anew: values, time and number of the rest, in blocks of 0.1 s."""
    size = round(10 * seconds)
    gyro = 3e-4 * rng.standard_normal((num * size, 3))
    dwell = np.repeat(np.arange(num), size)
    time = np.arange(num * size) * 0.1 + 5.0 * dwell
    return gyro, time, dwell


def test_nothing_moved_where_nothing_did():
    gyro, time, dwell = rests(20, 8.0, np.random.default_rng(1))
    # A bias that wanders slowly, and one that differs from rest to rest, are the sensor's.
    gyro += 5e-3 * np.sin(time / 40.0)[:, None] + 0.01 * (dwell % 3)[:, None]
    assert not knocked(gyro, time, dwell).any()


def test_a_knock_goes_with_half_a_second_around_it_and_the_ends_of_the_rests():
    gyro, time, dwell = rests(20, 8.0, np.random.default_rng(2))
    hit = (dwell == 7) & (np.abs(time - time[dwell == 7][40]) < 0.15)
    gyro[hit] += [0.02, 0.0, -0.01]
    moved = knocked(gyro, time, dwell)
    assert moved[hit].all()
    # Three blocks, five to each side, and five at each end of the rest.
    assert moved[dwell == 7].sum() == 3 + 2 * 5 + 2 * 5
    assert (np.bincount(dwell, moved)[np.arange(20) != 7] == 10).all()


def test_a_rest_held_by_hand_goes_whole():
    rng = np.random.default_rng(3)
    gyro, time, dwell = rests(20, 8.0, rng)
    gyro[dwell == 4] += 5e-3 * rng.standard_normal((80, 3))
    moved = knocked(gyro, time, dwell)
    assert moved[dwell == 4].all() and not moved[dwell == 5].all()


def test_where_most_is_motion_nothing_is_known_of_rest():
    rng = np.random.default_rng(4)
    gyro, time, dwell = rests(20, 8.0, rng)
    gyro[dwell < 10, 0] += 0.1 * rng.standard_cauchy(800)
    gyro[(dwell >= 10) & (np.arange(1600) % 5 == 0), 1] += 0.1
    assert not knocked(gyro, time, dwell).any()


def hand_turned(labelled, rng, disturbed=True):
    """Twelve rests of 10 s in random poses joined by turns of 2 s; one of the rests is knocked 2 s before its end."""
    poses = rng.standard_normal((12, 3))
    poses *= 9.81 / np.linalg.norm(poses, axis=1)[:, None]
    accel, gyro, position = [], [], []
    for k, pose in enumerate(poses):
        accel.append(np.tile(pose, (1000, 1)))
        gyro.append(np.zeros((1000, 3)))
        position += [np.full(1000, k)]
        if k < 11:
            share = np.linspace(0.0, 1.0, 200)[:, None]
            accel.append(pose + share * (poses[k + 1] - pose))
            gyro.append(np.tile(rng.uniform(0.5, 1.5, 3), (200, 1)))
            position += [np.full(200, -1)]
    accel, gyro, position = map(np.concatenate, (accel, gyro, position))
    if disturbed:
        at = 5 * 1200 + 800
        gyro[at : at + 30] += [0.03, 0.004, -0.02]
    gyro = gyro + [0.01, -0.02, 0.005] + WHITE * rng.standard_normal(gyro.shape)
    accel = accel + 0.03 * rng.standard_normal(accel.shape)
    recording = Recording(
        time=np.arange(len(gyro)) / RATE,
        accel=accel,
        gyro=gyro,
        position=position if labelled else None,
    )
    model = ModelChoice("invariant", "static", False, 0)
    return Campaign((recording,), Site(9.81), Rig(), model)


def test_a_knock_is_left_out_and_said_where_the_rests_were_found():
    found = diagnose(hand_turned(False, np.random.default_rng(5)))
    assert found.verdict == "consistent"
    (line,) = found.left_out
    assert line.startswith("gyro: ") and "position" in line
    assert line in found.as_dict()["notes"]


def test_a_knock_is_judged_where_the_positions_say_that_the_device_rested():
    found = diagnose(hand_turned(True, np.random.default_rng(5)))
    assert found.verdict != "consistent" and not found.left_out
    assert {w.channel.split("_")[0] for w in found.where} == {"gyro"}


@pytest.mark.parametrize("labelled", [True, False])
def test_nothing_is_left_out_of_quiet_rests(labelled):
    assert not diagnose(hand_turned(labelled, np.random.default_rng(6), disturbed=False)).left_out
