"""A channel at the end of its range holds a value as a dead one does, and comes back to it."""

import numpy as np
import pytest

from hand_log_data import hand_log
from inertiax.data.recording import Campaign, Recording, Site
from inertiax.plausibility import check_campaign


TIME, ACCEL, GYRO = hand_log()
LIMIT = 9.5  # m/s²: less than gravity, which z reads in the first rest


def kinds(accel):
    accel = np.concatenate(
        [np.repeat(accel[:200], 3, axis=0), accel[200:]]
    )  # a first rest of 12 s, a fifth of the log
    accel[:, :2] += 1e-3 * np.random.default_rng(1).standard_normal((len(accel), 2))
    gyro = np.concatenate([np.repeat(GYRO[:200], 3, axis=0), GYRO[200:]])
    recording = Recording(time=np.arange(len(accel)) / 50.0, accel=accel, gyro=gyro, name="a.csv")
    found = check_campaign(Campaign((recording,), Site(9.80665))).findings
    return {f.kind: f.severity for f in found if f.what == "accel_z"}


@pytest.mark.parametrize("later", [200, 0])
def test_what_is_held_is_the_end_of_the_range_where_the_channel_comes_back_to_it(later):
    accel = np.repeat(ACCEL, 1, axis=0)
    accel[:200, 2] = LIMIT
    accel[200:, 2] = np.minimum(accel[200:, 2], LIMIT - 1e-3)
    turned = 5 * 275  # the sixth rest
    accel[turned : turned + later, 2] = LIMIT
    told = kinds(accel)
    if later:
        assert "constant_channel" not in told and told["saturation"] == "warning"
    else:
        assert told["constant_channel"] == "error"


def test_a_channel_that_died_within_its_range_is_dead():
    accel = np.repeat(ACCEL, 1, axis=0)
    accel[:200, 2] = 3.0
    accel[1375:1575, 2] = 3.0
    assert kinds(accel)["constant_channel"] == "error"


def gyro_kinds(rate):
    recording = Recording(time=np.arange(len(rate)) / 50.0, gyro=rate, name="a.csv")
    found = check_campaign(Campaign((recording,), Site(9.80665))).findings
    return {f.kind for f in found if f.what == "gyro_z"}


@pytest.mark.parametrize("died", [False, True])
def test_a_range_that_is_left_once_is_no_death(died):
    """A boomerang's gyro stood at -2000 deg/s for the whole throw: "the channel was dead there"."""
    rng = np.random.default_rng(4)
    rate = rng.normal(0.0, 0.5, (3000, 3))
    throw = 60.0 * np.exp(-(((np.arange(3000) - 1500.0) / 500.0) ** 4))
    rate[:, 2] = np.maximum(rate[:, 2] - throw, -34.9)
    if died:
        rate[:, 2] = rng.normal(0.0, 0.5, 3000)
        rate[1000:2000, 2] = -34.9
    assert ("constant_channel" in gyro_kinds(rate)) == died
    assert "saturation" in gyro_kinds(rate) or died
