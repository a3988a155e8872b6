"""Angles of a table whose telegram comes less often than its rows, and which a log therefore holds: stairs.

While two axes turn at once, what a gyro reads is the product of one axis's rate and the sine or cosine of another's
angle. Means of a product are wrong where both factors are smoothed: an inner axis that turns by δ over the smoothing
time takes δ²/24 from the outer axis's turn, at 60 °/s and 0.2 s 1800 ppm. Straight lines between the telegrams keep it.
"""

import numpy as np
from jaxtyping import Float


NO_DIGIT = 1e-9  # rad, the rounding of numbers; a smaller change is none
_MANY_STEPS = 16  # from which the usual number of rows between them is told (convention)
_LATE = 1.5  # of the usual rows between two telegrams: later, the one before said the same again
# Rows that repeat the one before, at most; and how the change a row behind them is to the one before them, of an axis
# that may speed up or slow down (conventions).
_MOST_REPEATS, _MAKES_UP = 4, (0.7, 1.5)


def held_rows(angles: Float[np.ndarray, "rows axes"]) -> int:
    """Rows for which an angle is held: a table's telegram that comes less often than the log's rows makes stairs of it.

    The usual number of rows from one change to the next, of the axis with the fewest; whole turns are no change.

    ```python
    import numpy as np
    from inertiax.data.formats.held_angles import held_rows

    print(held_rows(np.repeat(0.1 * np.arange(30.0), 4)[:, None]))    # 4
    ```
    """
    steps = np.abs(whole_turns_away(np.diff(angles, axis=0))) > NO_DIGIT
    apart = [np.diff(np.flatnonzero(axis)) for axis in steps.T]
    usual = [float(np.median(rows)) for rows in apart if len(rows) >= _MANY_STEPS]
    return max(1, round(min(usual))) if usual else 1


def without_stairs(
    angles: Float[np.ndarray, "rows axes"], time: Float[np.ndarray, " rows"]
) -> Float[np.ndarray, "rows axes"]:
    """The same with straight lines between the telegrams, the row of each as it stands; beyond a whole turn they go on.

    Angles that are not held stay as they are; so do those with gaps, and those of a clock that goes back.

    **Arguments:** `angles` in rad, `time` in s.

    ```python
    import numpy as np
    from inertiax.data.formats.held_angles import without_stairs

    stairs = np.repeat(0.1 * np.arange(30.0), 4)[:, None]
    print(without_stairs(stairs, np.arange(120.0))[60:65, 0].round(3))    # [1.5   1.525 1.55  1.575 1.6  ]
    ```
    """
    held = held_rows(angles)
    if held == 1 or not np.isfinite(angles).all() or np.any(np.diff(time) <= 0.0):
        return angles
    made = np.unwrap(angles, axis=0)
    for axis in made.T:
        fresh = 1 + np.flatnonzero(np.abs(np.diff(axis)) > NO_DIGIT)
        # After a rest the first telegram of a move comes that many rows after one that still said the rest's angle.
        again = fresh[np.diff(fresh, prepend=0) > _LATE * held] - held
        rows = np.unique(np.r_[0, again, fresh, len(time) - 1])
        axis[:] = np.interp(time, time[rows], axis[rows])
    return made


def without_repeats(
    angles: Float[np.ndarray, "rows axes"], time: Float[np.ndarray, " rows"]
) -> Float[np.ndarray, "rows axes"]:
    """The same with straight lines through rows that repeat the one before while the axis goes on turning.

    A logger that asks a table more often than it has a new angle writes such rows now and then; a rate were zero there
    and doubled in the next row. The change behind n of them makes up for them: it is about n + 1 times the one before.

    **Arguments:** `angles` in rad, `time` in s. Stairs (`held_rows`) and rests stay.

    ```python
    import numpy as np
    from inertiax.data.formats.held_angles import without_repeats

    angle = np.array([0.0, 0.1, 0.2, 0.2, 0.4, 0.5])[:, None]
    print(without_repeats(angle, np.arange(6.0))[:, 0].round(3))    # [0.  0.1 0.2 0.3 0.4 0.5]
    ```
    """
    if held_rows(angles) > 1 or not np.isfinite(angles).all() or np.any(np.diff(time) <= 0.0):
        return angles
    made = angles
    for k, axis in enumerate(np.unwrap(angles, axis=0).T):
        steps = np.diff(axis)
        moved = np.flatnonzero(np.abs(steps) > NO_DIGIT)
        rows = np.diff(moved)  # from each change to the next
        # A change behind repeats of its own is that of several rows.
        own = np.where(np.r_[1, rows[:-1]] > _MOST_REPEATS + 1, 1, np.r_[1, rows[:-1]])
        before, after = steps[moved[:-1]] / own, steps[moved[1:]] / rows
        filled = (rows > 1) & (rows <= _MOST_REPEATS + 1)
        low, high = _MAKES_UP
        with np.errstate(divide="ignore"):
            filled &= (low < after / before) & (after / before < high)
        if not filled.any():
            continue
        stale = np.zeros(len(axis), bool)
        for a, b in zip(moved[:-1][filled] + 1, moved[1:][filled]):
            stale[a + 1 : b + 1] = True
        made = made.copy() if made is angles else made
        made[:, k] = np.where(stale, np.interp(time, time[~stale], axis[~stale]), axis)
    return made


def whole_turns_away(angles: Float[np.ndarray, "rows axes"]) -> Float[np.ndarray, "rows axes"]:
    """Differences of angles without whole turns, from −π to π, rad.

    ```python
    import numpy as np
    from inertiax.data.formats.held_angles import whole_turns_away

    print(whole_turns_away(np.array([[2.0 * np.pi + 0.1]])).round(3))    # [[0.1]]
    ```
    """
    return angles - 2.0 * np.pi * np.round(angles / (2.0 * np.pi))
