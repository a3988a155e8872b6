"""A delay of the outputs against the reference, from the ramps between plateaus.

A delay shows while the input changes: $y(t) = u(t - d) \\approx u - d\\,\\dot u$. Rests and plateaus are what a
calibration is fitted on, so it is looked for in the rows that they leave out. Each ramp is seen together with as
much of its surroundings as it lasts, and keeps a constant of its own: then what changes the output at the plateaus
themselves, such as a nonlinearity, acts alike while the table speeds up and slows down, and a delay does not. How
far the ramps agree with each other tells how sure it is, whatever noise there is.

An accelerometer beside the axes feels $\\dot\\omega \\times R$ while the table speeds up, which moves in one sense do
not tell from a delay: what arms of any length explain is taken from both first.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.special
from jaxtyping import Float

from ..._jax import eqx
from ..._typing import AnyArray
from .blocks import Log
from .model_rows import CalibratedTriad
from .signals import at_temperature


SLOWEST = 0.05  # s; rows farther apart do not follow every ramp
# Rows of the usual ramp that follow it however far apart they are: the slope is wrong at its two ends, in a row each.
FOLLOWED = 10
LONGEST = 2.0  # s; a longer change is cut into pieces of that
FEWEST = 5.0  # ramps, counted by what each of them tells
CHANGING = 0.05  # part of the steepest slope from which the input changes
LEVEL = 1e-4  # family-wise false alarms of one triad
STEPS = 5  # of Gauss and Newton, where a delay is longer than a row; each squares what the one before left
MEASURED = 0.1  # of the output's change from row to row: a reference that scatters more is measured, with noise
SHARE = 0.5  # of what the ramps show beyond white noise: what a delay must explain to be called one


class Ramp(eqx.Module):
    """Rows `start` to `stop` of a log, a stretch of changing input with its surroundings."""

    start: int = eqx.field(static=True)
    stop: int = eqx.field(static=True)


class Delay(eqx.Module):
    """Delays of one triad's channels, s, and whether they are there."""

    triad: str = eqx.field(static=True)
    value: Float[AnyArray, "3"]
    std: Float[AnyArray, "3"]
    freedom: Float[AnyArray, "3"]  # degrees of freedom: ramps, less one
    p_value: Float[AnyArray, "3"]
    gain: Float[AnyArray, "3"]  # 1 - rms with it / rms without, on every other ramp
    size: Float[AnyArray, "3"]  # rms of what it explains, m/s² or rad/s
    ramps: tuple[Ramp, ...]
    found: tuple[int, ...] = eqx.field(static=True)  # channels that have one


@dataclass(frozen=True, eq=False)
class _Seen:
    """What each ramp shows: residuals and their change per second of delay, both without the ramp's mean."""

    left: list[np.ndarray]  # (row, 3), m/s² or rad/s
    change: list[np.ndarray]  # (row, 3), the same per second

    @property
    def freedom(self) -> int:
        """Rows, less a mean for each ramp."""
        return sum(len(r) - 1 for r in self.left)

    def square(self, value: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3"]:
        """Sum of squares that such delays leave."""
        return np.sum(
            [np.sum((r - value * s) ** 2, axis=0) for r, s in zip(self.left, self.change)], axis=0
        )


def find_delay(log: Log, base: CalibratedTriad) -> Delay | None:
    """The delay of a triad that has a reference; `None` where the log holds too few ramps or too coarse ones."""
    triad = base.form.triad
    given, output = getattr(log, f"reference_{triad}"), getattr(log, triad)
    if not base.form.by_reference or given is None:
        return None
    ramps = _ramps(log, given)
    if len(ramps) < FEWEST or not _followed(log, ramps):
        return None
    seen = _seen(log, base, ramps, np.zeros(3))
    value, std, number = _agreed(seen)
    if (
        np.abs(value).max() > log.step
    ):  # the slope at a row says little of what lies a row and more beside it
        for _ in range(STEPS):
            seen = _seen(log, base, ramps, value)
            value, std, number = _agreed(seen)
    freedom = np.maximum(number - 1.0, 1.0)
    p_value = np.minimum(6.0 * scipy.special.stdtr(freedom, -np.abs(value) / std), 1.0)
    before, after = seen.square(np.zeros(3)), seen.square(value)
    white = _white(log, output) * seen.freedom
    share = (before - after) / np.maximum(before - white, 1e-300)
    known = number >= FEWEST
    found = known & (p_value < LEVEL) & (share > SHARE)
    size = np.sqrt(np.maximum(before - after, 0.0) / max(seen.freedom, 1))
    channels = tuple(int(c) for c in np.flatnonzero(found))
    std = np.where(known, std, np.inf)
    return Delay(triad, value, std, freedom, p_value, _gain(seen), size, tuple(ramps), channels)


def _followed(log: Log, ramps: Sequence[Ramp]) -> bool:
    """Whether rows are near enough to each other for the ramps; a third of a `Ramp`'s rows is the ramp itself."""
    return (
        log.step <= SLOWEST or float(np.median([r.stop - r.start for r in ramps])) >= 3 * FOLLOWED
    )


def _seen(
    log: Log, base: CalibratedTriad, ramps: Sequence[Ramp], about: Float[np.ndarray, "3"]
) -> _Seen:
    """The ramps of a log under a fitted baseline, linear in the delays about some."""
    triad = base.form.triad
    expected = _later(log, _expected(log, base), about)
    change = -_slope(log, expected)
    left = getattr(log, triad) - expected + about * change
    pieces = [slice(ramp.start, ramp.stop) for ramp in ramps]
    centred = lambda x: [x[rows] - x[rows].mean(axis=0) for rows in pieces]
    if triad == "gyro" or log.reference_gyro is None:
        return _Seen(centred(left), centred(change))
    rate = _later(log, log.reference_gyro, np.full(3, about.mean()))
    faster = _slope(log, rate)
    arms = [_by_lever_arms(rate[rows], faster[rows]) for rows in pieces]
    arms = [a - a.mean(axis=0) for a in arms]
    return _Seen(_beside(arms, centred(left)), _beside(arms, centred(change)))


def _by_lever_arms(
    rate: Float[np.ndarray, "row 3"], acceleration: Float[np.ndarray, "row 3"]
) -> Float[np.ndarray, "row 3 3"]:
    """Derivative of each element's specific force by the components of its arm, for axes along the case's.

    $\\dot\\omega \\times R + \\omega \\times (\\omega \\times R)$, of rad/s and rad/s².
    """
    turn = np.cross(np.eye(3), acceleration[:, None])  # rows are e_j × ω̇, which is −ω̇ × e_j
    inward = rate[:, :, None] * rate[:, None] - np.square(rate).sum(axis=1)[:, None, None] * np.eye(
        3
    )
    return inward - turn.swapaxes(1, 2)


def _beside(arms: Sequence[np.ndarray], seen: Sequence[np.ndarray]) -> list[np.ndarray]:
    """What arms do not explain, channel by channel."""
    columns, values, stops = (
        np.concatenate(arms),
        np.concatenate(seen),
        np.cumsum([len(s) for s in seen]),
    )
    left = [v - c @ np.linalg.lstsq(c, v)[0] for c, v in zip(columns.swapaxes(0, 1), values.T)]
    return np.split(np.stack(left, axis=1), stops[:-1])


def _agreed(seen: _Seen) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Least-squares delay of all ramps, its standard deviation by their scatter, and how many ramps count."""
    weight = np.array([np.sum(s**2, axis=0) for s in seen.change])
    moment = np.array([np.sum(s * r, axis=0) for s, r in zip(seen.change, seen.left)])
    total = np.maximum(weight.sum(axis=0), 1e-300)
    number = total**2 / np.maximum((weight**2).sum(axis=0), 1e-300)
    value = moment.sum(axis=0) / total
    spread = np.sum((moment - value * weight) ** 2, axis=0) * len(weight) / (len(weight) - 1)
    return value, np.maximum(np.sqrt(spread) / total, 1e-300), number


def _expected(log: Log, base: CalibratedTriad) -> np.ndarray:
    """Outputs of the fitted baseline at the reference of every row."""
    temperature = np.zeros(len(log.time)) if log.temperature is None else log.temperature
    given = getattr(log, f"reference_{base.form.triad}")
    return np.asarray(at_temperature(base, given)(temperature))


def without_delay(log: Log, delay: Delay, base: CalibratedTriad) -> Log:
    """The log with the outputs that a triad without those delays would have given."""
    output, expected = getattr(log, delay.triad), _expected(log, base)
    value = np.where(np.isin(np.arange(3), delay.found), delay.value, 0.0)
    near = np.zeros(len(log.time), bool)
    for ramp in delay.ramps:
        beside = int(np.ceil(np.abs(value).max() / log.step))
        near[max(ramp.start - beside, 0) : ramp.stop + beside] = True
    # In a plateau the case turns under the Earth's rate, and gravity; there a measured reference would bring its noise.
    turning = (log.position < 0) & ~near
    scatter = lambda x: (
        np.median(np.abs(np.diff(x[turning], n=2, axis=0))) if turning.any() else 0.0
    )
    if scatter(expected) <= MEASURED * scatter(output):
        near |= turning
    moved = np.where(near[:, None], output + expected - _later(log, expected, value), output)
    return eqx.tree_at(lambda x: getattr(x, delay.triad), log, moved)


def _later(log: Log, values: np.ndarray, delay: Float[np.ndarray, "3"]) -> np.ndarray:
    """What three channels were by their delays (s) before each row, recording by recording."""
    made = values.copy()
    for number in np.unique(log.recording):
        rows = np.flatnonzero(log.recording == number)
        for c in np.flatnonzero(delay):
            moments = log.time[rows] - delay[c]
            made[rows, c] = np.interp(moments, log.time[rows], values[rows, c])
    return made


def _slope(log: Log, values: np.ndarray) -> np.ndarray:
    """Derivative by time, recording by recording."""
    made = np.zeros_like(values)
    for number in np.unique(log.recording):
        rows = np.flatnonzero(log.recording == number)
        if len(rows) > 2:
            made[rows] = np.gradient(values[rows], log.time[rows], axis=0)
    return made


def _ramps(log: Log, given: np.ndarray) -> list[Ramp]:
    """Stretches of changing input off the rests, each with its surroundings."""
    slope = np.linalg.norm(_slope(log, given), axis=1)
    steepest = np.quantile(slope, 0.995)
    changing = (log.position < 0) & (slope > max(CHANGING * steepest, 1e-12))
    most = max(int(LONGEST / log.step), 2)
    made: list[Ramp] = []
    for number in np.unique(log.recording):
        rows = np.flatnonzero(log.recording == number)
        first, last = int(rows[0]), int(rows[-1]) + 1
        edges = np.flatnonzero(np.diff(np.r_[0, changing[first:last].astype(int), 0])) + first
        runs = list(zip(edges[::2], edges[1::2]))
        for k, (a, b) in enumerate(runs):
            if b - a < 3:
                continue
            before = runs[k - 1][1] if k else first
            after = runs[k + 1][0] if k + 1 < len(runs) else last
            around = min(b - a, most)
            start = max(a - around, (a + before + 1) // 2)
            stop = min(b + around, (b + after) // 2)
            pieces = max(1, -(-(b - a) // most))
            cuts = np.linspace(start, stop, pieces + 1).round().astype(int)
            made += [Ramp(int(s), int(e)) for s, e in zip(cuts[:-1], cuts[1:]) if e - s > 5]
    return made


def _white(log: Log, output: np.ndarray) -> np.ndarray:
    """Variance of one sample's noise, from differences of neighbours at rest; zero where nothing rests."""
    rest = (log.position[1:] >= 0) & (log.position[1:] == log.position[:-1])
    steps = np.diff(output, axis=0)[rest & (np.diff(log.recording) == 0)]
    return 0.5 * np.mean(steps**2, axis=0) if len(steps) else np.zeros(3)


def _gain(seen: _Seen) -> np.ndarray:
    """What the delay of the even ramps takes from the rms of the odd ones, and the other way round."""
    before, after = np.zeros(3), np.zeros(3)
    for first in (0, 1):
        fitted = _Seen(seen.left[first::2], seen.change[first::2])
        kept = _Seen(seen.left[1 - first :: 2], seen.change[1 - first :: 2])
        before += kept.square(np.zeros(3))
        after += kept.square(_agreed(fitted)[0])
    return 1.0 - np.sqrt(after / np.maximum(before, 1e-300))
