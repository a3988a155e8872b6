"""What one rest of a searched log shows alone is handling; what all show is physics. Logs by NumPy and SciPy alone."""

from dataclasses import replace

import equinox as eqx
import jax
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from inertiax.data.recording import Campaign, Recording, Site
from inertiax.diagnose import diagnose
from inertiax.diagnose.estimates.single_rests import _by_hand
from inertiax.diagnose.problem import prepare


REST, MOVE, NUM = 4.0, 1.5, 16  # s, s, rests
PERIOD = REST + MOVE
pytestmark = pytest.mark.slow


def hand_log(seed, *, creeping=None, shaken=None, sensitive=0.0, rate=25.0):
    """A log of a consumer device turned by hand.

    In rest `creeping` it turns about the vertical at 0.1 °/s, in rest `shaken` y of the accelerometers shakes, and
    the x gyro has a g-sensitivity of `sensitive`, rad/s per g; the noise has one density at every `rate`, Hz.
    """
    rng = np.random.default_rng(seed)
    time = np.arange(int((NUM * PERIOD - MOVE) * rate)) / rate
    noise = np.sqrt(rate / 50.0)
    which, phase = np.divmod(time, PERIOD)
    phase = (phase - REST) / MOVE
    turns = rng.normal(size=(NUM, 3))
    turns *= rng.uniform(1.0, 2.2, size=(NUM, 1)) / np.linalg.norm(turns, axis=1, keepdims=True)
    done = np.where(phase > 0, phase - np.sin(2 * np.pi * phase) / (2 * np.pi), 0.0)
    start = [Rotation.identity()]
    for turn in turns:
        start.append(start[-1] * Rotation.from_rotvec(turn))
    own = which.astype(int)
    attitude = Rotation.concatenate([start[k] for k in own]) * Rotation.from_rotvec(
        done[:, None] * turns[own]
    )
    up = attitude.inv().apply([0.0, 0.0, 1.0])
    turning = np.where(phase > 0, (1 - np.cos(2 * np.pi * phase)) / MOVE, 0.0)[:, None] * turns[own]
    still = phase <= 0
    if creeping is not None:
        turning[still & (own == creeping)] += np.radians(0.1) * up[still & (own == creeping)]
    accel = 9.81 * up @ np.array([[1.01, 0, 0], [0.004, 0.99, 0], [-0.006, 0.003, 1.005]]).T
    accel += [0.1, -0.2, 0.15] + 0.02 * noise * rng.normal(size=accel.shape)
    if shaken is not None:
        mine = still & (own == shaken) & (np.mod(time, PERIOD) > 1.5)
        accel[mine, 1] += 0.15 * np.sin(2 * np.pi * 0.7 * time[mine])
    gyro = turning + [0.01, -0.02, 0.005] + 1e-3 * noise * rng.normal(size=turning.shape)
    gyro[:, 0] += sensitive * up[:, 1]
    return Campaign((Recording(time=time, accel=accel, gyro=gyro, name="hand.csv"),), Site(9.81))


@pytest.mark.parametrize(("metres", "by_hand"), [(0.25, True), (1.0, False)])
def test_a_hand_cannot_have_moved_the_device_farther_than_it_reaches(metres, by_hand):
    """An error e of |a| over a rest of T seconds is an acceleration that carries the device e T²/2 away."""
    with jax.enable_x64(True):
        (accel, _) = prepare(hand_log(6)).triads
        blocks = accel.blocks
        mine = np.flatnonzero(blocks.dwell == 4)
        clock = accel.log.clock
        lasts = clock[blocks.stop[mine[-1]] - 1] - clock[blocks.start[mine[0]]]
        assert 2.0 < lasts <= REST
        moved = accel.system.base.observed[0].copy()
        moved[mine] += 2.0 * metres / lasts**2
        system = eqx.tree_at(lambda s: s.base.observed, accel.system, (moved,))
        assert _by_hand(replace(accel, system=system), 4, []) is by_hand


def alone(found):
    return [(d.start, d.end) for d in found.handling if d.kind == "alone"]


@pytest.mark.parametrize("seed", [1, 2])
def test_a_turn_about_the_vertical_in_one_rest_is_left_out(seed):
    """0.1 °/s stands 14 times above the mean's noise, 7e-4/√100 rad/s, and no accelerometer sees it."""
    found = diagnose(hand_log(seed, creeping=7))
    assert found.verdict == "consistent", found.summary
    assert any(7 * PERIOD - 0.5 < a and b < 7 * PERIOD + REST + 0.5 for a, b in alone(found))


def test_one_rest_that_shook_is_no_reason_for_unexplained():
    found = diagnose(hand_log(3, shaken=5, rate=50.0))
    assert found.verdict == "consistent", found.summary


def test_what_all_rests_show_is_named_beside_a_rest_that_crept():
    """0.3 mrad/s per g over 16 directions is about 9 standard deviations."""
    found = diagnose(hand_log(4, creeping=9, sensitive=1e-3))
    assert found.verdict == "missing-physics", found.summary
    assert {e.name for e in found.effects} == {"g_sensitivity"}
    assert found.effects[0].channels == ("gyro_x",)
