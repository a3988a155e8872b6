"""What the rig promises enters the covariances of dwells and so the standard deviations of the answer."""

import jax
import numpy as np
import pytest

from inertiax.calibrate.pipeline import calibrate_device
from inertiax.data.recording import Campaign, ModelChoice, Recording, Rig, Site
from inertiax.reduction.dwells import Dwells
from inertiax.reduction.rig_errors import rig_covariance, with_rig_errors


G = 9.81
ANGLE, RATE = 1e-3, 2e-3


def test_the_covariance_is_that_of_drawn_errors():
    rng = np.random.default_rng(1)
    given = np.array([3.0, -2.0, 8.0])
    turn, scale = (
        ANGLE * rng.standard_normal((200_000, 3)),
        1.0 + RATE * rng.standard_normal((200_000, 1)),
    )
    drawn = np.cov((scale * given + np.cross(turn, given)).T)
    # 2e5 draws: a variance is known to sqrt(2 / 2e5) = 0.3 %; five of them, of the largest.
    exact = rig_covariance(given, ANGLE, RATE)
    np.testing.assert_allclose(drawn, exact, atol=0.016 * exact.max())


def faces(rig, turned, seed):
    """Six faces of 10 s twice, with a reference that is off by `turned` rad at each positioning."""
    rng = np.random.default_rng(seed)
    poses = np.concatenate([np.eye(3), -np.eye(3)] * 2) * G
    angle = turned * rng.standard_normal((12, 3))
    position = np.repeat(np.arange(12), 100)
    accel = (poses + np.cross(angle, poses))[position] + 1e-4 * rng.standard_normal((1200, 3))
    accel[:, 0] += 0.05
    recording = Recording(
        0.1 * np.arange(1200), accel=accel, reference_accel=poses[position], position=position
    )
    model = ModelChoice(accel_estimator="reference", temperature_degree=0)
    return Campaign((recording,), Site(G), rig, model)


def test_a_promise_widens_standard_deviations_as_a_hand_calculation_says():
    with jax.enable_x64(True):
        found = calibrate_device(faces(Rig(position_uncertainty=ANGLE), 0.0, 2)).calibration
    assert found.accel is not None
    sigma = dict(zip(found.accel.names, found.accel.standard_deviations(20.0)))
    # The bias of x is the mean over twelve dwells; eight of them, off the x axis, err by ANGLE g.
    # Weighted: the four along x err by the dwell's noise alone, 1e-5, and tell bias and scale between them.
    assert float(sigma["accel.bias[0]"]) == pytest.approx(1e-5 / np.sqrt(4), rel=0.3)
    # A misalignment is told by the dwells along the other axis: four of ±g with errors of ANGLE g.
    assert float(sigma["accel.matrix[0,1]"]) == pytest.approx(ANGLE / np.sqrt(4), rel=0.05)


@pytest.mark.slow
def test_stated_and_actual_errors_agree():
    # 60 campaigns whose rig errs as promised: the normalised misalignment has unit variance to sqrt(2 / 60) = 18 %.
    with jax.enable_x64(True):
        errors = []
        for seed in range(60):
            triad = calibrate_device(
                faces(Rig(position_uncertainty=ANGLE), ANGLE, seed)
            ).calibration.accel
            assert triad is not None
            at = triad.names.index("accel.matrix[0,1]")
            value = float(np.asarray(triad.curve.coefficients)[0, at])
            errors.append(value / float(triad.standard_deviations(20.0)[at]))
    assert 0.5 < np.mean(np.square(errors)) < 1.6


def test_a_probe_that_is_off_moves_the_curve_along_its_slope():
    # Bias of x of 2 mm/s² per °C, faces warmed from 10 to 30 °C, a probe promised to 0.5 °C: 1 mm/s² of the bias.
    position = np.repeat(np.arange(24), 50)
    temperature = 10.0 + 20.0 * np.arange(1200) / 1199
    poses = np.concatenate([np.eye(3), -np.eye(3)] * 4) * G
    accel = poses[position] + 1e-5 * np.random.default_rng(3).standard_normal((1200, 3))
    accel[:, 0] += 2e-3 * temperature
    recording = Recording(
        0.1 * np.arange(1200), accel=accel, reference_accel=poses[position], position=position,
        temperature=temperature[:, None],
    )  # fmt: skip
    model = ModelChoice(accel_estimator="reference", temperature_degree=1)
    campaign = Campaign((recording,), Site(G), Rig(temperature_uncertainty=0.5), model)
    with jax.enable_x64(True):
        triad = calibrate_device(campaign).calibration.accel
        assert triad is not None
        sigma = dict(zip(triad.names, triad.standard_deviations(15.0)))
    assert float(sigma["accel.bias[0]"]) == pytest.approx(1e-3, rel=0.02)
    assert float(sigma["accel.bias[1]"]) < 1e-4


def test_pieces_of_one_long_rest_share_its_positioning():
    """Rest 3 is four dwells: one number for them. Three single rests have their own error in their covariance."""
    segment = np.array([0, 1, 2, 3, 3, 3, 3])
    rows = np.stack(
        [np.zeros(7, int), 100 * np.arange(7), 100 * np.arange(7) + 90, segment], axis=1
    )
    up = np.concatenate([9.81 * np.eye(3), np.tile([0.0, 0.0, 9.81], (4, 1))])
    noise = np.tile(1e-8 * np.eye(3), (7, 1, 1))
    made = with_rig_errors(
        Dwells(
            time=np.arange(7.0), duration=np.full(7, 5.0), count=np.full(7, 90.0), temperature=np.full(7, 20.0),
            experiment=np.zeros(7, int), position=np.array([0, 1, 2, 2, 2, 2, 2]), valid=np.ones(7, bool),
            accel=up, accel_covariance=noise, reference_accel=up, rows=rows,
        ),
        Rig(position_uncertainty=1e-4),
    )  # fmt: skip
    np.testing.assert_array_equal(made.positioning, [-1, -1, -1, 0, 0, 0, 0])
    np.testing.assert_array_equal(made.shared_angle, [0, 0, 0, 1e-4, 1e-4, 1e-4, 1e-4])
    # By hand: 1e-4 rad turn 9.81 m/s² by 9.81e-4 across it.
    np.testing.assert_allclose(
        np.diagonal(made.accel_covariance[2]), [9.81e-4**2 + 1e-8, 9.81e-4**2 + 1e-8, 1e-8]
    )
    np.testing.assert_allclose(made.accel_covariance[3], noise[3])


UP = np.array([0.0, 0.0, 1.0])
MOUNTED = 3e-4  # rad, of a device put into a fixture by hand


@pytest.mark.parametrize(
    ("turned", "recording", "attitude", "shared"),
    [
        (UP, [0, 0, 0, 0], UP, True),  # a staircase about the vertical: it stands as it did
        (UP, [0, 0, 0, 1], UP, False),  # mounted anew
        (UP, [0, 0, 0, 0], [0.0, 1.0, 0.0], False),  # another face up
        ([1.0, 0.0, 0.0], [0, 0, 0, 0], UP, False),  # about a level axis, and back
    ],
    ids=["vertical", "recording", "face", "level"],
)
def test_rests_before_and_after_turns_about_the_vertical_share_their_positioning(
    turned, recording, attitude, shared
):
    """Two rests with plateaus of ± 1 rad/s between them."""
    place = np.arange(4)
    rows = np.stack([recording, 100 * place, 100 * place + 90, place], axis=1)
    force = 9.81 * np.array([UP, np.zeros(3), np.zeros(3), attitude])
    rate = np.outer([0.0, 1.0, -1.0, 0.0], turned)
    made = with_rig_errors(
        Dwells(
            time=np.arange(4.0), duration=np.full(4, 5.0), count=np.full(4, 90.0), temperature=np.full(4, 20.0),
            experiment=np.zeros(4, int), position=np.array([0, -1, -1, 1]), valid=np.ones(4, bool),
            accel=force, accel_covariance=np.tile(1e-8 * np.eye(3), (4, 1, 1)), reference_accel=force,
            reference_gyro=rate, rows=rows,
        ),
        Rig(position_uncertainty=1e-4),
    )  # fmt: skip
    rests = np.asarray(made.positioning)[[0, 3]]
    assert (rests[0] == rests[1]) and (rests[0] >= 0) == shared
    expected = 1e-8 + (0.0 if shared else 9.81e-4**2)  # across, by hand
    np.testing.assert_allclose(made.accel_covariance[0][0, 0], expected)


def test_six_mountings_on_a_table_with_a_vertical_axis_show_biases_beyond_the_mountings():
    """A fixture's six faces, each rested on, turned on and rested on again. What a mounting is off moves the
    misalignments by α/√2, of two mountings, and biases and scale factors by α² alone."""
    rng = np.random.default_rng(5)  # mountings that differ by half as much again as is stated
    faces = np.concatenate([np.eye(3), -np.eye(3)])
    staircase = np.radians([0.0, 30.0, -30.0, 90.0, -90.0, 0.0])
    bias = np.array([0.2, -0.1, 0.15])
    recordings = []
    for k, up in enumerate(faces):
        felt = G * (up + np.cross(MOUNTED * rng.standard_normal(3), up))
        rate = np.repeat(np.outer(staircase, up), 200, axis=0)
        rests = np.all(rate == 0.0, axis=1)
        recordings.append(
            Recording(
                time=np.arange(len(rate)) / 20.0,
                accel=felt + bias + 2e-3 * rng.standard_normal(rate.shape),
                gyro=rate + 1e-3 * rng.standard_normal(rate.shape),
                reference_accel=np.where(rests[:, None], G * up, 0.0),
                reference_gyro=rate,
                position=np.where(rests, k, -1),
                name=f"{k}.csv",
            )
        )
    model = ModelChoice(
        accel_estimator="reference", gyro_estimator="reference", temperature_degree=0
    )
    campaign = Campaign(tuple(recordings), Site(G), Rig(position_uncertainty=MOUNTED), model)
    with jax.enable_x64(True):
        triad = calibrate_device(campaign).calibration.accel
        assert triad is not None
        sigma = dict(zip(triad.names, np.asarray(triad.standard_deviations(20.0))))
        found = np.asarray(triad.parameters(20.0))
    for i in range(3):
        # Four means of 200 rows along the axis: 2e-3/√800 = 7e-5 m/s². With mountings drawn anew at each rest the two
        # rests of one would look like ten times the noise in every direction: 8e-4.
        assert sigma[f"accel.bias[{i}]"] < 2e-4
        assert found[i] == pytest.approx(bias[i], abs=4.0 * 7e-5)
    # Two mountings tell each: α/√2, and more as these differ by more.
    assert 1.0 < sigma["accel.matrix[0,1]"] / (MOUNTED / np.sqrt(2.0)) < 2.0
