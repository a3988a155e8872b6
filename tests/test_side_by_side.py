"""Work on several long arrays at once."""

import os
import threading

import pytest

from inertiax.numerics.side_by_side import side_by_side, WORTH


def test_long_items_are_worked_on_in_threads_and_answered_in_their_order():
    both = threading.Barrier(2, timeout=20.0)

    def one(k):
        if k < 2:
            both.wait()  # passed by no one thread alone
        return k, threading.current_thread() is threading.main_thread()

    if (threads := os.cpu_count() or 1) < 2:
        pytest.skip(f"{threads} processor")
    assert side_by_side(one, range(5), rows=WORTH) == [(k, False) for k in range(5)]


def test_short_items_are_worked_on_one_after_the_other():
    here = threading.current_thread()
    told = side_by_side(lambda k: threading.current_thread() is here, range(3), rows=WORTH - 1)
    assert told == [True] * 3


def test_the_first_error_in_the_items_order_is_raised():
    def one(k):
        raise ValueError(f"item {k}")

    with pytest.raises(ValueError, match="item 0"):
        side_by_side(one, range(4), rows=WORTH)
