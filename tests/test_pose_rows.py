"""Files in which each row is the mean of one pose."""

import numpy as np
import pytest

from inertiax.data.campaign import load_campaign
from inertiax.plausibility import require_plausible
from inertiax.reduction.dwell_means import reduce_to_dwells


RNG = np.random.default_rng(3)
UP = RNG.standard_normal((24, 3))
MEANS = 9.80665 * UP / np.linalg.norm(UP, axis=1, keepdims=True) + [0.02, -0.01, 0.03]
SITE = '[site]\ngravity = 9.80665\n[recordings]\nfiles = ["poses.csv"]\n'
ROWS = "".join(",".join(map(repr, row)) + "\n" for row in MEANS.tolist())


def campaign(tmp_path, rows, columns):
    (tmp_path / "poses.csv").write_text(rows)
    (tmp_path / "campaign.toml").write_text(SITE + columns)
    return load_campaign(tmp_path)


def check(found):
    dwells = reduce_to_dwells(found.recordings)
    np.testing.assert_array_equal(dwells.accel, MEANS)
    assert len(set(np.asarray(dwells.position).tolist())) == len(MEANS)
    # One sample says nothing of its own noise.
    assert not np.asarray(dwells.accel_covariance).any()


def test_each_row_is_a_dwell_where_the_campaign_says_so(tmp_path):
    text = "accel_x,accel_y,accel_z\n" + ROWS
    check(campaign(tmp_path, text, "[columns]\nposition = { row_index = true }\n"))


def test_each_row_is_a_dwell_where_a_column_numbers_the_poses(tmp_path):
    rows = "".join(f"{k},{k}," + x + "\n" for k, x in enumerate(ROWS.splitlines()))
    check(campaign(tmp_path, "time,position,accel_x,accel_y,accel_z\n" + rows, ""))


def test_poses_that_nobody_announced_are_refused_with_the_line_that_does(tmp_path):
    text = "accel_x,accel_y,accel_z\n" + ROWS
    with pytest.raises(
        ValueError, match=r"24 rows turn by \d+° .*position = \{ row_index = true \}"
    ):
        require_plausible(campaign(tmp_path, text, "[columns]\ntime = { rate = 1.0 }\n"))


def test_a_short_log_of_one_pose_is_none_of_that(tmp_path):
    still = MEANS[0] + 0.01 * RNG.standard_normal((40, 3))
    text = "accel_x,accel_y,accel_z\n" + "".join(
        ",".join(map(repr, r)) + "\n" for r in still.tolist()
    )
    require_plausible(campaign(tmp_path, text, "[columns]\ntime = { rate = 50.0 }\n"))


def test_row_numbers_and_a_column_contradict_each_other(tmp_path):
    text = "accel_x,accel_y,accel_z,pose\n" + ROWS.replace("\n", ",1\n")
    with pytest.raises(ValueError, match="both name = 'pose' and row_index are given"):
        campaign(tmp_path, text, '[columns]\nposition = { name = "pose", row_index = true }\n')
