"""A device that turns on about the vertical lies still nowhere, whatever unit its gyros are said to have."""

import numpy as np
import pytest

import inertiax as ix
from inertiax.reduction.rests import find_rests


RATE = 100.0  # Hz
POSE, TURN = 2.0, 2.0  # s
GRAVITY = 9.80665  # m/s²


def _log(rng: np.random.Generator, on: float, cycles: int = 8) -> tuple[np.ndarray, np.ndarray]:
    """Outputs of a device that tilts by 90° between poses, in which it turns to and fro about the vertical.

    `on` is the rate in the poses, rad/s; it changes sign and stops every quarter of a second, as a servo's does.
    """
    pose, turn = int(POSE * RATE), int(TURN * RATE)
    accel, gyro = [], []
    for k in range(cycles):
        up, side = np.roll([1.0, 0.0, 0.0], k), np.roll([1.0, 0.0, 0.0], k + 1)
        steps = np.repeat(np.resize([on, 0.0, -on, -on, 0.0, on], pose // 25), 25)
        accel.append(np.tile(GRAVITY * up, (pose, 1)))
        gyro.append(steps[:, None] * up)
        angle = np.linspace(0.0, 0.5 * np.pi, turn)[:, None]
        accel.append(GRAVITY * (np.cos(angle) * up + np.sin(angle) * side))
        about = np.cross(side, up)  # gravity goes from `up` to `side` in the case
        gyro.append(np.tile(0.5 * np.pi / TURN * about, (turn, 1)))
    force, rates = np.concatenate(accel), np.concatenate(gyro)
    return (
        force + 0.01 * rng.normal(size=force.shape),
        rates + [0.02, -0.01, 0.03] + 1e-3 * rng.normal(size=rates.shape),
    )


@pytest.mark.parametrize("scale", [0.1, 1.0, 10.0])
def test_poses_in_which_it_turns_on_are_no_rests(scale):
    accel, gyro = _log(np.random.default_rng(0), on=0.6)
    found = find_rests(
        ix.Recording.from_arrays(np.arange(len(accel)) / RATE, accel, scale * gyro), window=1.0
    )
    assert len(found.start) == 0
    # Of rates that read as high as they are no stretch is quiet to begin with.
    assert scale > 0.1 or "moves all the time; it turns on" in found.statement


@pytest.mark.parametrize("scale", [0.1, 1.0, 10.0])
def test_poses_in_which_it_lies_or_trembles_are_rests(scale):
    for on in (0.0, 0.03):  # 2°/s: a hand
        accel, gyro = _log(np.random.default_rng(0), on=on)
        log = ix.Recording.from_arrays(np.arange(len(accel)) / RATE, accel, scale * gyro)
        assert len(find_rests(log, window=1.0).start) == 8


def test_a_pose_in_which_it_turns_is_left_out_among_others():
    accel, gyro = _log(np.random.default_rng(1), on=0.0)
    pose = slice(int(4 * RATE), int(6 * RATE))
    gyro[pose, 1] += np.repeat([0.8, -0.8], 100)
    # A thousandth of the rates: 5 mrad/s, which a bias may change by from pose to pose, are far above all of them.
    log = ix.Recording.from_arrays(np.arange(len(accel)) / RATE, accel, 1e-3 * gyro)
    found = find_rests(log, window=1.0)
    assert not np.any((found.start >= pose.start - 50) & (found.start < pose.stop))
    assert len(found.start) == 7
