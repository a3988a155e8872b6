"""Which clock the motions between rests are integrated by: the stamps, or rows counted at a constant rate.

A host that stamps rows as they arrive (ROS, a serial line) adds its own delay to each of them, although the sensor
takes them at a constant rate. A program that reads the sensor when it wakes up stamps rightly. Stamps alone do not
tell the two apart; gravity does: with the right clock the gyros turn it as the accelerometers saw it turn.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from .turned_direction import turned


_UNEVEN = 0.05  # of the usual step: a sensor's own stamps vary by less
_SHARE = 0.05  # of the steps that are uneven, at least
_LOST = 2.5  # usual steps: rows are missing
_ROWS = 100  # whose mean delay is looked at
_WANDERS = (
    0.5  # of the scatter of single stamps: means of so many independent delays scatter by a tenth
)
_FEWEST = 5  # motions; each says two numbers
_BETTER = 0.8  # rms misfit with rows counted over that by the stamps; the same motions, so chance changes it little
_LINEAR = 0.02  # usual size of a scale factor's or misalignment's error, which is fitted first
_NOISE = 2e-3  # rad, of one motion at best: what the directions at rest are known to


class MotionClock(NamedTuple):
    """Times to integrate by, and what was found where they are not the stamps."""

    time: Float[np.ndarray, " time"]  # s
    rate: float | None  # Hz at which rows are counted
    statement: str


class Turn(NamedTuple):
    """A motion from one rest to the next, rows `[first, last]` of its recording."""

    first: int
    last: int
    before: Float[np.ndarray, "3"]  # unit vectors of the specific force, compensated
    after: Float[np.ndarray, "3"]
    bias: Float[np.ndarray, "3"]  # rad/s, of the gyros


def uneven(time: Float[np.ndarray, " time"]) -> float | None:
    """Standard deviation of uneven stamps about a constant rate, s; `None` where they are even."""
    steps = np.diff(time)
    if len(steps) < 100:
        return None
    usual = float(np.median(steps))
    if np.mean(np.abs(steps - usual) > _UNEVEN * usual) < _SHARE:
        return None
    return float(np.std(time - counted(time), ddof=2))


def counted(time: Float[np.ndarray, " time"]) -> Float[np.ndarray, " time"]:
    """Rows at their mean rate, s, through the stamps; where steps are much longer, rows are missing."""
    steps = np.diff(time)
    usual = float(np.median(steps))
    near = steps[steps < _LOST * usual]
    mean = float(near.mean())
    rows = np.where(steps < _LOST * usual, 1.0, np.round(steps / mean))
    number = np.concatenate([[0.0], np.cumsum(rows)])
    slope, level = np.polyfit(number, time - time[0], 1)
    return time[0] + level + slope * number


def _rows_are_lost(time: Float[np.ndarray, " time"]) -> bool:
    """Whether single rows are missing, so that rows tell no time: a count of rows is then a scale factor of all gyros.

    A host's delays are about the same in every hundred rows. Behind a row that is missing all others are late: their
    mean wanders by as much as single stamps scatter.
    """
    late = time - counted(time)
    count = len(late) // _ROWS
    if count < _FEWEST:
        return False
    wanders = late[: count * _ROWS].reshape(count, _ROWS).mean(axis=1).std()
    return bool(wanders > _WANDERS * late.std())


def motion_clock(
    time: Float[np.ndarray, " time"], gyro: Float[np.ndarray, "time 3"], turns: list[Turn]
) -> MotionClock:
    """The clock that turns gravity as it was seen to turn; the stamps, where that is not certain.

    For each clock the misfits u₂ × U(ω) u₁ are fitted by small linear errors of the gyros first, so that an
    uncalibrated scale factor does not hide the difference.
    """
    jitter = uneven(time)
    if jitter is None or len(turns) < _FEWEST or _rows_are_lost(time):
        return MotionClock(time, None, "")
    even = counted(time)
    by_stamps, by_rows = (_misfit(clock, gyro, turns) for clock in (time, even))
    if by_rows > _BETTER * by_stamps:
        return MotionClock(time, None, "")
    rate = 1.0 / float(np.median(np.diff(even)))
    text = (
        f"rows are counted at {rate:.5g} Hz in them, because the stamps are uneven by {1e3 * jitter:.2g} ms and "
        f"gravity turns as the gyros say to {1e3 * by_rows:.2g} mrad so, against {1e3 * by_stamps:.2g} mrad by the "
        "stamps"
    )
    return MotionClock(even, rate, text)


def step_angles(
    clock: Float[np.ndarray, " time"], gyro: Float[np.ndarray, "time 3"], turns: list[Turn]
) -> Float[np.ndarray, "motion step 3"]:
    """φ = ω Δt of every step of the motions, rad; zero beyond a motion's end."""
    longest = max(t.last - t.first for t in turns)
    angle = np.zeros((len(turns), longest, 3))
    for k, t in enumerate(turns):
        rate = gyro[t.first : t.last + 1] - t.bias
        steps = np.diff(clock[t.first : t.last + 1])[:, None]
        angle[k, : t.last - t.first] = 0.5 * (rate[1:] + rate[:-1]) * steps
    return angle


def _misfit(
    clock: Float[np.ndarray, " time"], gyro: Float[np.ndarray, "time 3"], turns: list[Turn]
) -> float:
    """rms misfit of the motions after small linear errors are fitted, rad."""
    angle = step_angles(clock, gyro, turns)
    before, after = (np.stack([getattr(t, name) for t in turns]) for name in ("before", "after"))

    def misfit(error: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, " numbers"]:
        end = np.einsum("mij,mj->mi", turned(angle @ (np.eye(3) + error).T), before)
        return np.cross(after, end).ravel()

    start, small = misfit(np.zeros((3, 3))), 1e-4
    columns = []
    for unit in np.eye(9):
        columns.append((misfit(small * unit.reshape(3, 3)) - start) / small)
    design = np.stack(columns, axis=1) / _NOISE
    held = np.concatenate([design, np.eye(9) / _LINEAR])
    solution = np.linalg.lstsq(held, np.concatenate([-start / _NOISE, np.zeros(9)]), rcond=None)[0]
    left = start / _NOISE + design @ solution
    return _NOISE * float(np.sqrt(np.sum(left**2) / (2 * len(turns))))
