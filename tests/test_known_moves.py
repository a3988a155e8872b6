"""Moves from rest to rest as rows for gyros of a table that turns at constant rate about one axis alone.

The table, its rotations (SciPy's) and the device are made here, by no function of the package.
"""

import dataclasses

import numpy as np
import pytest

from inertiax.calibrate.pipeline import calibrate_device
from inertiax.data.campaign import load_campaign
from inertiax.data.formats.table_rates import rates_of_angles
from inertiax.diagnose.pipeline import diagnose_campaign
from inertiax.reduction.device_segments import segment_all
from inertiax.reduction.dwell_means import reduce_to_dwells
from inertiax.reduction.known_moves import num_axes, with_known_moves
from inertiax.reduction.rig_errors import move_covariance
from table_of_two_axes import (
    BIAS,
    CAMPAIGN,
    EARTH,
    ENCODER,
    GRAVITY,
    LATITUDE,
    MATRIX,
    RATE,
    record,
    smooth,
)


def found(result):
    """Errors of the gyros' matrix over their standard deviations, and these."""
    triad = result.calibration.gyro
    kept = [k for k, n in enumerate(triad.names) if "matrix" in n]
    value = np.asarray(triad.curve(25.0))[kept]
    sigma = np.sqrt(np.diagonal(np.asarray(triad.covariance)))[kept]
    return (value - MATRIX.ravel()) / sigma, sigma


def test_the_matrix_of_gyros_is_found_by_moves_where_rates_are_about_one_axis(tmp_path):
    result = calibrate_device(record(tmp_path / "A"))
    z, sigma = found(result)
    assert sigma.max() < 5e-4  # the Earth's rate alone: 0.15
    # Of the mean of n samples: a turn of 180° that takes 6 s tells a column to N/√n/(30°/s) = 58 ppm; some twenty do.
    assert np.abs(z).max() < 4.0 and np.sqrt(np.mean(z**2)) < 1.7
    said = [t for t in result.choices if "moves between rests" in t]
    assert said == [
        "gyros: 21 moves between rests are used by their mean rates, for the 4 plateaus of constant rate found "
        "turn about one axis, which leaves two unseen"
    ]


def test_moves_do_where_a_table_only_positions(tmp_path):
    result = calibrate_device(record(tmp_path / "A", turns=False))
    z, sigma = found(result)
    assert np.abs(z).max() < 4.0 and sigma.max() < 5e-4
    assert any(t.endswith("for no plateau of constant rate was found") for t in result.choices)


def test_gyros_that_are_not_left_to_their_reference_get_no_moves(tmp_path):
    record(tmp_path / "A", turns=False)
    path = tmp_path / "A" / "campaign.toml"
    path.write_text(CAMPAIGN + '[model]\ngyro_estimator = "static"\n')
    result = calibrate_device(load_campaign(tmp_path / "A"))
    assert not any(part.known_moves.any() for part in result.segments)


def test_a_lag_of_the_gyros_leaves_the_means_of_moves_as_they_are(tmp_path):
    plain, late = (
        calibrate_device(record(tmp_path / str(lag), lag=lag)).calibration.gyro for lag in (0, 2)
    )
    change = np.asarray(late.curve(25.0) - plain.curve(25.0))
    # 40 ms of 30 °/s are 1.2° of a move's 90°, or 13 000 ppm, were they not made up for at its end.
    assert np.abs(change[3:]).max() < 3e-4


def test_moves_are_not_used_where_rates_are_about_three_axes(tmp_path):
    campaign = record(tmp_path / "A", outer_turns=True)
    (part,) = segment_all(campaign.recordings)
    assert not part.known_moves.any()
    rates = np.asarray(reduce_to_dwells(campaign.recordings).reference_gyro)[part.position < 0]
    assert num_axes(rates) == 3


def test_moves_of_which_the_station_writes_no_rates_are_not_used(tmp_path):
    names = ",position,reference_gyro_x,reference_gyro_y,reference_gyro_z"

    def only_plateaus(force, rate):
        speed = np.linalg.norm(rate, axis=1)
        rest = speed < 1.5 * EARTH
        steady = np.abs(np.abs(rate[:, 2]) - np.deg2rad(60.0)) < 2.0 * EARTH
        label = np.where(rest, np.cumsum(np.diff(rest.astype(int), prepend=0) > 0), -1)
        return np.column_stack([label, np.where((rest | steady)[:, None], rate, 0.0)])

    campaign = record(tmp_path / "A", columns=names, extra=only_plateaus)
    text = CAMPAIGN.partition("[columns]")[0]
    (tmp_path / "A" / "campaign.toml").write_text(text)
    campaign = load_campaign(tmp_path / "A")
    (part,) = segment_all(campaign.recordings)
    assert not part.known_moves.any() and (~part.resting).sum() == 4
    with pytest.raises(ValueError, match="known rates are about one axis") as error:
        calibrate_device(campaign)
    assert 'gyro_estimator = "gravity"' in str(error.value)
    assert "do not determine 6 of 12 unknowns" in str(error.value.__cause__)  # of what converged

    # As the error says; beside gravity's rotation the reference still holds the Earth's rate at rest.
    (tmp_path / "A" / "campaign.toml").write_text(text + '[model]\ngyro_estimator = "gravity"\n')
    result = calibrate_device(load_campaign(tmp_path / "A"))
    z, sigma = found(result)
    assert np.abs(z).max() < 4.0 and sigma.max() < 3e-3
    bias = np.asarray(result.calibration.gyro.curve(25.0))[:3] - BIAS
    assert np.abs(bias).max() < 2.5e-5  # the Earth's rate is 7e-5, and 21 rests of 6 s tell 7e-6


def test_earth_rate_beside_gravity_is_no_g_sensitivity(tmp_path):
    names = ",reference_gyro_x,reference_gyro_y,reference_gyro_z"
    truth = np.deg2rad([[0.02, -0.01, 0.03], [0.01, 0.02, -0.02], [-0.03, 0.01, 0.01]]) / GRAVITY
    record(tmp_path / "A", by_force=truth, columns=names, extra=lambda force, rate: rate)
    text = CAMPAIGN.partition("[columns]")[0]
    asked = '[model]\ngyro_estimator = "gravity"\ng_sensitivity = true\n'
    (tmp_path / "A" / "campaign.toml").write_text(text + asked)
    triad = calibrate_device(load_campaign(tmp_path / "A")).calibration.gyro
    kept = [k for k, n in enumerate(triad.names) if "g_sensitivity" in n]
    sigma = np.sqrt(np.diagonal(np.asarray(triad.covariance)))[kept]
    z = (np.asarray(triad.curve(25.0))[kept] - GRAVITY * truth.ravel()) / sigma
    assert np.abs(z).max() < 4.0
    # The Earth's horizontal rate follows the outer angle as a force does: by so much it would be off.
    assert sigma.max() < 0.5 * EARTH * np.cos(np.deg2rad(LATITUDE))


@pytest.mark.slow
def test_a_diagnosis_of_moves_agrees_with_the_calibration(tmp_path):
    campaign = record(tmp_path / "A", seed=3)
    diagnosis, written = diagnose_campaign(campaign)
    plain = calibrate_device(campaign).calibration
    assert diagnosis.verdict == "consistent"
    assert written.model == plain.model
    difference = np.asarray(written.gyro.curve(25.0) - plain.gyro.curve(25.0))
    sigma = np.sqrt(np.diagonal(np.asarray(plain.gyro.covariance)))
    assert np.abs(difference / sigma).max() < 1e-3


@pytest.mark.slow
def test_errors_of_the_matrix_have_unit_variance(tmp_path):
    z = np.concatenate(
        [found(calibrate_device(record(tmp_path / str(k), seed=k)))[0] for k in range(12)]
    )
    # 108 numbers, of which those of one column are of the same moves: 3 sigma of 60 that are independent.
    assert 0.7 < np.mean(z**2) < 1.6


@pytest.mark.parametrize("seconds", [2.0, 30.0])
def test_the_rates_of_a_move_make_its_angle(seconds):
    rng = np.random.default_rng(int(seconds))
    still = np.zeros(1000)
    angle = np.concatenate([still, smooth(0.0, 180.0, seconds), still + 180.0])
    time = np.arange(len(angle)) / RATE
    seen = np.deg2rad(angle + rng.normal(0.0, ENCODER, len(angle)))[:, None]
    made = np.rad2deg(rates_of_angles(seen, time).sum() / RATE)
    assert made == pytest.approx(180.0, abs=5.0 * ENCODER)  # the noise of either end


def test_the_covariance_of_a_move_by_hand():
    # Two positionings of 1 mrad each, 4 s apart: √2 · 1e-3 / 4 = 3.54e-4 rad/s.
    got = move_covariance(np.array([True, False]), np.array([4.0, 4.0]), 1e-3)
    np.testing.assert_allclose(np.sqrt(got[0].diagonal()), 3.5355e-4, rtol=1e-4)
    assert not got[1].any()


def test_a_recording_without_gyros_has_no_moves(tmp_path):
    campaign = record(tmp_path / "A")
    (recording,) = campaign.recordings
    bare = dataclasses.replace(recording, gyro=None)
    parts = with_known_moves([bare], segment_all([recording]))
    assert parts[0].num_segments >= 20
