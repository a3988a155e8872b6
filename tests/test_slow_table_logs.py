"""A table's log of a row a second, in which its moves last a row or two: no errors of transmission, no other clock."""

import numpy as np
import polars as pl
import pytest

from inertiax.data.campaign import load_campaign
from inertiax.data.recording import Campaign, Recording, Site
from inertiax.plausibility import check_campaign
from table_of_two_axes import CAMPAIGN, HEADER, RATE, readings, record, smooth


def kinds(campaign):
    return [f.kind for f in check_campaign(campaign).findings]


@pytest.fixture(scope="module")
def slow(tmp_path_factory):
    """Rows that are means over their second, as a navigation unit gives them, beside the angles at its end."""
    folder, rows = tmp_path_factory.mktemp("slow"), int(RATE)
    rng = np.random.default_rng(2)
    angles, at = [np.zeros((20 * rows, 2))], np.zeros(2)
    for outer in (0.0, 45.0, 90.0, 180.0):
        for inner in (0.0, 90.0, 180.0, 270.0):
            for axis, goal in enumerate((outer, inner)):
                seconds = max(abs(goal - at[axis]) / 45.0, 0.3) * (goal != at[axis])
                move = np.tile(at, (int(seconds * RATE), 1))
                move[:, axis] = smooth(at[axis], goal, seconds)
                angles.append(move)
                at[axis] = goal
            angles.append(np.tile(at, (20 * rows, 1)))
    angles = np.concatenate(angles)
    angles = angles[: len(angles) // rows * rows]
    force, rate = (x.reshape(-1, rows, 3).mean(axis=1) for x in readings(angles))
    time = np.arange(len(force)) + 1.0
    noisy = [force + rng.normal(0.0, 1e-4, force.shape), rate + rng.normal(0.0, 1e-7, rate.shape)]
    table = np.column_stack([time, *noisy, angles[rows - 1 :: rows]])
    pl.DataFrame(table, HEADER.split(",")).write_csv(folder / "log.csv")
    (folder / "campaign.toml").write_text(CAMPAIGN)
    return load_campaign(folder)


def test_half_a_row_between_means_and_angles_is_no_second_clock(slow):
    """Its line made the misfit 500 times as large, and then another line was asked for."""
    assert "delay" not in kinds(slow)


def test_a_late_gyro_by_half_a_row_is_told_where_turns_last_many(tmp_path):
    """Six rows of twelve, of which one is kept."""
    record(tmp_path, lag=6)
    path = tmp_path / "log.csv"
    pl.read_csv(path)[::12].write_csv(path)
    campaign = load_campaign(tmp_path)
    (said,) = (f for f in check_campaign(campaign).findings if f.kind == "delay")
    assert dict(said.evidence)["seconds"] == pytest.approx(-0.12, abs=0.02)


@pytest.mark.parametrize(
    ("step", "moves", "told"), [(0.01, False, 1), (0.01, True, 0), (0.5, False, 0)]
)
def test_single_samples_are_errors_where_no_reference_moves_and_rows_are_quick(step, moves, told):
    rng = np.random.default_rng(3)
    rate = rng.normal(0.0, 1e-3, (2000, 3))
    reference = np.zeros_like(rate)
    rate[300::300, 1] += 1.0
    if moves:
        reference[300::300, 1] = 1.0
    accel = np.tile([0.0, 0.0, 9.81], (2000, 1)) + rng.normal(0.0, 1e-2, rate.shape)
    recording = Recording(
        time=step * np.arange(2000.0), accel=accel, gyro=rate, reference_gyro=reference
    )
    assert kinds(Campaign(recording, Site(gravity=9.81))).count("spikes") == told
