"""A campaign of poses at one temperature and of one pose over temperatures."""

from pathlib import Path

import numpy as np
import pytest

from inertiax.calibrate.attitudes_over_temperature import one_attitude_over_temperature
from inertiax.calibrate.fit_quality import judge
from inertiax.calibrate.pipeline import calibrate_device
from inertiax.cli.next_step import after_calibrate
from inertiax.data.recording import Campaign, Recording, Site


GRAVITY = 9.81
RATE, REST = 50.0, 150  # Hz, rows


def _recording(up, probe, seed, name):
    rng = np.random.default_rng(seed)
    pose = np.repeat(np.arange(len(up)), REST)
    warm = np.repeat(probe, REST)[:, None] - 30.0
    accel = (
        GRAVITY * up[pose] * [1.012, 0.991, 1.007] + [0.2, -0.1, 0.3] + warm * [6e-3, -1e-2, 1.5e-2]
    )
    accel = accel + 0.02 * rng.standard_normal(accel.shape)
    return Recording(
        time=np.arange(len(pose)) / RATE,
        accel=accel,
        temperature=np.repeat(probe, REST)[:, None],
        position=pose,
        name=name,
    )


def _poses(count=24):
    up = np.random.default_rng(1).standard_normal((count, 3))
    return up / np.linalg.norm(up, axis=1, keepdims=True)


def _both(warm_poses=1):
    poses = _poses()
    hand = _recording(poses, np.full(len(poses), 31.5), 2, "hand")
    probe = np.linspace(18.0, 52.0, 40)
    warm = _recording(poses[np.arange(40) % warm_poses], probe, 3, "warm")
    return Campaign((hand, warm), Site(GRAVITY))


def test_it_is_calibrated_all_the_same_and_the_way_on_is_said():
    result = calibrate_device(_both(), force=True)
    assert result.accel is not None and np.all(np.isfinite(result.accel.misfit))
    (told,) = [w for w in result.warnings if "one attitude only" in w]
    assert "from 18 to 52 °C" in told and "from 32 to 32 °C" in told and "--warm-up" in told
    # Slopes of 6 to 15 mm/s² per degree over 34 °C in constants: 0.1 m/s² and more, of means known to 2 mm/s².
    found = judge(result)
    assert found.verdict == "doubtful" and "onstants are right at none" in found.answer
    assert "--warm-up" in after_calibrate(found, Path("C"), Path("R"), table=False)


@pytest.mark.parametrize("campaign", [_both(24)])
def test_poses_at_many_temperatures_are_not_meant(campaign):
    result = calibrate_device(campaign, force=True)
    assert not [w for w in result.warnings if "one attitude only" in w]
    assert one_attitude_over_temperature(result.accel.dwells) is None
