"""A device that is laid down for too short a time is told so; one that lies, or that is carried about, is not."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hand_log_data import G
from inertiax.data.recording import Campaign, Recording, Site
from inertiax.plausibility import check_campaign


def told(lies, rests=20, seed=0, thinned=1):
    """Of a device that lies `lies` s in each pose and is turned to the next one in a second, at 100 Hz or every
    `thinned` row of that."""
    rng = np.random.default_rng(seed)
    attitude, force, turning = Rotation.identity(), [], []
    for _ in range(rests):
        force += [attitude.inv().apply([0.0, 0.0, G])] * int(100 * lies)
        turning += [np.zeros(3)] * int(100 * lies)
        axis = rng.standard_normal(3)
        angle = rng.uniform(0.9, 1.8) * axis / np.linalg.norm(axis)
        for part in (1.0 - np.cos(2 * np.pi * (np.arange(100) + 0.5) / 100)) / 100:
            force.append(attitude.inv().apply([0.0, 0.0, G]))
            turning.append(angle * part * 100)
            attitude = attitude * Rotation.from_rotvec(angle * part)
    accel = np.array(force) + 0.02 * rng.standard_normal((len(force), 3))
    gyro = np.array(turning) + 0.001 * rng.standard_normal((len(force), 3))
    time = np.arange(len(accel)) / 100
    recording = Recording(time[::thinned], accel[::thinned], gyro[::thinned])
    found = check_campaign(Campaign((recording,), Site(gravity=G))).findings
    return [f for f in found if f.kind == "brief_rests"]


def test_rests_of_half_a_second_are_told():
    (found,) = told(0.5)
    assert found.severity == "warning"
    # What moves by less than the noise at the ends is rest, and the window takes a part of each end away.
    assert 0.3 < dict(found.evidence)["lasts"] < 0.6
    assert "1.5 s or more" in found.statement


@pytest.mark.parametrize(("lies", "thinned"), [(0.45, 2), (0.7, 4), (0.8, 4)])
def test_they_are_told_at_few_samples_a_second(lies, thinned):
    """Sixteen samples at 50 or 25 Hz are most of such a rest, or more."""
    (found,) = told(lies, rests=24, seed=3, thinned=thinned)
    assert dict(found.evidence)["directions"] >= 18
    assert lies - 0.3 < dict(found.evidence)["lasts"] < lies + 0.1


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("lies", [0.0, 1.5, 4.0])
def test_a_device_that_lies_or_never_does_is_not(lies, seed):
    assert not told(lies, seed=seed)
