"""Rows of a log in the making by their stamps: what is late, what is garbled, and what begins another recording."""

import numpy as np
import pytest

from inertiax.data.formats.mended_stamps import mended, out_of_order, restarts
from inertiax.live.stamp_order import LEAP, Place, StampOrder


STEP = 0.01


def placed(time, size=None, order=None):
    """The places of all rows, which come `size` at a time."""
    order, found, waiting = order or StampOrder(), [], np.zeros(0)
    size = size or len(time)
    for first in range(0, len(time), size):
        waiting = np.append(waiting, time[first : first + size])
        told = order.places(waiting)
        found, waiting = found + told, waiting[len(told) :]
        assert len(waiting) < 5  # no more wait for what follows
    return found + order.places(waiting, end=True)


def at(found, place):
    return [k for k, p in enumerate(found) if p is place]


def clock(count=400):
    return STEP * np.arange(count)


def swapped(time, *rows):
    time = time.copy()
    for k in rows:
        time[[k, k + 1]] = time[[k + 1, k]]
    return time


SIZES = pytest.mark.parametrize("size", [1, 3, 40, None])


@SIZES
@pytest.mark.parametrize("apart", [2, 3, 20, 95, 105])
def test_rows_that_came_late_are_put_aside_and_all_others_go_on(apart, size):
    time = swapped(clock(), 150, 150 + apart)
    found = placed(time, size)
    assert at(found, Place.ASIDE) == [151, 151 + apart] == list(np.flatnonzero(out_of_order(time)))
    assert len(at(found, Place.GOES_ON)) == 398 and not len(restarts(time))


@SIZES
@pytest.mark.parametrize("rows", [6, 30, 200])
def test_a_clock_that_begins_anew_begins_a_recording_also_twice_in_quick_succession(rows, size):
    time = np.concatenate([clock(300), clock(rows), clock(300)])
    found = placed(time, size)
    assert at(found, Place.BEGINS) == [300, 300 + rows] == list(restarts(time))
    assert not at(found, Place.ASIDE)


@SIZES
def test_rows_between_two_restarts_that_are_too_few_to_tell_are_put_aside(size):
    found = placed(np.concatenate([clock(300), clock(3), clock(300)]), size)
    assert at(found, Place.ASIDE) == [300, 301, 302] and at(found, Place.BEGINS) == [303]


@SIZES
@pytest.mark.parametrize("stamp", [0.0, 1.0, 2.08, 50.0, 1e9])
def test_a_stamp_that_is_far_off_alone_costs_its_row_and_no_other(stamp, size):
    time = clock()
    time[200] = stamp
    found = placed(time, size)
    assert at(found, Place.ASIDE) == [200] and len(at(found, Place.GOES_ON)) == 399


@SIZES
def test_a_gap_goes_on_and_a_leap_begins_another_recording(size):
    time = clock()
    time[100:] += 0.5 * LEAP
    time[300:] += LEAP
    found = placed(time, size)
    assert at(found, Place.BEGINS) == [300] and len(at(found, Place.GOES_ON)) == 399


@SIZES
def test_a_stamp_that_stands_again_is_told_from_one_that_is_late(size):
    time = swapped(clock(), 50)
    time[120] = time[119]
    found = placed(time, size)
    assert at(found, Place.AGAIN) == [120] and at(found, Place.ASIDE) == [51]


@pytest.mark.parametrize("apart", [0.025, 0.5, 300.0])
def test_of_two_logs_that_come_mixed_one_goes_on(apart):
    """A logger that mixes two clocks makes no recording of each row."""
    time = np.stack([clock(), clock() - apart], axis=1).ravel()
    found = placed(time, 40)
    assert len(at(found, Place.BEGINS)) <= 1 and len(at(found, Place.GOES_ON)) >= 399


def test_after_any_disturbance_all_rows_go_on():
    for seed in range(200):
        rng = np.random.default_rng(seed)
        time = clock(600)
        for k in rng.integers(20, 400, rng.integers(1, 6)):
            kind = rng.integers(4)
            if kind == 0:
                time[k:] -= time[k] * rng.random()
            elif kind == 1:
                time = swapped(time, k)
            elif kind == 2:
                time[k] += rng.normal() * 10.0 ** rng.integers(-2, 6)
            else:
                time[k:] += 10.0 ** rng.integers(-1, 4)
        found = placed(time, int(rng.integers(1, 60)))
        assert len(found) == 600
        # A disturbance costs its own row or two, those of a restart that others disturb, and a clock that is set back
        # by a few steps those.
        assert len(at(found, Place.ASIDE)) <= 30, seed
        assert set(found[450:]) == {Place.GOES_ON}, seed
        parts = np.split(time, at(found, Place.BEGINS))
        for part, places in zip(parts, np.split(np.array(found), at(found, Place.BEGINS))):
            going = part[[p in (Place.GOES_ON, Place.BEGINS) for p in places]]
            assert np.all(np.diff(going) > 0.0), seed


@SIZES
@pytest.mark.parametrize(("bits", "tick"), [(16, 1e-3), (24, 1e-6), (32, 1e-6), (32, 1e-9)])
def test_a_counter_that_was_full_goes_on_as_the_batch_reader_has_it(bits, tick, size):
    full = 2.0**bits * tick
    step = min(STEP, full / 800.0)
    time = (full - 300.5 * step) + step * np.arange(700)
    time = np.round(np.where(time >= full, time - full, time) / tick) * tick
    order = StampOrder()
    found = placed(time, size, order)
    assert at(found, Place.FULL) == [301] and len(at(found, Place.GOES_ON)) == 699
    assert order.counter == full
    went_on = time + np.where(np.arange(700) >= 301, order.counter, 0.0)
    np.testing.assert_allclose(went_on, mended(time), rtol=0.0, atol=1e-12 * full)


def test_a_clock_that_begins_anew_at_another_number_is_no_full_counter():
    time = np.concatenate([65.0 + clock(40), clock(300)])  # 65.39 s are no 65.536 s
    assert at(placed(time), Place.BEGINS) == [40]
