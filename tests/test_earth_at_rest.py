"""Earth's rate in a hand log's gyros: its vertical part is taken away, and its horizontal part is an uncertainty.

The log is made here: a device at rest in random attitudes of random headings, turned between them, in a room that
turns with the Earth.
"""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from inertiax.calibrate.pipeline import calibrate_device
from inertiax.data.recording import Campaign, ModelChoice, Recording, Rig, Site
from inertiax.diagnose import diagnose
from inertiax.diagnose.observations.motion_rows import motion_rows
from inertiax.diagnose.pipeline import diagnose_campaign
from inertiax.diagnose.problem import prepare
from inertiax.reduction.dwell_means import reduce_to_dwells
from inertiax.reduction.dwells import Dwells
from inertiax.reduction.earth_at_rest import (
    horizontal_covariance,
    untold_heading_covariance,
    vertical_earth_rate,
)
from inertiax.reduction.rig_errors import with_rig_errors


G, LATITUDE, OMEGA = 9.81, math.radians(48.2), 7.292115e-5
EARTH = OMEGA * np.array([0.0, np.cos(LATITUDE), np.sin(LATITUDE)])  # east, north, up
BIAS = np.array([2e-4, -1e-4, 3e-4])  # rad/s
SITE = Site(G, LATITUDE)


def log(seed, rests=24, seconds=1.5, told=False):
    """Rests of 8 s at 50 Hz; so many seconds of turning to the next, about an axis of the case; `told` the rates."""
    rng = np.random.default_rng(seed)
    attitude, force, rate = Rotation.random(random_state=seed), [], []
    for _ in range(rests):
        force.append(np.tile(attitude.inv().apply([0, 0, G]), (400, 1)))
        rate.append(np.tile(attitude.inv().apply(EARTH), (400, 1)))
        axis = rng.standard_normal(3)
        turn = rng.uniform(0.8, 1.6) * axis / np.linalg.norm(axis)
        steps = round(50 * seconds)
        for part in np.diff(0.5 - 0.5 * np.cos(np.pi * np.arange(steps + 1) / steps)):
            step = Rotation.from_rotvec(part * turn)
            middle = attitude * Rotation.from_rotvec(0.5 * part * turn)
            force.append(middle.inv().apply([[0, 0, G]]))
            rate.append(50.0 * part * turn[None] + middle.inv().apply(EARTH[None]))
            attitude = attitude * step
    force, rate = np.concatenate(force), np.concatenate(rate)
    force = force + 1e-3 * rng.standard_normal(force.shape)
    gyro = rate + BIAS + 1e-5 * rng.standard_normal(rate.shape)
    known = rate if told else None
    return Recording(
        time=np.arange(len(force)) / 50.0, accel=force, gyro=gyro, reference_gyro=known
    )


def test_the_vertical_part_is_that_of_the_rotated_case():
    r = Rotation.random(20, random_state=3)
    force = r.inv().apply([0.0, 0.0, G])
    vertical = r.inv().apply([0.0, 0.0, EARTH[2]])
    np.testing.assert_allclose(vertical_earth_rate(force, SITE), vertical, rtol=1e-12)
    assert not vertical_earth_rate(force, Site(G)).any()
    assert not vertical_earth_rate(3.0 * force, SITE).any()  # not gravity: the device moves


@pytest.mark.slow
def test_biases_are_those_of_the_sensor_within_what_the_heading_leaves():
    """At each of eight logs; without the latitude they are off by up to Earth's rate."""
    scores = []
    for seed in range(8):
        found = calibrate_device(Campaign((log(seed),), SITE)).calibration.gyro
        covariance = np.asarray(found.covariance)[:3, :3]
        error = np.asarray(found.curve.coefficients)[0, :3] - BIAS
        scores.append(error @ np.linalg.inv(covariance) @ error)
    # χ² of 24 degrees of freedom: below 43 in 99 of 100 runs, above 6 by rests that show no more than they state. The
    # heading's draw is counted beside the scatter that rests show of it, so that the sum may well be small.
    assert 6.0 < np.sum(scores) < 43.0


@pytest.mark.parametrize("latitude", [LATITUDE, None])
def test_a_fitted_g_sensitivity_holds_no_earth_rate_with_the_latitude(latitude):
    """D of the vertical part alone: Ω sin φ on the diagonal."""
    model = ModelChoice(g_sensitivity=True)
    found = calibrate_device(Campaign((log(1),), Site(G, latitude), model=model)).calibration.gyro
    d = np.asarray(found.curve.coefficients)[0, 12:].reshape(3, 3)
    mean = np.trace(d) / 3.0
    sigma = np.sqrt(np.asarray(found.covariance)[[12, 16, 20], [12, 16, 20]].mean() / 3.0)
    truth = 0.0 if latitude is not None else EARTH[2]
    assert abs(mean - truth) < 4.0 * sigma and sigma < 0.3 * EARTH[2]


def test_one_attitude_is_one_draw_and_many_are_many():
    """A bar on its side in one heading: no number of rests averages it."""
    recording = log(2)
    one = Recording(
        time=np.arange(4000) / 50.0,
        accel=np.tile([0.0, 0.0, G], (4000, 1)) + 1e-3 * np.random.default_rng(0).standard_normal((4000, 3)),
        gyro=np.zeros((4000, 3)),
        position=np.repeat(np.arange(10), 400),
    )  # fmt: skip
    level = 0.5 * (OMEGA * np.cos(LATITUDE)) ** 2
    alone = horizontal_covariance(reduce_to_dwells([one]), SITE)
    np.testing.assert_allclose(alone, np.diag([level, level, 0.0]), atol=1e-3 * level)
    # Caps of 45° have a seventh of the sphere: six to fourteen of them hold all directions.
    many = np.trace(horizontal_covariance(reduce_to_dwells([recording]), SITE))
    assert 2.0 * level / 14.0 < many < 2.0 * level / 5.0


def test_what_became_of_it_is_said():
    said = calibrate_device(Campaign((log(1),), SITE)).choices
    assert any("along the vertical, 11.2 °/h by the latitude, is taken away" in s for s in said)
    said = calibrate_device(Campaign((log(1),), Site(G))).choices
    assert any("up to 15.0 °/h, is part of the biases; [site] latitude" in s for s in said)


@pytest.mark.slow
def test_a_diagnosis_calls_it_no_g_sensitivity():
    without = diagnose(Campaign((log(1),), Site(G), grade="tactical"))
    assert "g_sensitivity" in [e.name for e in without.effects]
    found = diagnose(Campaign((log(1),), SITE, grade="tactical"))
    assert "g_sensitivity" not in [e.name for e in found.effects]


def test_rests_whose_reference_tells_no_heading_err_by_all_that_headings_give():
    """Drawn: 40 000 headings of a case with its x axis down, of what the vertical part alone leaves out."""
    heading = np.random.default_rng(4).uniform(0.0, 2.0 * np.pi, 40_000)
    level = (
        OMEGA * np.cos(LATITUDE) * np.stack([0.0 * heading, np.cos(heading), np.sin(heading)], 1)
    )
    down = np.array([[-1.0, 0.0, 0.0]])
    (found,) = untold_heading_covariance(
        np.zeros(1, int), EARTH[2] * down, G * down, np.full(1, 9.0)
    )
    drawn = level.T @ level / len(level)
    # A variance of cos² is known to sqrt(1/8 / 40 000) / (1/2) = 0.35 % of itself.
    np.testing.assert_allclose(found, drawn, atol=0.018 * found.max())


def test_plateaus_keep_what_a_mean_over_part_of_a_turn_leaves():
    """By sums over the angle that a table runs through, from all headings, beside a rest that tells no heading."""
    up, level = np.array([0.0, 0.0, 1.0]), OMEGA * np.cos(LATITUDE)
    degrees = np.array([20.0, 60.0, 200.0])  # a second, for 4 s: 80°, 240° and 800°
    rate = np.outer(np.r_[0.0, np.radians(degrees)] + EARTH[2], up)
    force = np.outer([G, 0.0, 0.0, 0.0], up)
    found = untold_heading_covariance(np.array([0, -1, -1, -1]), rate, force, np.full(4, 4.0))
    start = np.linspace(0.0, 2.0 * np.pi, 360, endpoint=False)[:, None]
    for k, speed in enumerate(np.radians(degrees), 1):
        angle = start + speed * (np.arange(4000) + 0.5) / 1000.0
        kept = np.mean(np.square(level * np.cos(angle).mean(axis=1)))
        # Earth's own vertical rate turns the case by 3e-4 of 20 °/s.
        np.testing.assert_allclose(np.diagonal(found[k]), [kept, kept, 0.0], rtol=2e-3)
    assert not untold_heading_covariance(np.full(3, -1), rate[1:], force[1:], np.full(3, 4.0)).any()


@pytest.mark.parametrize(
    ("rate", "position", "told"),
    [
        ([0.0, 0.0, EARTH[2]], 0, False),
        ([0.0, 0.0, EARTH[2]], -1, True),  # a slow turn is no rest
        ([0.0, 0.0, 0.0], 0, True),  # a station that leaves the Earth out altogether
        (EARTH, 0, True),
        ([0.0, EARTH[2], 0.0], 0, True),  # across gravity
    ],
)
def test_only_a_reference_of_the_vertical_part_alone_leaves_the_heading_out(rate, position, told):
    up, noise = np.array([[0.0, 0.0, G]]), 1e-14 * np.eye(3)[None]
    one = Dwells(
        time=np.zeros(1), duration=np.full(1, 5.0), count=np.full(1, 90.0), temperature=np.full(1, 20.0),
        experiment=np.zeros(1, int), position=np.array([position]), valid=np.ones(1, bool),
        accel=up, reference_accel=up, gyro=np.array([rate]), gyro_covariance=noise, reference_gyro=np.array([rate]),
    )  # fmt: skip
    made = np.diagonal(np.asarray(with_rig_errors(one, Rig()).gyro_covariance)[0])
    across = 0.0 if told else 0.5 * (OMEGA * np.cos(LATITUDE)) ** 2
    np.testing.assert_allclose(made, 1e-14 + across * np.array([1.0, 1.0, 0.0]), rtol=1e-9)


@pytest.mark.slow
def test_a_table_with_a_vertical_axis_knows_what_its_headings_leave_of_the_gyros():
    """Eight draws of six faces, each rested on twice in headings of their own and turned on at ± 60 °/s between."""
    scores = []
    for seed in range(8):
        rng, recordings = np.random.default_rng(seed), []
        for up in (*np.eye(3), *-np.eye(3)):
            rate = np.repeat(np.radians([0.0, 60.0, -60.0, 0.0]), 500)
            level = np.cross(up, rng.standard_normal((4, 3)))
            level *= np.hypot(EARTH[0], EARTH[1]) / np.linalg.norm(level, axis=1, keepdims=True)
            level[1:3] = 0.0  # of whole turns the mean is nothing
            told = np.outer(rate + EARTH[2], up)
            gyro = (
                told + np.repeat(level, 500, axis=0) + BIAS + 2e-4 * rng.standard_normal(told.shape)
            )
            force = np.outer(np.where(rate == 0.0, G, 0.0), up)
            recordings.append(
                Recording(
                    np.arange(2000) / 50.0,
                    force + 1e-3 * rng.standard_normal(told.shape),
                    gyro,
                    device="d",
                    reference_accel=force,
                    reference_gyro=told,
                    position=np.repeat([0, -1, -1, 1], 500),
                )  # fmt: skip
            )
        found = calibrate_device(Campaign(tuple(recordings), SITE)).calibration.gyro
        assert found is not None
        sigma = np.asarray(found.standard_deviations(20.0))[:3]
        scores.append((np.asarray(found.parameters(20.0))[:3] - BIAS) / sigma)
    # 24 numbers: a root mean square is known to 1 / sqrt(48) = 14 %; within three of them.
    assert np.sqrt(np.mean(np.square(scores))) == pytest.approx(1.0, abs=0.43)


@pytest.mark.slow
def test_the_calibration_beside_a_named_effect_has_earth_rate_taken_away_once():
    """A log with and without 300 µg/g² on an axis that is named: the gyros' biases are the same."""
    plain = log(1)
    force = plain.accel.copy()
    force[:, 0] += 3e-4 / G * np.square(force[:, 0])
    campaigns = [Campaign((replace(plain, accel=a),), SITE) for a in (plain.accel, force)]
    (_, before), (found, after) = (diagnose_campaign(c) for c in campaigns)
    assert [e.name for e in found.effects] == ["second_order"] and after.effects
    change = np.asarray(after.gyro.curve.coefficients)[0, :3]
    change = change - np.asarray(before.gyro.curve.coefficients)[0, :3]
    assert np.abs(change).max() < 0.01 * OMEGA


@pytest.mark.slow
def test_gravity_turns_with_the_earth_while_the_device_moves_where_a_reference_tells_it():
    model = ModelChoice(gyro_estimator="gravity")
    slow = log(2, rests=16, seconds=20.0, told=True)
    found = calibrate_device(Campaign((slow,), SITE, model=model)).gyro
    # Earth's horizontal rate turns gravity by 0.97 mrad in 20 s; noise of 1e-5 rad/s at 50 Hz by 6 µrad.
    assert found.rms < 1.5e-4
    matrix = [k for k, name in enumerate(found.estimator.names) if "matrix" in name]
    off = np.asarray(found.solution.curve.coefficients)[0][matrix]
    assert np.abs(off).max() < 5e-4


def test_a_diagnosis_of_a_hand_log_has_its_motions_whether_or_not_the_latitude_is_known():
    for site in (Site(G), SITE):
        problem = prepare(Campaign((log(1),), site))
        rows = motion_rows(problem.campaign, problem.log, problem.fitted)
        assert rows is not None and rows.blocks.num_blocks == 46  # two of each of 23


@pytest.mark.slow
def test_a_diagnosis_of_gravitys_turn_beside_a_reference_misses_no_earth_rate():
    model = ModelChoice(gyro_estimator="gravity")
    slow = log(2, rests=16, seconds=20.0, told=True)
    found = diagnose(Campaign((slow,), SITE, model=model, grade="tactical"))
    assert found.verdict == "consistent"
