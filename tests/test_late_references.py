"""`[table] delay` moves references in columns to the moments of the outputs."""

import numpy as np
import polars as pl
import pytest

from inertiax.data.campaign import load_campaign
from inertiax.data.formats.late_references import at_their_moments
from inertiax.data.formats.turntable import Turntable
from inertiax.fleet import run_fleet
from inertiax.live.follow import plan
from inertiax.plausibility import check_campaign


RATE, LATE = 25.0, 0.2


def log(folder, *, delay=None, drift=None, late=LATE, named=("log.csv",)):
    """Ramps to plateaus about each axis, whose references and labels stand `late` s behind the gyros."""
    corners, levels, still = [0.0], [np.zeros(3)], []
    for axis in np.eye(3):
        still.append((corners[-1], corners[-1] + 8.0))
        corners.append(corners[-1] + 8.0)
        levels.append(np.zeros(3))
        for speed in np.deg2rad([30.0, -30.0, 90.0, -90.0]):
            for seconds, level in ((1.0, speed), (6.0, speed), (1.0, 0.0), (2.0, 0.0)):
                corners.append(corners[-1] + seconds)
                levels.append(level * axis)
    time = np.arange(0.0, corners[-1], 1.0 / RATE)
    value = lambda t: np.stack(
        [np.interp(t, corners, column) for column in np.transpose(levels)], axis=1
    )
    noise = np.random.default_rng(0).normal(0.0, 2e-4, (len(time), 3))
    label = np.full(len(time), -1)
    for k, (a, b) in enumerate(still):
        label[(time - late >= a) & (time - late < b)] = k
    names = [f"{triad}_{axis}" for triad in ("gyro", "reference_gyro") for axis in "xyz"]
    outputs = 1.001 * value(time) + 1e-3 + noise
    table = np.column_stack([time, outputs, value(time - late)])
    frame = pl.DataFrame(table, ["time", *names]).with_columns(position=pl.Series(label))
    for name in named:
        frame.write_csv(folder / name)
    said = "".join(f"{k} = {v}\n" for k, v in (("delay", delay), ("drift", drift)) if v is not None)
    (folder / "campaign.toml").write_text(
        f"[site]\ngravity = 9.81\n[recordings]\nfiles = {list(named)}\n[table]\n{said}"
    )
    return value(time), label


def found(folder):
    return [f for f in check_campaign(load_campaign(folder)).findings if f.kind == "delay"]


@pytest.mark.parametrize("late", [LATE, -0.13])
def test_the_check_names_the_line_and_the_line_mends_it(tmp_path, late):
    right, label = log(tmp_path, late=late)
    (said,) = found(tmp_path)
    assert said.remedy is not None and said.remedy.startswith("[table]\ndelay = ")
    delay = float(said.remedy.rpartition("=")[2])
    assert delay == pytest.approx(late, abs=2e-3)
    log(tmp_path, late=late, delay=delay)
    assert not found(tmp_path)
    (recording,) = load_campaign(tmp_path).recordings
    # 2 ms of 90 deg/s² are 3 mrad/s; a row that straddles a corner of 90 deg/s² is off by a quarter of its step of it.
    np.testing.assert_allclose(recording.reference_gyro, right, atol=0.02)
    ends = lambda x: np.flatnonzero((x[1:] < 0) & (x[:-1] >= 0))
    assert np.abs(ends(recording.position) - (ends(label) - RATE * late)).max() <= 1.0


def test_of_two_files_one_number_does_where_both_are_late_alike(tmp_path):
    log(tmp_path, named=("a.csv", "b.csv"))
    assert {f.remedy for f in found(tmp_path)} == {"[table]\ndelay = 0.200"}
    log(tmp_path, named=("a.csv", "b.csv"), delay=[LATE, LATE])
    assert not found(tmp_path)


def test_a_drift_is_of_a_log_of_the_tables_own(tmp_path):
    log(tmp_path, drift=20.0)
    with pytest.raises(ValueError, match="drift is of a log of the table's own"):
        load_campaign(tmp_path)


def test_forces_that_are_not_told_and_labels_are_not_mixed():
    time = np.arange(5.0)
    force = np.array([[0.0, 0, 9.8], [0, 0, 9.8], [0, 0, 0], [0, 0, 0], [9.8, 0, 0]])
    given = {"time": time, "reference_accel": force, "position": np.array([0, 0, -1, -1, 1])}
    moved = at_their_moments(given, Turntable(delay=1.4))
    np.testing.assert_array_equal(moved["position"], [0, -1, -1, 1, 1])
    np.testing.assert_array_equal(moved["reference_accel"], force[[1, 2, 3, 4, 4]])
    assert at_their_moments({"time": time}, Turntable(delay=1.4)).keys() == {"time"}


def test_a_fleet_in_common_files_refuses_a_delay(tmp_path):
    log(tmp_path, delay=LATE)
    with pytest.raises(ValueError, match=r"\[table\] delay: the files of many devices"):
        run_fleet(tmp_path, tmp_path / "out")


def test_a_log_that_is_followed_refuses_a_delay(tmp_path):
    log(tmp_path, delay=LATE)
    with pytest.raises(
        ValueError, match=r"\[table\] delay moves references to other rows, which `live`"
    ):
        plan(tmp_path, None, piped=False, target=None)
