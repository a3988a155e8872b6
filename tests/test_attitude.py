"""Attitude by integration of reference rates: sessions joined by their positions, the Earth turning below."""

import equinox as eqx
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from inertiax.diagnose.observations.attitude import attitude
from inertiax.diagnose.observations.blocks import EARTH_RATE, Log
from inertiax.diagnose.observations.signals import room_axes
from inertiax.reduction.segments import Segments


STEP = 0.05
EARTH = EARTH_RATE * np.array([0.0, 0.6, 0.8])


def _turn(start, target, seconds=4.0):
    """Attitudes (room to device) and table rates in the device's axes of one smooth turn about one axis."""
    num = int(seconds / STEP)
    turn = (target * start.inv()).as_rotvec()
    s = np.arange(1, num + 1) / num
    gone = s - np.sin(2 * np.pi * s) / (2 * np.pi)
    speed = (1 - np.cos(2 * np.pi * s)) / seconds
    return Rotation.from_rotvec(gone[:, None] * turn) * start, -speed[:, None] * turn


def _session(start, poses, order, rest=40.0):
    """One recording that visits poses: positions, attitudes, table rates."""
    now, position, path, rate = start, [], [], []
    for p in order:
        turned, speed = _turn(now, poses[p])
        still = int(rest / STEP)
        now = poses[p]
        path += [turned.as_matrix(), np.tile(now.as_matrix(), (still, 1, 1))]
        rate += [speed, np.zeros((still, 3))]
        position += [np.full(len(speed), -1), np.full(still, p)]
    return np.concatenate(position), np.concatenate(path), np.concatenate(rate)


def _log(sessions, earth):
    position, path, rate = (np.concatenate(part) for part in zip(*sessions))
    recording = np.repeat(np.arange(len(sessions)), [len(s[0]) for s in sessions])
    time = np.arange(len(position)) * STEP + 3000.0 * recording
    if earth:
        rate = rate + path @ EARTH
    none = dict.fromkeys(["temperature", "accel", "gyro", "reference_accel"])
    begin = np.array([0])
    whole = Segments(begin, begin + len(time), begin, np.ones(len(time), bool))
    return Log(
        time=time, clock=time, recording=recording, experiment=recording, position=position,
        reference_gyro=rate, segments=whole, **none,
    ), path  # fmt: skip


@pytest.mark.parametrize("earth", [False, True])
def test_sessions_that_begin_anywhere_are_joined_by_their_positions(earth):
    poses = Rotation.random(6, np.random.default_rng(5))
    orders = [(0, 1, 2, 3, 4, 5), (4, 2, 0, 5, 3, 1)]
    sessions = [_session(poses[o[0]], poses, o) for o in orders]
    log, path = _log(sessions, earth)
    found = attitude(log)
    # The axes of the room are those of the first sample. Trapezes at 20 Hz leave 1e-4 rad over five turns.
    assert np.abs(found @ path[0] - path).max() < 5e-4


def test_positions_that_mean_other_poses_join_nothing():
    rng = np.random.default_rng(6)
    sessions = []
    for _ in range(2):
        poses = Rotation.random(6, rng)
        sessions.append(_session(poses[0], poses, range(6)))
    log, path = _log(sessions, False)
    up = path @ np.array([0.0, 0.0, 1.0])
    assert attitude(log, up) is None
    assert attitude(log) is None


def test_rests_tell_the_room_where_the_table_was_moved_unseen():
    """Between two experiments the table jumps by 80 degrees that no rate shows; gravity and the Earth's rate know."""
    poses = Rotation.random(6, np.random.default_rng(9))
    jump = Rotation.from_rotvec([0.0, 0.0, 1.4]) * poses[5]
    log, path = _log([_session(poses[0], poses, range(6)), _session(jump, poses, range(6))], True)
    whole = np.zeros_like(log.recording)
    log = eqx.tree_at(lambda x: (x.recording, x.time), log, (whole, np.arange(len(whole)) * STEP))
    assert attitude(log) is None
    up = path @ np.array([0.0, 0.0, 1.0])
    log = eqx.tree_at(lambda x: x.reference_accel, log, 9.81 * up, is_leaf=lambda x: x is None)
    found = attitude(log)
    # Of the room's axes the columns are what the device sees of north (0, 1, 0), west (-1, 0, 0) and up.
    room = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    # Rests are told by their own references; a motion of up to half a turn by trapezes of 20 Hz from the rest before.
    off = np.abs(found - path @ room).max(axis=(1, 2))
    assert off[log.position >= 0].max() < 1e-5 and off.max() < 2e-3


def test_a_session_alone_has_the_room_of_its_first_sample():
    poses = Rotation.random(4, np.random.default_rng(7))
    log, path = _log([_session(poses[0], poses, (0, 1, 2, 3))], True)
    assert np.abs(attitude(log) @ path[0] - path).max() < 5e-4


@pytest.mark.parametrize("earth", [False, True])
def test_up_is_known_without_the_earth_rate_but_north_is_not(earth):
    poses = Rotation.random(6, np.random.default_rng(8))
    log, path = _log([_session(poses[0], poses, range(6))], earth)
    room, upright, oriented = room_axes(log, path @ np.array([0.0, 0.0, 1.0]))
    assert upright and oriented == earth
    assert np.abs(room[:, :, 2] - path[:, :, 2]).max() < 5e-4
    seen = np.einsum(
        "tij,tik->tjk", path, room
    )  # the axes in the true room: they stay where they are
    assert np.abs(seen - seen[0]).max() < 1e-3
    assert np.allclose(seen[0].T @ seen[0], np.eye(3), atol=1e-6)
    if earth:
        assert np.abs(seen[0][:, 0] - [0.0, 1.0, 0.0]).max() < 1e-3  # `EARTH` has its north along y


def test_a_rate_at_rest_of_a_third_of_the_earths_is_no_north():
    poses = Rotation.random(6, np.random.default_rng(8))
    log, path = _log([_session(poses[0], poses, range(6))], False)
    offset = log.reference_gyro + path @ (
        EARTH / 3.0
    )  # its horizontal part is a fifth of the Earth rate
    log = eqx.tree_at(lambda one: one.reference_gyro, log, offset)
    _, upright, oriented = room_axes(log, path @ np.array([0.0, 0.0, 1.0]))
    assert upright and not oriented
