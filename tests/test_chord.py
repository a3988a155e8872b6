"""Rests that a hand turns slowly: the mean of a force that turns is shorter than the force."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from inertiax import reduce_to_dwells
from inertiax.calibrate.pipeline import calibrate
from inertiax.data.recording import Campaign, Recording, Rig, Site
from inertiax.diagnose.observations.blocks import cut, join
from inertiax.reduction.chord import shortening


G, RATE = 9.81, 100.0


def test_a_turn_at_a_constant_rate_shortens_the_mean_as_the_chord_of_its_arc():
    """sin(α/2) / (α/2) of an arc α, here 0.1 rad: 1 − 4.166e-4."""
    angle = (np.arange(3200) + 0.5) / 3200 * 0.1
    force = G * np.stack([np.sin(angle), np.zeros(3200), np.cos(angle)], axis=1)
    exact = 1.0 / (np.sin(0.05) / 0.05) - 1.0
    (found,) = shortening(force, np.array([0]))
    # Within a part of a thirty-second the arc is shorter by a thousandth of it, and noise is none.
    assert found == pytest.approx(exact, rel=2e-3)
    mean = np.linalg.norm(force.mean(axis=0)) * (1.0 + found)
    assert abs(mean / G - 1.0) < 1e-6


def test_noise_and_single_samples_are_no_turn():
    rng = np.random.default_rng(0)
    still = np.array([0.3, 0.5, G]) + 0.05 * rng.standard_normal((80_000, 3))
    found = shortening(still, 400 * np.arange(200))
    assert (
        np.mean(found > 0.0) < 0.02 and found.max() < 5e-6
    )  # of 200, where noise gives 1 ppm to each
    assert not shortening(still[:7], np.array([0, 1, 4])).any()
    turned = still.copy()
    turned[:400, 0] += np.linspace(-0.5, 0.5, 400)
    first = shortening(turned, 400 * np.arange(200))[0]
    assert first == pytest.approx((0.5 / G) ** 2 / 6.0, rel=0.1)  # variance of the angle, halved


def swaying(seed, sway=0.03):
    """24 rests of 4 s that a hand holds, turning slowly by some degrees, and turns between them; SciPy's rotations."""
    rng = np.random.default_rng(seed)
    matrix = np.eye(3) + np.tril(0.005 * rng.standard_normal((3, 3)))
    force, t = [], np.arange(400) / RATE
    pose = Rotation.random(None, rng)
    for _ in range(24):
        slow = sum(
            rng.normal(0.0, sway, 3) * np.sin(2 * np.pi * f * t + rng.uniform(0, 6.3))[:, None]
            for f in (0.15, 0.4, 0.9)
        )
        held = pose * Rotation.from_rotvec(slow)
        following = Rotation.random(None, rng)
        share = 0.5 - 0.5 * np.cos(np.pi * np.arange(1, 101) / 100)
        between = (held[-1].inv() * following).as_rotvec()
        moved = held[-1] * Rotation.from_rotvec(share[:, None] * between)
        force += [r.inv().apply([0.0, 0.0, G]) for r in (held, moved)]
        pose = following
    force = np.concatenate(force) @ matrix.T + rng.normal(0.0, 0.1, 3)
    accel = force + 0.02 * rng.standard_normal(force.shape)
    position = np.tile(np.repeat([0, -1], [400, 100]), 24)
    position[position == 0] = np.repeat(np.arange(24), 400)
    return Recording(np.arange(len(accel)) / RATE, accel=accel, position=position), matrix


def test_scale_factors_of_a_hand_that_sways_are_not_too_small():
    """Of these rests the means are shorter by 600 ppm, and the scale factors were, by 4 of their sigmas."""
    errors, sigmas = [], []
    for seed in range(3):
        recording, matrix = swaying(seed)
        (result,) = calibrate(Campaign((recording,), Site(gravity=G), Rig()))
        names, found = result.accel.estimator.names, result.calibration.accel
        at = [names.index(f"accel.matrix[{k},{k}]") for k in range(3)]
        errors.append(np.asarray(found.curve.coefficients)[0, at] - np.diag(matrix) + 1.0)
        sigmas.append(np.sqrt(np.diag(found.covariance))[at])
    errors, sigmas = np.concatenate(errors), np.concatenate(sigmas)
    assert np.all(np.abs(errors) < 4.0 * sigmas)
    assert abs(errors.mean()) < 1e-4


def test_a_diagnosis_sees_the_same_length():
    recording, _ = swaying(0)
    dwells = reduce_to_dwells(recording)
    campaign = Campaign((recording,), Site(gravity=G), Rig())
    blocks = cut(join(campaign))
    length = lambda x: np.linalg.norm(x, axis=1)
    weight = blocks.count[:, None]
    for k in (0, 7, 23):
        mine = blocks.position == k
        by_blocks = (length(blocks.accel[mine]) * weight[mine, 0]).sum() / weight[mine].sum()
        by_dwell = length(dwells.accel[dwells.position == k])[0]
        assert by_blocks == pytest.approx(by_dwell, abs=3e-3)  # 0.3 of 6 mm/s² that turning takes
