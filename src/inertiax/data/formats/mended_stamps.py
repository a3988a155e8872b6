"""Stamps of which a few repeat or go back, and clocks that begin anew: the others keep the clock."""

import numpy as np
from jaxtyping import Bool, Float, Int


# Of the rows: more are the clock itself (too coarse, or the host's), and no slips of it (convention).
_FEW = 0.05
# Usual steps: a stamp that goes back further is of a clock that began anew, not of a row that was late (convention).
LATE = 3.0
BESIDE = 5  # rows on each side that tell a clock that begins anew from a stamp that is far off alone (convention)
# Usual steps between what a clock that begins anew parts: how long it stood is not known, so that neither a rest nor a
# motion may go on across; longer than the pause that ends both.
_PAUSE = 25.0
# What counters of clocks hold, and their ticks in s (ms, an MTi's 0.1 ms, µs, ns).
_FULL = tuple(2.0**bits * tick for bits in (16, 24, 32) for tick in (1e-3, 1e-4, 1e-6, 1e-9))
# Usual steps that are left where a counter is full: stamps jitter, and a row or two may be missing there, too. That a
# clock which begins anew within an hour leaves as little by chance has, at 100 Hz, odds of 1 in 10^5.
_LEFT = (0.5, LATE)


def restarts(time: Float[np.ndarray, " rows"]) -> Int[np.ndarray, " restarts"]:
    """The rows before which a clock goes back, and stays back."""
    steps = np.diff(time)
    if not len(steps):
        return np.zeros(0, int)
    back = np.flatnonzero(steps < -LATE * np.median(steps)) + 1
    beside = lambda k: (np.median(time[max(k - BESIDE, 0) : k]), np.median(time[k : k + BESIDE]))
    return np.array([k for k in back if np.greater(*beside(k))], int)


def _joined(time: Float[np.ndarray, " rows"]) -> Float[np.ndarray, " rows"]:
    """The stamps with what follows a restart behind what was before it: after a pause, or after the usual step where
    a counter was full: of a number of ticks that counters hold, or by as much each time."""
    rows = restarts(time)
    if not len(rows):
        return time
    steps = np.diff(time)
    usual, back = np.median(steps), steps[rows - 1]
    alike = len(rows) > 1 and np.ptp(back) < LATE * usual
    held = _held(time, rows)
    later = np.zeros(len(time))
    later[rows] = np.where(held > 0.0, held, (1.0 if alike else _PAUSE) * usual - back)
    return time + np.cumsum(later)


def full(time: Float[np.ndarray, " rows"]) -> Int[np.ndarray, " some"]:
    """Those of the rows before which a clock goes back (`restarts`) where a counter was full: of 2^16, 2^24 or 2^32
    ticks, so that a usual step is left."""
    rows = restarts(time)
    return rows[_held(time, rows) > 0.0]


def _held(
    time: Float[np.ndarray, " rows"], rows: Int[np.ndarray, " restarts"]
) -> Float[np.ndarray, " restarts"]:
    """What the counter holds that is full before each of the rows, s; 0 where none is."""
    if not len(rows):
        return np.zeros(0)
    steps = np.diff(time)
    return counter_held(steps[rows - 1], float(np.median(steps)), float(np.ptp(time)))


def counter_held(
    back: Float[np.ndarray, " steps"], usual: float, span: float
) -> Float[np.ndarray, " steps"]:
    """What the counter holds that was full where a clock goes by `back` (negative), s; 0 where none was.

    **Arguments:** `usual` is the step from row to row, s, and `span` from the earliest stamp to the latest, s: a
    counter holds more than that. `live` asks for each row that goes back, `mended` for all rows at once.
    """
    if not usual > 0.0:  # most stamps stand still
        return np.zeros(len(back))
    counters = np.array([f for f in _FULL if span < f])
    left = (counters + back[:, None]) / usual
    fits = (left > _LEFT[0]) & (left < _LEFT[1])
    return np.where(fits, counters, 0.0).max(axis=1, initial=0.0)


def out_of_order(time: Float[np.ndarray, " rows"]) -> Bool[np.ndarray, " rows"]:
    """Which stamps are not later than all before them."""
    if len(time) == 0:
        return np.zeros(0, bool)
    return np.r_[False, time[1:] <= np.maximum.accumulate(time)[:-1]]


def can_be_mended(time: Float[np.ndarray, " rows"]) -> bool:
    """Whether the stamps that are out of order are few, a twentieth of the rows, and none goes back by three steps but
    where the clock begins anew."""
    if not np.isfinite(time).all() or len(time) < 3:
        return False
    time = _joined(time)
    if out_of_order(time).sum() > max(_FEW * len(time), 1.0):
        return False
    steps = np.diff(time)
    return bool(steps.min() >= -LATE * np.median(steps))


def mended(time: Float[np.ndarray, " rows"], where: str = "the log") -> Float[np.ndarray, " rows"]:
    """The stamps, strictly increasing: those out of order on the straight line between the others, over the row number.

    Behind the last that is in order they go on with the usual step. A clock that begins anew goes on after a pause
    of 25 steps, a counter that begins anew when it is full by what it holds. Raises `ValueError`, which names `where`
    they stand, where they are not few, or go back too far, as `can_be_mended` has it.

    ```python
    mended(np.array([0.0, 1.0, 1.0, 3.0, 4.0]))  # 0, 1, 2, 3, 4
    ```
    """
    if not can_be_mended(time) and out_of_order(time).any():
        raise ValueError(
            f"{where}: {int(out_of_order(time).sum())} of {len(time)} stamps are not later than all before them; "
            f"mend = true is for few ({_FEW:.0%} of the rows) that go back by less than {LATE:g} usual steps, and for "
            "clocks that begin anew; count rows with [columns] time = { rate = ... } in Hz."
        )
    time = _joined(time)
    out = out_of_order(time)
    if not out.any():
        return time
    rows = np.arange(len(time))
    kept = np.flatnonzero(~out)
    usual = np.median(np.diff(time[kept]) / np.diff(kept))
    beyond = np.maximum(rows - kept[-1], 0) * usual
    return np.interp(rows, kept, time[kept]) + beyond
