"""Stamps of which a few repeat or go back: put between their neighbours, so that the others keep the clock."""

import numpy as np
from jaxtyping import Bool, Float


# Of the rows: more are the clock itself (too coarse, or the host's), and no slips of it (convention).
_FEW = 0.05
# Usual steps: a stamp that goes back further is of a clock that began anew, not of a row that was late (convention).
_LATE = 3.0


def out_of_order(time: Float[np.ndarray, " rows"]) -> Bool[np.ndarray, " rows"]:
    """Which stamps are not later than all before them."""
    if len(time) == 0:
        return np.zeros(0, bool)
    return np.r_[False, time[1:] <= np.maximum.accumulate(time)[:-1]]


def can_be_mended(time: Float[np.ndarray, " rows"]) -> bool:
    """Whether the stamps that are out of order are few, a twentieth of the rows, and none goes back by three steps."""
    out = out_of_order(time)
    if not np.isfinite(time).all() or len(time) < 3 or out.sum() > max(_FEW * len(time), 1.0):
        return False
    steps = np.diff(time)
    return bool(steps.min() >= -_LATE * np.median(steps))


def mended(time: Float[np.ndarray, " rows"], where: str = "the log") -> Float[np.ndarray, " rows"]:
    """The stamps, strictly increasing: those out of order on the straight line between the others, over the row number.

    Behind the last that is in order they go on with the usual step. Raises `ValueError`, which names `where` they
    stand, where they are not few, or go back too far, as `can_be_mended` has it.

    ```python
    mended(np.array([0.0, 1.0, 1.0, 3.0, 4.0]))  # 0, 1, 2, 3, 4
    ```
    """
    out = out_of_order(time)
    if not out.any():
        return time
    if not can_be_mended(time):
        raise ValueError(
            f"{where}: {int(out.sum())} of {len(time)} stamps are not later than all before them; mend = true is for "
            f"few ({_FEW:.0%} of the rows) that go back by less than {_LATE:g} usual steps; "
            "count rows with [columns] time = { rate = ... } in Hz."
        )
    rows = np.arange(len(time))
    kept = np.flatnonzero(~out)
    usual = np.median(np.diff(time[kept]) / np.diff(kept))
    beyond = np.maximum(rows - kept[-1], 0) * usual
    return np.interp(rows, kept, time[kept]) + beyond
