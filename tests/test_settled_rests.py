"""A rest that crept and was left out is no reservation on what was fitted without it; one that was fitted is."""

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from inertiax.calibrate.fit_quality import judge
from inertiax.calibrate.pipeline import calibrate
from inertiax.data.recording import Campaign, ModelChoice, Recording, Rig, Site
from inertiax.plausibility import check_campaign
from inertiax.plausibility.settled_rests import without_settled_rests


RATE, G = 100.0, 9.81  # Hz, m/s²
RESTS, REST, MOVE = 14, 800, 200  # rests, and rows of each and of each move
BIAS = np.array([0.1, -0.2, 0.15])  # m/s²


def campaign(turns):
    """Random poses by SciPy's rotations; `turns[k]` is the turn in rest k from its first row to its last, rad."""
    rng = np.random.default_rng(5)
    path, pose = [], Rotation.random(None, rng)
    for k in range(RESTS):
        rest = pose * Rotation.from_rotvec(turns.get(k, np.zeros((REST, 3))))
        following = Rotation.random(None, rng)
        between = (rest[-1].inv() * following).as_rotvec()
        share = 0.5 - 0.5 * np.cos(np.pi * (np.arange(MOVE) + 1) / MOVE)
        path += [rest, rest[-1] * Rotation.from_rotvec(share[:, None] * between)]
        pose = following
    attitude = Rotation.concatenate(path)
    rate = np.zeros((len(attitude), 3))
    rate[1:] = (attitude[:-1].inv() * attitude[1:]).as_rotvec() * RATE
    force = attitude.inv().apply([0.0, 0.0, G])
    recording = Recording(
        time=np.arange(len(force)) / RATE,
        accel=force + BIAS + 0.02 * rng.standard_normal(force.shape),
        gyro=rate + 0.01 + 1e-3 * rng.standard_normal(rate.shape),
        name="hand.csv",
    )
    return Campaign((recording,), Site(G), Rig(), ModelChoice("invariant", "static", False, 0))


def slow_tilt(degrees):
    return np.linspace(0.0, 1.0, REST)[:, None] * np.deg2rad(degrees) * np.array([0.7, 0.5, -0.5])


def creeping(findings):
    return [f for f in findings if "creeps" in f.statement]


def test_a_rest_that_was_left_out_is_a_note_of_the_result_and_a_warning_of_the_recording():
    given = campaign({4: slow_tilt(1.5)})
    (recorded,) = creeping(check_campaign(given).findings)
    (result,) = calibrate(given)
    assert recorded.severity == "warning"
    begin = 4 * (REST + MOVE) / RATE
    evidence = dict(recorded.evidence)
    assert evidence["recording"] == "hand.csv"
    # A search for rests finds their ends to within its window of half a second.
    assert evidence["starts"] == pytest.approx((begin,), abs=0.6)
    assert evidence["stops"] == pytest.approx((begin + REST / RATE,), abs=0.6)
    assert [(d.kind, d.left_out) for d in result.handling] == [("slow tilt", True)]
    assert [f.severity for f in creeping(result.plausibility)] == ["note"]
    assert not any("creeps" in w for w in result.warnings)
    assert judge(result).verdict == "good"
    # |f| of 13 rests of 800 rows of 0.02 m/s² each, one third of it along an axis: 0.02 / sqrt(800 * 13 / 3) = 3.4e-4
    # m/s², twice that beside the scale factors; four of them.
    np.testing.assert_allclose(result.accel.solution.curve(20.0)[:3], BIAS, atol=3e-3)


def test_rests_that_were_kept_keep_their_warning():
    """Where nearly all creep, what is usual is not known: all stay, and the fit is of rests that creep."""
    given = campaign({k: slow_tilt(1.5) for k in range(RESTS)})
    (result,) = calibrate(given)
    assert result.handling and not any(d.left_out for d in result.handling)
    assert [f.severity for f in creeping(result.plausibility)] == ["warning"]
    assert any("creeps" in w for w in result.warnings)


def test_one_rest_that_was_fitted_as_it_is_keeps_the_warning():
    given = campaign({4: slow_tilt(1.5), 9: slow_tilt(1.5)})
    found = creeping(check_campaign(given).findings)
    (result,) = calibrate(given)
    four, nine = result.handling
    assert [f.severity for f in without_settled_rests(found, (four, nine))] == ["note"]
    assert without_settled_rests(found, (four,)) == tuple(found)
    kept = dataclasses.replace(nine, left_out=False)
    assert without_settled_rests(found, (four, kept)) == tuple(found)
    knock = dataclasses.replace(
        nine, kind="knock"
    )  # left out of that rest, but it does not creep by it
    assert without_settled_rests(found, (four, knock)) == tuple(found)
    another = dataclasses.replace(nine, recording="other.csv")
    assert without_settled_rests(found, (four, another)) == tuple(found)
