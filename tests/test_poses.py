"""Poses are counted by what turned: logs made in NumPy whose truth is how they were made."""

import numpy as np
import pytest

from inertiax.data.recording import Campaign, Recording, Site
from inertiax.model_selection.poses import directions
from inertiax.model_selection.select_model import choose_model, settle_accel
from inertiax.reduction.dwell_means import reduce_to_dwells


RATE, G = 50.0, 9.81
DRIFT = np.array([0.9, -0.4, 0.2])  # m/s², from cold to warm: 5.7° of gravity's direction


def _warm_up(*, knocks=(), turns=(), seconds=240.0):
    """One pose from 20 to 58 °C, knocked at some times (s), and turned about x by some angles (rad) within 2 s."""
    rng = np.random.default_rng(4)
    time = np.arange(0.0, seconds, 1.0 / RATE)
    warm = 1.0 - np.exp(-time / 80.0)
    angle, rate = np.zeros_like(time), np.zeros_like(time)
    for at, by in turns:
        angle += by * np.clip((time - at) / 2.0, 0.0, 1.0)
        rate += by / 2.0 * ((time >= at) & (time < at + 2.0))
    force = G * np.stack([np.zeros_like(angle), np.sin(angle), np.cos(angle)], axis=1)
    accel = force + np.outer(warm, DRIFT) + 0.01 * rng.standard_normal((len(time), 3))
    gyro = np.outer(warm, [0.01, -0.02, 0.01]) + 1e-3 * rng.standard_normal((len(time), 3))
    gyro[:, 0] += rate
    for at in knocks:
        hit = (time >= at) & (time < at + 1.5)
        swing = np.sin(2 * np.pi * (time[hit] - at) / 1.5)
        gyro[hit] += 0.3 * swing[:, None] * np.array([1.0, 0.5, -0.7])  # there and back
        accel[hit] += 3.0 * rng.standard_normal((hit.sum(), 3))
    return Recording.from_arrays(time, accel, gyro, 20.0 + 38.0 * warm)


def _settled(recording):
    campaign = Campaign(recording, Site(G))
    dwells = reduce_to_dwells(recording)
    chosen, warning = settle_accel(campaign, choose_model(campaign, [recording]), dwells)
    return directions(dwells, [recording]), chosen.accel_estimator, warning


def test_a_bias_that_drifts_in_one_pose_makes_no_second_one():
    recording = _warm_up()
    ends = recording.accel[[0, -1]]
    units = ends / np.linalg.norm(ends, axis=1, keepdims=True)
    assert np.degrees(np.arccos(units[0] @ units[1])) > 5.0  # which two poses differ by
    assert _settled(recording) == (1, "static", None)


def test_rests_between_which_the_gyros_do_not_turn_are_one_pose():
    recording = _warm_up(knocks=(30.0, 75.0, 140.0))
    where = np.asarray(reduce_to_dwells(recording).rows)
    assert len(np.unique(where[:, 3])) > 1  # several rests
    assert _settled(recording) == (1, "static", None)


@pytest.mark.parametrize("gyros", [True, False])
def test_rests_between_which_the_device_turned_are_several(gyros):
    recording = _warm_up(turns=((60.0, np.radians(8.0)), (120.0, np.radians(30.0))))
    if not gyros:
        recording = Recording.from_arrays(
            recording.time, recording.accel, None, recording.temperature
        )
    found, estimator, warning = _settled(recording)
    assert found == 3
    if gyros:
        assert estimator is None and "the rests show 3 directions" in warning
        assert "if it was one pose that warmed up, [model] accel_estimator = 'static'" in warning
