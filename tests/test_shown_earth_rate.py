"""Gyros that show no Earth's rate at rest, or do not tell whether they do."""

import dataclasses

import numpy as np
import pytest

from inertiax.calibrate.earth_rate import earth_taken_away as words_of_earth
from inertiax.data.recording import Campaign, Recording, Site
from inertiax.diagnose.observations.without_earth import earth_taken_away
from inertiax.physics.wgs84 import EARTH_RATE
from inertiax.plausibility import check_campaign
from inertiax.reduction.dwell_means import reduce_to_dwells
from inertiax.reduction.earth_at_rest import shown_by_dwells, without_vertical_earth_rate
from inertiax.reduction.segments import segment_each
from inertiax.reduction.shown_earth_rate import Shown, shown_earth_rate


SITE = Site(9.81, np.deg2rad(48.0))
UP = EARTH_RATE * np.sin(SITE.latitude)


def means(part, noise, rests=24, seed=0):
    """Means of rests in directions by chance whose gyros show that part of the vertical Earth's rate."""
    rng = np.random.default_rng(seed)
    up = rng.standard_normal((rests, 3))
    up /= np.linalg.norm(up, axis=1)[:, None]
    return (
        1e-3 + part * UP * up + noise * rng.standard_normal((rests, 3)),
        9.81 * up,
        np.full(rests, 400.0),
    )


@pytest.mark.parametrize("part", [0.0, 1.0])
def test_the_part_and_its_scatter_are_those_of_repetitions(part):
    found = [shown_earth_rate(*means(part, 0.5 * UP, seed=k), SITE) for k in range(200)]
    parts = np.array([f.part for f in found])
    stated = np.sqrt(np.mean([f.std**2 for f in found]))
    # The pooled weights come from the scatter itself, and unlike axes widen: 0.8 to 1.5 of what repetitions scatter by
    # is what 200 of them, known to 5 %, may say of that.
    assert 0.8 < stated / parts.std() < 1.5
    assert abs(parts.mean() - part) < 5.0 * parts.std() / np.sqrt(200.0)


def test_what_is_there_is_not_called_absent_and_what_is_not_mostly_is():
    there = [shown_earth_rate(*means(1.0, 0.5 * UP, seed=k), SITE).absent for k in range(200)]
    lacking = [shown_earth_rate(*means(0.0, 0.5 * UP, seed=k), SITE).absent for k in range(200)]
    assert sum(there) <= 4  # one of 160 by chance; 5 of 200 once in 100 times
    assert sum(lacking) > 150


def test_absent_is_what_is_near_none_and_far_from_all():
    assert Shown(0.1, 0.2).absent and Shown(-0.7, 0.6).absent
    assert not Shown(0.4, 0.5).absent and not Shown(1.3, 0.2).absent
    assert not Shown(-10.0, 0.5).absent  # which is a g-sensitivity


def test_few_rests_and_no_latitude_tell_nothing():
    gyro, force, count = means(0.0, 0.1 * UP, rests=11)
    assert shown_earth_rate(gyro, force, count, SITE) is None
    assert shown_earth_rate(*means(0.0, 0.1 * UP), Site(9.81)) is None


def over_temperature(part, noise, rests=60, seed=0):
    """The same of biases that a curve of 300 times Earth's rate moves over 40 °C."""
    gyro, force, count = means(part, noise, rests, seed)
    temperature = 30.0 + 20.0 * np.sin(np.linspace(0.0, 4.0, rests))
    x = (temperature - 30.0) / 20.0
    curve = 300.0 * UP * np.stack([x, x**2 - 0.5 * x, x**3 + x], axis=1)
    return gyro + curve, force, count, temperature


@pytest.mark.parametrize("part", [0.0, 1.0])
def test_biases_that_follow_the_temperature_do_not_hide_whether_it_is_there(part):
    found = []
    for seed in range(100):
        gyro, force, count, temperature = over_temperature(part, 0.5 * UP, seed=seed)
        found.append(shown_earth_rate(gyro, force, count, SITE, temperature))
    parts, stated = np.array([f.part for f in found]), np.array([f.std for f in found])
    # 60 rests tell it to 0.5 / sqrt(60) or so an attitude's thirds of three axes: 0.07.
    assert parts.std() < 0.1
    assert 0.8 < np.sqrt(np.mean(stated**2)) / parts.std() < 1.5  # as above
    absent = sum(f.absent for f in found)
    assert absent > 85 if part == 0.0 else absent <= 3  # 95 of 100, and one of 160


def test_the_rests_temperatures_are_asked_by_a_check_and_by_dwells():
    gyro, force, _, temperature = over_temperature(0.0, 0.1 * UP)
    rows = 150
    each = lambda v: np.repeat(v, rows + 50, axis=0)
    turning = np.tile(np.arange(rows + 50) >= rows, len(gyro))
    rng = np.random.default_rng(1)
    recording = Recording(
        time=np.arange(len(turning)) / 50.0, temperature=each(temperature),
        position=np.where(turning, -1, each(np.arange(len(gyro)))),
        accel=each(force) + 0.01 * rng.standard_normal((len(turning), 3)),
        gyro=np.where(turning[:, None], 0.5, each(gyro)) + 2.4e-5 * rng.standard_normal((len(turning), 3)),
    )  # fmt: skip
    campaign = Campaign((recording,), SITE)
    assert "earth_rate" in [f.kind for f in check_campaign(campaign).findings]
    dwells = reduce_to_dwells(campaign.recordings)
    assert without_vertical_earth_rate(dwells, SITE) is dwells


def at_rest(part, seed=0):
    """Rests of 4 s, with turns of a second between them, of gyros with 5 °/h of noise in each mean."""
    rng = np.random.default_rng(seed)
    gyro, force, _ = means(part, 0.0, seed=seed)
    rows, turn = 200, 50
    accel = np.concatenate(
        [np.concatenate([np.tile(f, (rows, 1)), np.tile(f, (turn, 1))]) for f in force]
    )
    rate = np.concatenate(
        [np.concatenate([np.tile(g, (rows, 1)), np.full((turn, 3), 0.5)]) for g in gyro]
    )
    position = np.concatenate(
        [np.r_[np.full(rows, k), np.full(turn, -1)] for k in range(len(gyro))]
    )
    recording = Recording(
        time=np.arange(len(rate)) / 50.0, position=position,
        accel=accel + 0.01 * rng.standard_normal(accel.shape),
        gyro=rate + np.sqrt(rows) * 2.4e-5 * rng.standard_normal(rate.shape),
    )  # fmt: skip
    return Campaign((recording,), SITE)


def test_earths_rate_that_the_gyros_do_not_show_is_told_and_left_in_their_means():
    for part in (0.0, 1.0):
        campaign = at_rest(part)
        told = [f for f in check_campaign(campaign).findings if f.kind == "earth_rate"]
        dwells = reduce_to_dwells(campaign.recordings)
        taken = np.asarray(dwells.gyro) - np.asarray(without_vertical_earth_rate(dwells, SITE).gyro)
        segments = segment_each(campaign.recordings)
        earth = earth_taken_away(campaign.recordings, segments, SITE)
        if part == 0.0:
            assert "rests show" in told[0].statement and told[0].severity == "note"
            assert not taken.any() and earth is None
        else:
            assert told == []
            np.testing.assert_allclose(np.linalg.norm(taken, axis=1), UP, rtol=1e-6)
            np.testing.assert_allclose(np.linalg.norm(earth, axis=1).max(), UP, rtol=1e-6)


def test_gyros_that_stand_on_one_code_at_rest_do_not_tell():
    """Neither means without scatter nor a step far above Earth's rate say anything; a step that noise dithers does."""
    campaign = at_rest(0.0)
    (recording,) = campaign.recordings
    assert recording.gyro is not None
    kinds, words = [], []
    for step in (
        5e-3,
        2e-4,
    ):  # rad/s; Earth's rate is 5.4e-5 along the vertical, the samples' noise 3.4e-4
        gyro = step * np.round(recording.gyro / step)
        coarse = Campaign((dataclasses.replace(recording, gyro=gyro),), SITE)
        kinds.append("earth_rate" in [f.kind for f in check_campaign(coarse).findings])
        dwells = reduce_to_dwells(coarse.recordings)
        words.append(words_of_earth(dwells, coarse)[1][0])
    assert kinds == [False, True]
    assert "step hides Earth's rate" in words[0] and "is not in them" in words[1]


def test_rows_that_count_in_no_dwell_do_not_tell_a_diagnosis_either():
    """Gyros without Earth's rate that are knocked in each rest: by all rows they would not tell whether it is there."""
    campaign = at_rest(0.0)
    (recording,) = campaign.recordings
    (part,) = segment_each(campaign.recordings)
    knocked, gyro = np.zeros(recording.num_samples, bool), np.array(recording.gyro)
    for a in part.start[part.resting]:
        knocked[a + 90 : a + 110] = True
    gyro[knocked] += np.repeat(np.random.default_rng(4).normal(0.0, 0.02, (24, 3)), 20, axis=0)
    log = dataclasses.replace(recording, gyro=gyro)
    segments = (dataclasses.replace(part, used=part.used & ~knocked),)
    dwells = reduce_to_dwells([log], segments=segments)
    assert without_vertical_earth_rate(dwells, SITE) is dwells
    assert earth_taken_away([log], segments, SITE) is None


@pytest.mark.parametrize("seed", range(4))
def test_check_tells_it_by_the_dwells_of_calibrate(seed):
    """Rests of which three in four are knocked, by both triads: by all rows the gyros would not tell."""
    campaign = at_rest(0.0, seed)
    (recording,) = campaign.recordings
    rng = np.random.default_rng(seed)
    accel, gyro = np.array(recording.accel), np.array(recording.gyro)
    (part,) = segment_each(campaign.recordings, handling=False)
    for a in part.start[part.resting][::3]:
        ring = np.exp(-np.arange(10) / 3.0)[:, None]
        accel[a + 90 : a + 100] += ring * rng.normal(0.0, 1.0, 3)
        gyro[a + 90 : a + 100] += ring * rng.normal(0.0, 0.2, 3)
    knocked = dataclasses.replace(recording, accel=accel, gyro=gyro)
    campaign = dataclasses.replace(campaign, recordings=(knocked,))
    told = [f for f in check_campaign(campaign).findings if f.kind == "earth_rate"]
    segments = segment_each(campaign.recordings, held=True)
    dwells = reduce_to_dwells(campaign.recordings, segments=segments)
    assert without_vertical_earth_rate(dwells, SITE) is dwells
    shown = shown_by_dwells(dwells, SITE)
    assert shown is not None and [dict(f.evidence)["part"] for f in told] == [
        pytest.approx(shown.part)
    ]
