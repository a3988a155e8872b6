"""What a line shows besides its parameters: odd recordings, files exchanged, fits that are not good."""

import numpy as np
import polars as pl
import pytest

from fleet_data import write_line
from inertiax.fleet import run_fleet
from inertiax.fleet.overview.odd_recordings import odd_recordings
from inertiax.fleet.overview.recalibration import drift_between
from inertiax.fleet.store import read_manifest
from inertiax.report.fleet_drift import drift_sentence
from inertiax.report.fleet_fits import fit_sentence


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """Ten devices twice; then SN0001 is noisier on y, SN0004 has half its rows, SN0007 and SN0008 change names."""
    home = tmp_path_factory.mktemp("line")
    write_line(home / "line", 10, files=1, experiments=2, degree=0)
    run_fleet(home / "line", home / "before", workers=1)
    file = home / "line" / "line-0.parquet"
    table = pl.read_parquet(file)
    more = np.random.default_rng(1).normal(0.0, 2e-3 * np.sqrt(3.0), table.height)
    other = {"SN0007": "SN0008", "SN0008": "SN0007"}
    table = table.with_columns(
        accel_y=pl.col("accel_y")
        + pl.when(pl.col("device") == "SN0001").then(pl.Series(more)).otherwise(0.0),
        device=pl.col("device").replace(other),
    ).filter((pl.col("device") != "SN0004") | (pl.col("experiment") == 0))
    table.write_parquet(file)
    run_fleet(home / "line", home / "after", workers=1)
    return home


@pytest.mark.slow
def test_fewer_rests_and_a_noisier_channel_are_told(runs):
    assert odd_recordings(runs / "before", read_manifest(runs / "before")) == ()
    found = odd_recordings(runs / "after", read_manifest(runs / "after"))
    words = {o.device: o.words for o in found}
    assert set(words) == {"SN0004", "SN0001"}
    assert words["SN0004"] == "18 rests and turns, 36 are usual"
    times = float(words["SN0001"].removeprefix("accel_y has ").split()[0])
    assert times == pytest.approx(
        2.0, abs=0.15
    )  # 18 rests tell a median of deviations to some percent


@pytest.mark.slow
def test_exchanged_serial_numbers_are_told_with_each_other(runs):
    drift = drift_between(runs / "after", runs / "before", "accel")
    assert set(drift.taken_for) == {("SN0007", "SN0008"), ("SN0008", "SN0007")}
    said = drift_sentence("accel", drift)
    assert "exchanged?)" in said and "SN0007 as SN0008" in said


def test_fits_that_are_not_good_are_told_with_their_devices():
    said = fit_sentence({"good": 8, "usable": 2, "doubtful": 0}, ("A", "B"))
    assert said == "Fit by the rule of `calibrate`: 8 good, 2 usable with a reservation (A, B)."
