"""What a column is by its numbers alone: a clock, a counter, a label, a date, or an output."""

import numpy as np
from jaxtyping import Float

from .raw_log import RawLog
from .split_stamps import EPOCH


_MOST_LABELS = 32
# Values of an output beside a constant: sensors so coarse that one of them stands still have fewer.
_FEWEST_VALUES = 8
_SET_BACK = 0.02  # of the rows of a clock: a logger that started anew, or rows that were sent again
# Of the rows of such a clock rise, which no output does for long but an angle of a device that keeps turning; that
# begins anew after a turn.
_GOES_ON = 0.95
_TURNS = (360.0, 400.0, 2.0 * np.pi)
_NEAR_A_TURN = 0.05
_FEWEST_ROWS = 50
_YEARS = (1990.0, 2100.0)
# Of the rows an estimate of a bias changes, which a system renews from time to time, and an output beside it does
# (convention; Android's changes in up to one row of a hundred, and its outputs stand still in one of eight).
_RENEWED, _MOVES = 0.05, 0.5


def rises(log: RawLog, name: str) -> bool:
    """Whether a column rises from row to row as a clock does: the longest step is no half of the whole."""
    values = log.numbers[name]
    steps = np.diff(values)
    return is_clock(values) and float(steps.max()) < 0.5 * float(steps.sum()) and len(steps) > 50


def varies(values: Float[np.ndarray, " rows"]) -> bool:
    """Whether a column holds more than one number, empty fields aside."""
    told = values[np.isfinite(values)]
    return len(told) > 0 and bool(np.any(told != told[0]))


def is_clock(values: Float[np.ndarray, " rows"]) -> bool:
    """Whether a column never goes back and mostly goes on: a host may stamp rows alike that it read together."""
    steps = np.diff(values)
    rises = len(steps) > 0 and np.all(steps >= 0.0) and np.mean(steps > 0.0) > 0.5
    return bool(rises) and not is_counter(values)


def is_clock_set_back(values: Float[np.ndarray, " rows"]) -> bool:
    """Whether a column rises in nearly all rows, as a clock does that goes back a few times."""
    steps = np.diff(values)
    if len(steps) < _FEWEST_ROWS or np.mean(steps > 0.0) < _GOES_ON:
        return False
    forward, backward = steps[steps > 0.0], steps[~(steps >= 0.0)]
    a_turn = any(abs(np.nanmax(-backward, initial=0.0) / t - 1.0) < _NEAR_A_TURN for t in _TURNS)
    counts = bool(np.all(forward == 1.0))
    return len(backward) <= _SET_BACK * len(steps) and not a_turn and not counts


def is_counter(values: Float[np.ndarray, " rows"]) -> bool:
    """Row numbers: whole, one apart."""
    return len(values) > 1 and bool(np.all(np.diff(values) == 1.0))


def is_no_output(log: RawLog, names: list[str]) -> bool:
    """Whether the first column counts rows, holds whole seconds since 1970, a few labels before numbers that are
    not whole, or one whole number before outputs that vary."""
    first = log.numbers[names[0]]
    if is_counter(first) or _is_before_outputs(log, names):
        return True
    told = first[np.isfinite(first)]
    if not are_whole(told):
        return False
    if len(told) and EPOCH[0] < told.min() and told.max() < EPOCH[1]:
        return True
    others = [log.numbers[n] for n in names[1:]]
    few = bool(others) and len(np.unique(told)) <= _MOST_LABELS
    return few and not any(are_whole(x) for x in others)


def _is_before_outputs(log: RawLog, names: list[str]) -> bool:
    """Whether the first column is a mark, and the first one behind it that varies takes many values: an output of a
    sensor that rests may be one whole number, but then those beside it are nearly so."""
    after = next((log.numbers[n] for n in names[1:] if varies(log.numbers[n])), None)
    if not is_mark(log.numbers[names[0]]) or len(names) <= len("xyz") or after is None:
        return False
    return len(np.unique(after[np.isfinite(after)])) > _FEWEST_VALUES


def is_bias_estimate(
    log: RawLog, outputs: tuple[str, str, str], triad: tuple[str, str, str]
) -> bool:
    """Whether three columns hardly ever change behind three that do nearly always: what the system takes for the
    outputs' bias, as Android writes it behind an uncalibrated sensor. Whole numbers may be a coarse sensor's."""
    after, before = (np.stack([log.numbers[n] for n in t], axis=1) for t in (triad, outputs))
    if len(after) < _FEWEST_ROWS or not np.isfinite(after).all() or are_whole(after):
        return False
    renewed = np.any(np.diff(after, axis=0) != 0.0, axis=1).mean()
    moves = np.all(np.diff(before, axis=0) != 0.0, axis=1).mean()
    return bool(renewed < _RENEWED and moves > _MOVES)


def date_columns(log: RawLog, names: list[str]) -> tuple[str, ...]:
    """Year, month and day, in this order or backwards, in three columns one behind another; empty where none are."""
    for three in zip(names, names[1:], names[2:], strict=False):
        for year, month, day in (three, three[::-1]):
            spans = ((year, *_YEARS), (month, 1.0, 12.0), (day, 1.0, 31.0))
            if all(_stays_within(log.numbers[n], low, high) for n, low, high in spans):
                return three
    return ()


def _stays_within(values: Float[np.ndarray, " rows"], low: float, high: float) -> bool:
    """Whether a column holds whole numbers of a range, which hardly ever change."""
    told = values[np.isfinite(values)]
    if not len(told) or not are_whole(told) or np.mean(np.diff(told) != 0.0) > _SET_BACK:
        return False
    return bool(low <= told.min() and told.max() <= high)


def is_mark(values: Float[np.ndarray, " rows"]) -> bool:
    """Whether a column is one whole number but zero throughout: what kind of sensor follows, as phone apps write it."""
    told = values[np.isfinite(values)]
    return bool(len(told) > 0 and told[0] != 0.0 and are_whole(told) and np.all(told == told[0]))


def are_whole(values: Float[np.ndarray, " rows"]) -> bool:
    """Whether all numbers are whole, empty fields aside."""
    told = values[np.isfinite(values)]
    return bool(np.all(told == np.round(told)))
