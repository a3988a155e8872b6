"""Turns between rests as `live` integrates them: over missing rows, uneven stamps, and turns of which rows are lost."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from inertiax.data.recording import Campaign, Recording, Rig, Site
from inertiax.live.gyro_rows import integrated
from inertiax.live.rest_ledger import Rest
from inertiax.live.row_store import RowStore
from inertiax.live.session import Session
from inertiax.live.target import parse_target
from inertiax.live.turns import Turns


GRAVITY = 9.81
REST, TURN = 3.0, 1.5  # s
AXES = np.eye(3)[[0, 1, 2, 0, 1, 2, 0, 1]] + 0.3
BIAS = np.array([0.01, -0.02, 0.005])


def device(rate, *, seed=1, noise=0.0, axes=AXES):
    """Stamps, forces, rates and where rests are (s) of a device that is turned about axes, by SciPy's rotations.

    Rates are those at the stamps; a turn is a raised cosine, whose ends are at rest.
    """
    fine = round(rate) * (10 if rate < 500.0 else 2)  # steps a second of the truth
    rng, now, forces, rates, rests = np.random.default_rng(seed), Rotation.identity(), [], [], []
    for k in range(len(axes) + 1):
        begin = sum(map(len, forces)) / fine
        rests.append((begin, begin + REST))
        forces.append(np.tile(now.inv().apply([0, 0, GRAVITY]), (round(REST * fine), 1)))
        rates.append(np.zeros((round(REST * fine), 3)))
        if k == len(axes):
            break
        axis = axes[k] / np.linalg.norm(axes[k])
        share = (np.arange(round(TURN * fine)) + 0.5) / round(TURN * fine)
        speed = (1.0 + 0.3 * k) * (1.0 - np.cos(2.0 * np.pi * share)) / TURN
        wobble = 0.2 * np.stack([np.sin(6 * share), np.cos(9 * share), 0 * share], axis=1)
        omega = speed[:, None] * (axis + wobble)
        made = []
        for one in omega:
            made.append(now.inv().apply([0, 0, GRAVITY]))
            now = now * Rotation.from_rotvec(one / fine)
        forces.append(np.array(made))
        rates.append(omega)
    force, omega = (np.concatenate(x)[:: fine // round(rate)] for x in (forces, rates))
    time = np.arange(len(force)) / rate
    force = force + 10.0 * noise * rng.standard_normal(force.shape)
    return time, force, omega + BIAS + noise * rng.standard_normal(omega.shape), rests


def between(time, force, rate, rests, *, stamps=None):
    """The turns of these rows, which come at `time` and are stamped so unless `stamps` says otherwise."""
    stamps = time if stamps is None else stamps
    store = RowStore("recording-1")
    store.add(Recording(np.arange(float(len(time))), accel=force, gyro=rate), stamps)
    # Thinned rows of each rest, a tenth of a second within its ends.
    places = (np.arange(store.count) * store.factor).astype(int)
    made = []
    for number, (begin, end) in enumerate(rests, start=1):
        inside = np.flatnonzero((time[places] > begin + 0.1) & (time[places] < end - 0.1))
        a, b = int(inside[0]), int(inside[-1]) + 1
        rows = slice(places[a], places[b - 1])
        one = Rest(number, 1, a, b, (float(time[places[a]]), float(time[places[b - 1]])))
        one.accel, one.gyro = force[rows].mean(axis=0), rate[rows].mean(axis=0)
        one.accel_covariance = one.gyro_covariance = 1e-8 * np.eye(3)
        made.append(one)
    return Turns([store]).between(made, lambda outputs: outputs), made


def misses(turns):
    """Angle by which each turn misses the direction that the rest after it reads, rad."""
    made = []
    for turn in turns:
        whole = integrated(turn, np.zeros((3, 3))).rotation
        made.append(np.linalg.norm(np.cross(whole.T @ turn.before, turn.after)) / GRAVITY**2)
    return np.array(made)


def without(rows, *columns):
    kept = np.setdiff1d(np.arange(len(columns[0])), rows)
    return [c[kept] for c in columns]


# A rate that bends by 20 rad/s³ over a gap of 20 ms is off its straight line by h³/12 of that: 1e-5 rad.
@pytest.mark.parametrize("rate", [100.0, 500.0])
def test_a_turn_with_missing_rows_turns_as_far_as_it_did(rate):
    time, force, omega, rests = device(rate)
    whole, _ = between(time, force, omega, rests)
    assert len(whole) == len(AXES) and misses(whole).max() < 1e-4
    gone = [round((rests[k][1] + 0.4) * rate) for k in range(len(AXES))]
    if rate > 100.0:  # a tenth of the rows that a thinned one stands for
        gone = [g + n for g in gone for n in range(8)]
    time, force, omega = without(gone, time, force, omega)
    lost, _ = between(time, force, omega, rests)
    assert len(lost) == len(AXES) and misses(lost).max() < 1e-4
    assert max(t.step.max() for t in lost) > 0.014


def test_rows_are_counted_where_a_host_stamps_unevenly_and_gravity_says_so():
    time, force, omega, rests = device(100.0)
    late = 0.004 * np.random.default_rng(2).random(len(time))
    turns, _ = between(time, force, omega, rests, stamps=time + late)
    assert len(turns) == len(AXES) and misses(turns).max() < 2e-4
    assert all(np.ptp(t.step) < 1e-9 for t in turns)
    # A program that reads the sensor when it wakes up stamps rightly.
    awake = [
        np.column_stack([np.interp(time + late, time, c) for c in x.T]) for x in (force, omega)
    ]
    turns, _ = between(time + late, *awake, rests)
    assert misses(turns).max() < 1e-4 and all(np.ptp(t.step) > 1e-3 for t in turns)


def test_a_turn_of_which_rows_are_lost_without_a_gap_in_the_stamps_is_left_out():
    time, force, omega, rests = device(100.0)
    first = round((rests[5][1] + 0.5) * 100)
    force, omega = without(np.arange(first, first + 50), force, omega)
    rests = [(a - 0.5 * (a > rests[5][1]), b - 0.5 * (a > rests[5][1])) for a, b in rests]
    turns, made = between(time[:-50], force, omega, rests)
    assert len(turns) == len(AXES) - 1 and misses(turns).max() < 1e-4
    assert not any(np.array_equal(t.before, made[5].accel) for t in turns)


def test_a_turn_at_the_end_of_the_gyros_range_is_left_out():
    """As in the batch estimate: the fastest of the turns is cut off at the range."""
    time, force, omega, rests = device(100.0, noise=1e-4)
    fastest = np.abs(omega).max(axis=0)
    axis = int(np.argmax(fastest))
    rows = slice(round(rests[7][1] * 100), round(rests[8][0] * 100))
    limit = 0.98 * np.abs(omega[rows, axis]).max()
    others = np.delete(np.arange(len(omega)), np.r_[rows])
    assert np.abs(omega[others, axis]).max() < limit < np.abs(omega[rows, axis]).max()
    cut = omega.copy()
    cut[:, axis] = np.clip(cut[:, axis], -limit, limit)
    turns, made = between(time, force, cut, rests)
    assert len(turns) == len(AXES) - 1
    assert not any(np.array_equal(t.before, made[7].accel) for t in turns)


def replayed(rows):
    session = Session(Campaign((), Site(GRAVITY), Rig()), parse_target("gyro.scale=100 ppm"))
    for first in range(0, len(rows[0]), 20):
        time, force, omega = (c[first : first + 20] for c in rows)
        list(session.feed(Recording(time, accel=force, gyro=omega), time))
    list(session.end())
    assert session.estimate is not None
    return [session.estimate.parameters()[f"gyro.matrix[{i},{i}]"]["std"] for i in range(3)]


@pytest.mark.slow
def test_lost_rows_take_nothing_of_what_the_turns_tell_of_the_gyros():
    rng = np.random.default_rng(3)
    axes = rng.standard_normal((14, 3))
    *rows, rests = device(100.0, noise=1e-3, axes=axes)
    whole = replayed(rows)
    one = replayed(without([round((rests[0][1] + 0.7) * 100)], *rows))
    some = replayed(without(rng.choice(len(rows[0]), len(rows[0]) // 120, replace=False), *rows))
    # Other rows are other noise: of 28 equations the scatter is known to a seventh.
    for lost in (one, some):
        assert np.all(np.array(lost) < 1.4 * np.array(whole)), (whole, lost)
