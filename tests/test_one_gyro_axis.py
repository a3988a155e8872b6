"""One gyro axis, or two, in another unit or of another scale is called so, with the line that mends it."""

import numpy as np
import polars as pl
import pytest

from hand_log_data import DEGREE, G, hand_log
from inertiax.data.campaign import load_campaign
from inertiax.data.recording import Campaign, Recording, Site
from inertiax.plausibility import check_campaign


TIME, ACCEL, GYRO = hand_log(rests=16)


def written(folder, gyro, columns=""):
    table = {"time": TIME}
    table |= {f"accel_{a}": ACCEL[:, k] for k, a in enumerate("xyz")}
    table |= {f"gyro_{a}": gyro[:, k] for k, a in enumerate("xyz")}
    pl.DataFrame(table).write_csv(folder / "log.csv")
    toml = f'[site]\ngravity = {G}\n[recordings]\nfiles = ["log.csv"]\n'
    (folder / "campaign.toml").write_text(toml + columns)
    return load_campaign(folder), toml


def errors(gyro):
    recording = Recording(time=TIME, accel=ACCEL, gyro=gyro)
    found = check_campaign(Campaign((recording,), Site(gravity=G))).findings
    return [f for f in found if f.severity == "error"]


@pytest.mark.parametrize(
    "axes, factor, said",
    [
        ([0], 1 / DEGREE, "x is in another unit, likely deg/s"),
        ([1], 1 / DEGREE, "y is in another unit, likely deg/s"),
        ([2], 10 / DEGREE, "z is in another unit, likely 0.1 deg/s"),
        ([0], 3600 / DEGREE, "x is in another unit, likely deg/h"),
        ([1], 2.0, "y is in another scale"),
        ([2], 0.5, "z is in another scale"),
        ([0], -1 / DEGREE, "x is in another unit and mirrored, likely deg/s"),
        ([0, 2], 1 / DEGREE, "x and z are in another unit, likely deg/s"),
    ],
)
def test_the_axis_is_told_and_the_remedy_mends_it(tmp_path, axes, factor, said):
    mixed = GYRO.copy()
    mixed[:, axes] *= factor
    campaign, toml = written(tmp_path, mixed)
    (found,) = [f for f in check_campaign(campaign).findings if said in f.statement]
    assert (found.kind, found.severity) == ("gyro_unit", "error")
    (tmp_path / "campaign.toml").write_text(toml + found.remedy)
    mended = load_campaign(tmp_path)
    np.testing.assert_allclose(mended.recordings[0].gyro, GYRO, rtol=1e-9, atol=1e-12)
    assert check_campaign(mended).verdict == "plausible"


def test_a_mirrored_axis_and_exchanged_ones_stay_what_they_are():
    (found,) = errors(GYRO * [1.0, 1.0, -1.0])
    assert found.kind == "axes" and "gyro z is mirrored" in found.statement
    (found,) = errors(GYRO[:, [1, 0, 2]])
    assert found.kind == "axes" and "x and y are exchanged" in found.statement


def test_all_axes_in_one_other_unit_are_no_single_one():
    (found,) = errors(GYRO / DEGREE)
    assert found.kind == "gyro_unit" and 'likely unit "deg/s"' in found.statement


# Raw scale factors, a mounting on its side, and an axis at two thirds: a calibration fits them.
@pytest.mark.parametrize("scale", [(1.0, 1.0, 1.0), (1.05, 0.95, 1.0), (1.0, 1.4, 1.0)])
def test_scales_that_a_calibration_fits_are_no_error(scale):
    assert not errors(GYRO * scale)


def test_counts_keep_their_scale(tmp_path):
    counts = np.round(GYRO / DEGREE * 131.0)
    counts[:, 1] *= 4.0
    columns = '[columns]\ngyro = { unit = "count", scale = 131, scale_unit = "count per deg/s" }\n'
    campaign, toml = written(tmp_path, counts, columns)
    found = check_campaign(campaign).findings[0]
    assert "y is in another scale" in found.statement
    (tmp_path / "campaign.toml").write_text(toml + found.remedy)
    np.testing.assert_allclose(
        load_campaign(tmp_path).recordings[0].gyro, GYRO, rtol=0.02, atol=2 * DEGREE / 131
    )


def test_two_axes_of_scales_of_their_own_are_told_as_no_more_than_a_contradiction():
    recording = Recording(time=TIME, accel=ACCEL, gyro=GYRO * [57.0, 0.3, -4.0])
    found = check_campaign(Campaign((recording,), Site(gravity=G))).findings
    (said,) = [f for f in found if f.kind == "axes"]
    assert (
        said.severity == "warning" and "no factor of one axis or two explains it" in said.statement
    )


@pytest.mark.parametrize("kept, rate", [(0.88, 50.0), (1.0, 56.0)])
def test_rows_that_are_fewer_than_their_rate_says_are_no_scale_of_one_axis(tmp_path, kept, rate):
    """Lost here and there, or counted at another rate: each axis turns too little, and one by chance the least."""
    rows = np.random.default_rng(6).random(len(TIME)) < kept
    header = ",".join(f"{t}_{a}" for t in ("accel", "gyro") for a in "xyz")
    outputs = np.hstack([ACCEL, GYRO])[rows]
    np.savetxt(tmp_path / "log.csv", outputs, "%.6f", ",", header=header, comments="")
    toml = f'[site]\ngravity = {G}\n[recordings]\nfiles = ["log.csv"]\n'
    (tmp_path / "campaign.toml").write_text(f"{toml}[columns]\ntime = {{ rate = {rate} }}\n")
    campaign = load_campaign(tmp_path)
    (found,) = [f for f in check_campaign(campaign).findings if f.kind == "gyro_unit"]
    assert "about all axes alike" in found.statement and "of them were lost" in found.statement
    assert found.remedy is not None
    told = float(found.remedy.split("rate = ")[1].split(" ")[0])
    # Of the 75 rows of a motion 12 % are lost to 4 %, and few of them are the fast ones, which count.
    assert told == pytest.approx(kept * 50.0, rel=0.05)
