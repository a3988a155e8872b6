"""Accelerometers that are off by more than their data sheet allows in the one pose there is."""

import numpy as np
import pytest

from inertiax.campaign_draft.accel_unit import accel_unit
from inertiax.campaign_draft.resting import resting
from inertiax.data.recording import Campaign, Recording, Site
from inertiax.plausibility import check_campaign


G = 9.81


def told(*readings):
    """What `check` says of rests of 20 s at these means (m/s²), one recording each."""
    rng = np.random.default_rng(3)
    time = np.arange(2000) / 100.0
    logs = [
        Recording(time=time, accel=np.array(r) + 0.02 * rng.normal(size=(2000, 3)), name="a.csv")
        for r in readings
    ]
    found = check_campaign(Campaign(tuple(logs), Site(gravity=G))).findings
    return [f for f in found if f.kind == "accel_unit"]


@pytest.mark.parametrize("part", [1.15, 0.85])
def test_one_pose_that_reads_too_much_or_too_little_is_told(part):
    (one,) = told([0.0, 0.1, part * G])
    assert one.severity == "warning"
    assert "one pose cannot tell which" in one.statement and f"{part:g} times" in one.statement


def test_what_a_data_sheet_allows_is_not_told():
    assert not told([0.0, 0.1, 1.1 * G]) and not told([0.0, 0.1, 0.9 * G])


def test_poses_that_will_tell_a_bias_are_left_to_the_fit():
    assert not told([0.0, 0.1, 1.15 * G], [0.1, 0.0, -0.85 * G])


@pytest.mark.parametrize(("part", "said"), [(1.15, True), (0.87, True), (1.08, False)])
def test_a_draft_says_so(part, said):
    rng = np.random.default_rng(4)
    accel = np.array([0.0, 0.0, part * G]) + 0.02 * rng.normal(size=(3000, 3))
    rests = resting(np.arange(3000) / 100.0, accel, single_rows=False, centre=np.zeros(3))
    unit = accel_unit(accel, rests)
    assert unit.unit == "m/s^2"
    assert ("one pose cannot tell which" in unit.why) is said
