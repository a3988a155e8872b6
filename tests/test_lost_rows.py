"""Rows without a clock of which some were lost: what a rate mends and what it does not is said, before and after."""

import numpy as np

from hand_log_data import G, hand_log, written
from inertiax.calibrate.goodness_of_fit import misfit_words
from inertiax.data.campaign import load_campaign
from inertiax.plausibility import check_campaign


NAMES = "accel_x,accel_y,accel_z,gyro_x,gyro_y,gyro_z"


def test_check_says_that_a_rate_mends_the_mean_alone(tmp_path):
    _, accel, gyro = hand_log(rests=22)
    kept = np.random.default_rng(0).uniform(size=len(accel)) >= 0.12
    written(tmp_path / "log.csv", (accel[kept], gyro[kept]), NAMES)
    (tmp_path / "campaign.toml").write_text(
        f'[site]\ngravity = {G}\n[recordings]\nfiles = ["log.csv"]\n[columns]\ntime = {{ rate = 50.0 }}\n'
    )
    (found,) = [
        f for f in check_campaign(load_campaign(tmp_path)).findings if f.kind == "gyro_unit"
    ]
    assert "a rate mends the mean alone" in found.statement and "log a clock" in found.statement


def test_a_misfit_of_motions_may_be_lost_rows():
    assert "rows that were lost" in misfit_words("rad", 0.0275, 137.0, 0.032)
    assert "rows that were lost" not in misfit_words("m/s^2", 0.2, 137.0, 0.2)
