"""A table whose telegram comes less often than the device's rows, and one whose encoder goes to and fro over zero."""

import numpy as np
import pytest

from inertiax.calibrate.pipeline import calibrate_device
from inertiax.campaign_draft.pipeline import draft_campaign
from inertiax.data.campaign import load_campaign
from inertiax.data.formats.table_rates import held_rows, rates_by_axis, rates_of_angles
from inertiax.data.recording import Rig
from inertiax.plausibility import check_campaign
from inertiax.reduction.table_errors import table_error_words, TableErrors
from table_of_two_axes import CAMPAIGN, MATRIX, RATE, record


@pytest.mark.parametrize("held", [2, 4, 10])
def test_stairs_have_the_rates_of_the_straight_line(held):
    time = np.arange(3000) / RATE
    angle = np.deg2rad(60.0) * np.clip(
        time - 10.0, 0.0, 30.0
    )  # ten seconds of rest, half a minute at 60 °/s
    stairs = angle[np.arange(len(angle)) // held * held][:, None]
    assert held_rows(stairs) == held and held_rows(angle[:, None]) == 1
    rates = np.rad2deg(rates_of_angles(stairs, time)[:, 0])
    inside = (time > 11.5) & (time < 38.5)
    np.testing.assert_allclose(rates[inside], 60.0, rtol=1e-6)
    assert not rates[(time < 9.0) | (time > 41.0)].any()
    # A station that states no rate while it moves: the angles' change, which makes the whole angle.
    moved = rates_by_axis(stairs, np.zeros(stairs.shape), time).sum() / RATE
    assert moved == pytest.approx(np.deg2rad(1800.0), rel=1e-9)


@pytest.mark.parametrize("held", [2, 4])
def test_gyros_are_right_beside_angles_that_are_held(tmp_path, held):
    record(tmp_path / "A", seed=held, held=held)
    said = draft_campaign(tmp_path / "A" / "log.csv", tmp_path / "A").text
    assert 'table_angles = { names = ["outer", "inner"], unit = "deg" }' in said
    campaign = record(tmp_path / "A", seed=held, held=held)
    # The stairs are late by (held - 1) / 2 rows in the mean, as a table's clock may be; rests and means do not see it.
    triad = calibrate_device(campaign).calibration.gyro
    kept = [k for k, n in enumerate(triad.names) if "matrix" in n]
    sigma = np.sqrt(np.diagonal(np.asarray(triad.covariance)))[kept]
    z = (np.asarray(triad.curve(25.0))[kept] - MATRIX.ravel()) / sigma
    assert np.abs(z).max() < 4.0 and sigma.max() < 5e-4


def test_an_encoder_that_goes_to_and_fro_over_zero_is_still(tmp_path):
    record(tmp_path / "A", whole=360.0)
    log = np.genfromtxt(tmp_path / "A" / "log.csv", delimiter=",", skip_header=1)
    assert np.ptp(log[:250, -1]) > 359.0  # at rest
    (tmp_path / "A" / "campaign.toml").unlink()
    said = draft_campaign(tmp_path / "A" / "log.csv", tmp_path / "A").text
    assert 'table_angles = { names = ["outer", "inner"], unit = "deg" }' in said
    assert 'axes = ["east", "up"]' in said


def test_a_reference_that_rests_while_the_gyros_turn_is_named(tmp_path):
    names = ",reference_gyro_x,reference_gyro_y,reference_gyro_z"
    record(tmp_path / "A", columns=names, extra=lambda force, rate: np.full(rate.shape, 4e-5))
    text = CAMPAIGN.partition("[columns]")[0]
    (tmp_path / "A" / "campaign.toml").write_text(text)
    (found,) = idle(tmp_path / "A")
    assert found.severity == "error" and "says rest in" in found.statement
    # By the plan: some twenty moves at 30 °/s in the mean, and four turns of 6 s at 60.
    assert 40.0 < dict(found.evidence)["seconds"] < 90.0
    record(tmp_path / "B", columns=names, extra=lambda force, rate: rate)
    (tmp_path / "B" / "campaign.toml").write_text(text)
    assert not idle(tmp_path / "B")


def idle(folder):
    """Findings of that kind in a campaign."""
    return [f for f in check_campaign(load_campaign(folder)).findings if f.kind == "idle_reference"]


def test_one_rest_of_many_without_a_heading_is_no_reservation():
    rig = Rig(level_uncertainty=5e-5, axes=((0.0, -1.0, 0.0), (0.0, 0.0, 1.0)))
    position, force, none = np.arange(40), np.tile([0.0, 0.0, 9.8], (40, 1)), np.zeros((40, 3, 3))
    words = lambda unknown: table_error_words(
        rig, TableErrors(none, none, ~np.isin(position, unknown)), position, force
    )
    assert words([3]) == ()
    (said,) = words([3, 4, 5, 6, 7])
    assert "not of 5 rests" in said
