"""Streams of samples with stamps of their own, put onto one time base."""

import numpy as np
from jaxtyping import Float


def onto(
    time: Float[np.ndarray, " time"],
    other_time: Float[np.ndarray, " other"],
    values: Float[np.ndarray, "other channel"],
    where: str,
) -> Float[np.ndarray, "time channel"]:
    """A stream's values at other stamps (s): its own where the stamps agree, else straight lines.

    Raises `ValueError` where the stream's own stamps do not increase.
    """
    if len(time) == len(other_time) and np.array_equal(time, other_time):
        return values
    steps = np.diff(other_time)
    if np.any(steps <= 0):
        row = int(np.argmax(steps <= 0)) + 1
        raise ValueError(
            f"{where}: time must increase strictly, but sample {row} ({other_time[row]:.6f} s) does "
            f"not come after sample {row - 1} ({other_time[row - 1]:.6f} s)."
        )
    return np.stack([np.interp(time, other_time, v) for v in values.T], axis=1)


def shared(
    time: Float[np.ndarray, " time"], other_time: Float[np.ndarray, " other"], where: str
) -> slice:
    """Rows of `time` within another stream's span. Raises `ValueError` where there are none."""
    if np.any(np.diff(time) < 0):
        return slice(None)  # refused later, with the row
    first = int(np.searchsorted(time, other_time.min()))
    last = int(np.searchsorted(time, other_time.max(), side="right"))
    if last <= first:
        raise ValueError(
            f"{where}: the two triads were not logged at the same time ({time[0]:.3f} to {time[-1]:.3f} s "
            f"and {other_time.min():.3f} to {other_time.max():.3f} s)."
        )
    return slice(first, last)


def placed(
    time: Float[np.ndarray, " time"],
    other_time: Float[np.ndarray, " other"],
    values: Float[np.ndarray, "other channel"],
) -> Float[np.ndarray, "time channel"]:
    """A slower stream's samples in the rows nearest to their stamps (s), NaN in the others.

    Samples that are further from every row than rows are from each other are left out; of several for one row the last
    one is kept.
    """
    made = np.full((len(time), values.shape[1]), np.nan)
    if len(time) < 2:
        return made
    after = np.clip(np.searchsorted(time, other_time), 1, len(time) - 1)
    row = np.where(other_time - time[after - 1] < time[after] - other_time, after - 1, after)
    near = np.abs(time[row] - other_time) <= float(np.median(np.diff(time)))
    made[row[near]] = values[near]
    return made
