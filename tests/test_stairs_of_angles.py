"""A table whose telegram comes less often than the device's rows, and one whose encoder goes to and fro over zero."""

import re

import numpy as np
import pytest
from scipy.integrate import quad_vec

from inertiax.calibrate.pipeline import calibrate_device
from inertiax.campaign_draft.pipeline import draft_campaign
from inertiax.data.campaign import load_campaign
from inertiax.data.formats.held_angles import held_rows, without_repeats, without_stairs
from inertiax.data.formats.table_angles import ideal_readings
from inertiax.data.formats.table_motion import TableMotion
from inertiax.data.formats.table_rates import rates_by_axis, rates_of_angles
from inertiax.data.formats.turntable import Turntable
from inertiax.data.recording import Rig
from inertiax.plausibility import check_campaign
from inertiax.reduction.table_errors import table_error_words, TableErrors
from table_of_two_axes import CAMPAIGN, HEADER, MATRIX, profile, RATE, readings, record


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


@pytest.mark.slow
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


def both_at_once(time):
    """Angles of two axes: from 3 to 6 s the outer one turns by 90°, the inner one by 150°, from rest to rest."""
    u = np.clip((time - 3.0) / 3.0, 0.0, 1.0)[:, None]
    return np.deg2rad([90.0, 150.0]) * u**2 * (3.0 - 2.0 * u)


def turn_of_both():
    """What gyros read in sum of that, by SciPy's quadrature."""

    def rate(t):
        u = (t - 3.0) / 3.0
        outer, inner = np.deg2rad([90.0, 150.0]) * (2.0 * u * (1.0 - u))
        angle = both_at_once(np.array([t]))[0, 1]
        return np.array([outer * np.cos(angle), -outer * np.sin(angle), inner])

    return quad_vec(rate, 3.0, 6.0)[0]


TWO_AXES = Turntable(axes=("east", "up"), case=("east", "north", "up"))


def test_stairs_of_two_axes_at_once_make_the_turn_that_gyros_read():
    true, time = turn_of_both(), np.arange(900) / 100.0
    stairs = both_at_once(time)[np.arange(900) // 5 * 5]
    angles = without_stairs(stairs, time)
    found = ideal_readings(TWO_AXES, angles, rates_of_angles(stairs, time), 9.81, None).rate
    # Lines of 50 ms miss an angle by 0.01° while it speeds up; means of both axes over 0.2 s missed the turn by 2e-3.
    np.testing.assert_allclose(found.sum(axis=0) / 100.0, true, atol=1e-4 * np.linalg.norm(true))


@pytest.mark.parametrize("hertz", [10, 20, 50])
def test_a_tables_log_of_fewer_rows_makes_that_turn_too(hertz):
    rows = np.arange(9 * hertz) / hertz
    angles = both_at_once(rows)
    log = TableMotion(rows, angles, rates_of_angles(angles, rows), by_angles=True)
    put = log.at(np.arange(900) / 100.0)
    found = ideal_readings(TWO_AXES, put.angles, put.rates, 9.81, None).rate
    true = turn_of_both()
    # The sum over the device's rows of 10 ms is that far from the integral by itself. Straight lines between rows of
    # 0.1 s missed it by 4.5e-4.
    np.testing.assert_allclose(found.sum(axis=0) / 100.0, true, atol=1e-5 * np.linalg.norm(true))


def test_straight_lines_go_through_the_telegrams():
    time = np.arange(60) / 100.0
    angle = np.deg2rad(350.0 + 200.0 * np.clip(time - 0.1, 0.0, None))
    held = np.arange(60) // 4 * 4
    stairs = np.stack([angle[held] % (2.0 * np.pi), np.zeros(60)], axis=1)
    found = without_stairs(np.tile(stairs, (2, 1)), np.arange(120) / 100.0)
    assert np.all(found[:, 1] == 0.0)
    np.testing.assert_allclose(
        found[12:57, 0], angle[12:57], atol=1e-12
    )  # over the whole turn, too


def test_repeated_rows_are_on_the_line_and_rests_are_none():
    time = np.arange(400) / 25.0
    # Rest, 60 °/s for 6 s, one second of rest, and back.
    angle = np.deg2rad(60.0) * (np.clip(time - 3.0, 0.0, 6.0) - np.clip(time - 10.0, 0.0, 6.0))
    stale = np.zeros(400, bool)
    stale[[90, 101, 103, 120, 121, 122, 300, 301]] = True
    seen = angle[np.maximum.accumulate(np.where(stale, 0, np.arange(400)))][:, None]
    found = without_repeats(seen, time)
    np.testing.assert_allclose(found[:, 0], angle, atol=1e-12)
    np.testing.assert_array_equal(without_repeats(angle[:, None], time)[:, 0], angle)


@pytest.mark.parametrize("held", [4, 5])
def test_the_delay_of_a_table_whose_own_log_is_held(tmp_path, held):
    # The telegram is written 40 ms after its angles held; the other clock was started 500 s earlier.
    rng = np.random.default_rng(held)
    angles = profile()
    force, rate = readings(angles)
    time = np.arange(len(angles)) / RATE
    fields = [
        time,
        force + rng.normal(0.0, 0.01, force.shape),
        rate + rng.normal(0.0, 5e-4, rate.shape),
    ]
    header = HEADER.removesuffix(",outer,inner")
    np.savetxt(
        tmp_path / "log.csv",
        np.column_stack(fields),
        delimiter=",",
        header=header,
        comments="",
        fmt="%.9g",
    )
    seen = np.round(angles[np.arange(len(angles)) // held * held], 3) % 360.0
    own = np.column_stack([time + 500.04, seen])
    np.savetxt(
        tmp_path / "table.csv", own, delimiter=",", header="clock,A1,A2", comments="", fmt="%.9g"
    )
    said = draft_campaign(
        tmp_path / "log.csv", tmp_path, table=tmp_path / "table.csv", latitude=48.0
    )
    assert 'table_angles = { names = ["A1", "A2"], unit = "deg" }' in said.text
    found = float(re.search(r"\ndelay = (.*)\n", said.text)[1])
    # A tenth of a row; of stairs it were late by half a telegram, 30 ms and more.
    assert found == pytest.approx(500.04, abs=2e-3)


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
