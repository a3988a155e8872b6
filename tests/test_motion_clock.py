"""Rows are counted where gravity says that the stamps are a host's, and only there."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from inertiax.reduction.motion_clock import counted, motion_clock, Turn, uneven


REST, MOVE, RATE = 2.0, 1.2, 100.0  # s, s, Hz


def ride(rng, taken, num=12):
    """Rates about one axis a motion at the instants `taken`, s, and the direction of gravity in each rest."""
    gyro, up, attitude = np.zeros((len(taken), 3)), [np.array([0.0, 0.0, 1.0])], Rotation.identity()
    for k in range(num):
        axis = rng.normal(size=3)
        turn = axis / np.linalg.norm(axis) * rng.uniform(1.0, 2.0)
        begin = REST + k * (REST + MOVE)
        phase = (taken - begin) / MOVE
        moving = (phase > 0) & (phase < 1)
        gyro[moving] += ((1 - np.cos(2 * np.pi * phase[moving])) / MOVE)[:, None] * turn
        attitude = attitude * Rotation.from_rotvec(
            turn
        )  # body axes: the turn is about its own axis
        up.append(attitude.inv().apply([0.0, 0.0, 1.0]))
    return gyro, up


def turns_of(taken, up):
    found = []
    for k in range(len(up) - 1):
        begin = REST + k * (REST + MOVE)
        first = int(np.searchsorted(taken, begin - 0.2))
        last = int(np.searchsorted(taken, begin + MOVE + 0.2))
        found.append(Turn(first, last, up[k], up[k + 1], np.zeros(3)))
    return found


def sampled(seed, *, host_delay, poll_jitter):
    """Stamps, rates and turns of a sensor read at instants `poll_jitter` off a constant rate and stamped late, s."""
    rng = np.random.default_rng(seed)
    number = np.arange(int((13 * REST + 12 * MOVE) * RATE))
    taken = np.sort(number / RATE + poll_jitter * rng.uniform(-1, 1, len(number)))
    gyro, up = ride(rng, taken)
    gyro = 1.01 * gyro + 1e-3 * rng.normal(
        size=gyro.shape
    )  # a scale factor's error must not decide
    stamps = np.maximum.accumulate(taken + host_delay * rng.uniform(0, 1, len(taken)))
    stamps += 1e-9 * number
    return stamps, gyro, turns_of(taken, up)


@pytest.mark.parametrize("seed", range(6))
def test_a_hosts_stamps_give_way_to_counted_rows(seed):
    stamps, gyro, turns = sampled(seed, host_delay=8e-3, poll_jitter=0.0)
    clock = motion_clock(stamps, gyro, turns)
    assert clock.rate == pytest.approx(
        RATE, rel=1e-4
    )  # over 40 s the delay of 8 ms is 2e-4 at its ends
    assert "rows are counted at 100" in clock.statement


@pytest.mark.parametrize("seed", range(3))
def test_rows_are_not_counted_where_single_ones_are_missing(seed):
    """Late stamps as above, and every fiftieth row lost: by rows every gyro would be off by 2 %."""
    stamps, gyro, turns = sampled(seed, host_delay=8e-3, poll_jitter=0.0)
    kept = np.flatnonzero(np.random.default_rng(seed).random(len(stamps)) > 0.02)
    moved = [
        t._replace(
            first=int(np.searchsorted(kept, t.first)), last=int(np.searchsorted(kept, t.last))
        )
        for t in turns
    ]
    assert motion_clock(stamps[kept], gyro[kept], moved).rate is None


@pytest.mark.parametrize("seed", range(6))
def test_true_stamps_of_uneven_samples_are_kept(seed):
    stamps, gyro, turns = sampled(seed, host_delay=0.0, poll_jitter=4e-3)
    assert uneven(stamps) is not None
    clock = motion_clock(stamps, gyro, turns)
    assert clock.rate is None and clock.time is stamps


def test_even_stamps_and_few_motions_are_left_alone():
    stamps, gyro, turns = sampled(0, host_delay=0.0, poll_jitter=0.0)
    assert uneven(stamps) is None and motion_clock(stamps, gyro, turns).time is stamps
    stamps, gyro, turns = sampled(0, host_delay=8e-3, poll_jitter=0.0)
    assert motion_clock(stamps, gyro, turns[:4]).rate is None  # eight numbers for nine errors


def test_missing_rows_stay_missing():
    even = np.delete(np.arange(1000) / RATE, slice(400, 450))
    late = even + 3e-3 * np.random.default_rng(1).uniform(size=len(even))
    steps = np.diff(counted(late))
    assert steps[399] == pytest.approx(51 / RATE, rel=1e-3)
    assert np.delete(steps, 399) == pytest.approx(1 / RATE, rel=1e-3)
