"""Periodic interference that is faster than blocks: lines in the spectrum of the samples of rests.

Blocks are means over seconds, in which what is faster has no signature; yet it moves the means of rests by a part of
its amplitude. The samples within rests tell it: with each rest's mean taken away, and rests weighted by what they
scatter, the drop of the sum of squares by

    a sin(2π f t) + b cos(2π f t)

with one phase for the whole log, at every f from where the blocks end to half the sampling rate. A hand's tremor, a
ringing and a drift have no such phase. A line stands out of what is left at the frequencies beside it once it is taken
away, it is the same in both halves of the rests, and it is not what every rest does after the move before it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.special
from jaxtyping import Float

from ..._jax import eqx
from .blocks import Log
from .rest_spectrum import BESIDE, RestRows, rows_of_rests, Spectrum


LEVEL = 1e-4  # family-wise false alarms of one triad, as of a delay: what is taken from every sample must be certain
MOST_LINES = 6  # of one channel: a waveform has harmonics
FEWEST_RESTS = 4  # from which on halves of them, and what they have in common, are told
HALF = 0.5  # part of what its own line explains in one half that the other half's line must explain there
LOCKED = 0.5  # part of a line's gain from which what rests have in common explains it as well
COURSE = 24  # steps of that in a rest of usual length
QUIETEST = 0.25  # of the usual variance of rests: one in which the converter stands still is not certain beyond measure
POWER = 0.9  # chance with which a line of the stated least size is found
TURNS = 4  # of the fit of a frequency, which begins within a quarter of a period of the whole log


@dataclass(frozen=True, eq=False)
class Line:
    """A sinusoid on one channel, by the log's time: value[0] sin(2π f t) + value[1] cos(2π f t)."""

    triad: str
    channel: int
    frequency: float  # Hz
    frequency_std: float  # Hz
    value: Float[np.ndarray, "2"]  # m/s² or rad/s
    covariance: Float[np.ndarray, "2 2"]  # of it, the frequency's included
    p_value: float  # of all frequencies and channels
    ratio: float  # drop of the sum of squares in units of the noise's variance
    rows: int  # of rests that tell it
    gain: float  # 1 − rms with it / rms without, of each half of the rests by the line of the other one

    @property
    def amplitude(self) -> float:
        """m/s² or rad/s."""
        return float(np.hypot(*self.value))

    @property
    def amplitude_std(self) -> float:
        """m/s² or rad/s."""
        along = self.value / self.amplitude
        return float(np.sqrt(along @ self.covariance @ along))

    @property
    def name(self) -> str:
        """Such as accel_x."""
        return f"{self.triad}_{'xyz'[self.channel]}"

    def at(self, time: Float[np.ndarray, " time"]) -> Float[np.ndarray, " time"]:
        """What it adds to the channel's outputs."""
        return _sinusoids(self.frequency, time) @ self.value


@dataclass(frozen=True, eq=False)
class Sought:
    """The lines of one triad, and where they were looked for."""

    triad: str
    lines: tuple[Line, ...]
    band: tuple[float, float]  # Hz
    # Of each channel the amplitude of a line that is found wherever it is in the band, m/s² or rad/s.
    sizes: tuple[float, ...]


def find_lines(log: Log, triad: str) -> Sought | None:
    """The lines of a triad's channels that are no chance; `None` where the rests' samples tell none."""
    rests, outputs = rows_of_rests(log), getattr(log, triad)
    grid = None if rests is None else Spectrum.of(log, rests)
    if rests is None or grid is None:
        return None
    channels = [
        _of_channel(rests, grid, outputs[rests.rows, channel], triad, channel)
        for channel in range(3)
    ]
    found = tuple(line for lines, _ in channels for line in lines)
    band = grid.lowest, grid.frequency(grid.last)
    return Sought(triad, found, band, tuple(size for _, size in channels))


def without_lines(log: Log, lines: Sequence[Line]) -> Log:
    """The log with the outputs that it would have without them."""
    for line in lines:
        output = getattr(log, line.triad).copy()
        output[:, line.channel] -= line.at(log.time)
        log = eqx.tree_at(lambda x, t=line.triad: getattr(x, t), log, output)
    return log


def _sinusoids(frequency: float, time: Float[np.ndarray, " time"]) -> Float[np.ndarray, "time 2"]:
    phase = 2.0 * np.pi * frequency * time
    return np.stack([np.sin(phase), np.cos(phase)], axis=1)


def _of_channel(
    rests: RestRows, grid: Spectrum, values: Float[np.ndarray, " row"], triad: str, channel: int
) -> tuple[list[Line], float]:
    """The lines of one channel, each looked for in what the ones before leave, and the least that would be one."""
    mean, left = rests.mean(values), rests.centred(values)
    square = np.add.reduceat(np.square(left), rests.starts) / (rests.count - 1)
    usual = float(np.median(square))
    lines: list[Line] = []
    if not usual > 0.0:
        return lines, np.inf
    weight = np.repeat(1.0 / np.maximum(square, QUIETEST * usual), rests.count)
    power = grid.power(weight * left)
    slower = 0
    while len(lines) < MOST_LINES:
        start = grid.frequency(grid.stands_out(power))
        found = _fitted(rests, left, weight, start)
        if not grid.lowest <= found.frequency <= grid.frequency(grid.last):
            break
        after = grid.power(weight * (left - found.course))
        # Of white noise with the rests' own variances the power is the columns' square, and this is one.
        noise = grid.level(after, found.frequency) / found.seen
        ratio = found.drop / noise if noise > 0.0 else 0.0
        p_value = float(min(3.0 * grid.trials * _chance(ratio, rests, grid), 1.0))
        halves = _gain_of_halves(rests, left, weight, found.columns)
        if p_value > LEVEL or halves is None or _in_common(rests, left, weight, mean, found.drop):
            break
        if slower < MOST_LINES:
            slow = _fitted(rests, left, weight, grid.slow(power, rests, weight))
            if (
                slow.drop > found.drop
            ):  # seen in rests alone, it has images wherever these follow each other
                left, slower = left - slow.course, slower + 1
                power = grid.power(weight * left)
                continue
        covariance = noise * np.linalg.pinv(found.curvature)
        lines.append(
            Line(
                triad, channel, found.frequency, float(np.sqrt(covariance[2, 2])), found.value,
                covariance[:2, :2], p_value, ratio, len(left), halves,
            )
        )  # fmt: skip
        left, power = left - found.course, after
    return lines, _least(rests, grid, left, weight)


def _least(
    rests: RestRows,
    grid: Spectrum,
    left: Float[np.ndarray, " row"],
    weight: Float[np.ndarray, " row"],
) -> float:
    """The amplitude that is found with a chance of 0.9 where the noise is least favourable: its drop of the sum of
    squares exceeds what `LEVEL` asks for."""
    usual = grid.usual(grid.power(weight * left))
    seen = np.full(len(usual), float(weight.sum()))
    slowest = rests.centred(_sinusoids(grid.lowest, rests.time))
    seen[0] = float(weight @ np.square(slowest).sum(axis=1))  # of a slow line its means take a part
    known = _known(rests, grid)
    asked = 2.0 * known * np.expm1(np.log(3.0 * grid.trials / LEVEL) / known)
    deviations = np.sqrt(asked) + scipy.special.ndtri(POWER)
    # The drop is half the amplitude's square times what is seen, in units of the noise, the usual power over that.
    return float(deviations * np.sqrt(np.max(2.0 * usual / np.square(seen))))


@dataclass(frozen=True, eq=False)
class _Fit:
    """A line fitted to what rests show."""

    frequency: float  # Hz
    value: Float[np.ndarray, "2"]
    curvature: Float[np.ndarray, "3 3"]  # by value and frequency
    columns: Float[np.ndarray, "row 2"]  # less their means in each rest
    seen: float  # their weighted sum of squares
    drop: float  # of the weighted sum of squares of what rests show

    @property
    def course(self) -> Float[np.ndarray, " row"]:
        """What it adds, less its mean in each rest."""
        return self.columns @ self.value


def _fitted(
    rests: RestRows,
    left: Float[np.ndarray, " row"],
    weight: Float[np.ndarray, " row"],
    frequency: float,
) -> _Fit:
    """The line of most drop near a frequency (Gauss-Newton)."""
    most = 0.5 / float(np.ptp(rests.time))
    fit, step = _at(rests, left, weight, frequency)
    for _ in range(TURNS):
        fit, step = _at(rests, left, weight, fit.frequency + float(np.clip(step, -most, most)))
    return fit


def _at(
    rests: RestRows,
    left: Float[np.ndarray, " row"],
    weight: Float[np.ndarray, " row"],
    frequency: float,
) -> tuple[_Fit, float]:
    """The line at a frequency, and the step from there to a better one."""
    both = _sinusoids(frequency, rests.time)
    columns = rests.centred(both)
    normal = (columns * weight[:, None]).T @ columns
    # At half the sampling rate one of the two is zero.
    value = np.linalg.lstsq(normal, (columns * weight[:, None]).T @ left)[0]
    remains = left - columns @ value
    slope = 2.0 * np.pi * rests.time * (both[:, 1] * value[0] - both[:, 0] * value[1])
    full = np.column_stack([columns, rests.centred(slope)])
    curvature = (full * weight[:, None]).T @ full
    step = np.linalg.lstsq(curvature, (full * weight[:, None]).T @ remains)[0][2]
    drop = float(weight @ (np.square(left) - np.square(remains)))
    seen = float(np.trace(normal))
    return _Fit(float(frequency), value, curvature, columns, seen, drop), float(step)


def _chance(ratio: float, rests: RestRows, grid: Spectrum) -> float:
    """Of a drop over two degrees of freedom, with the noise known from the frequencies beside: F's tail.

    Noise that each rest has at the same frequency with a phase of its own tells no more than rests do.
    """
    known = _known(rests, grid)
    return float(np.exp(-known * np.log1p(0.5 * ratio / known)))


def _known(rests: RestRows, grid: Spectrum) -> float:
    """How many independent numbers tell the noise at a line, sine and cosine as one."""
    known = BESIDE * len(rests.rows) / (grid.place[-1] + 1.0)
    return min(known, len(rests.count) - 1.0) if len(rests.count) >= FEWEST_RESTS else known


def _gain_of_halves(
    rests: RestRows,
    left: Float[np.ndarray, " row"],
    weight: Float[np.ndarray, " row"],
    columns: Float[np.ndarray, "row 2"],
) -> float | None:
    """1 − rms with / rms without of every other rest by the line of the others; `None` where it is not the same.

    Of fewer than `FEWEST_RESTS` rests each is cut into halves.
    """
    if len(rests.count) >= FEWEST_RESTS:
        odd = rests.rest % 2 == 1
    else:
        odd = np.arange(len(left)) - rests.starts[rests.rest] >= 0.5 * rests.count[rests.rest]
    before = after = 0.0
    values = []
    for half in (~odd, odd):
        x, w = columns[half], weight[half]
        values.append(np.linalg.lstsq(x * np.sqrt(w)[:, None], left[half] * np.sqrt(w))[0])
    for half, own, other in zip((~odd, odd), values, values[::-1]):
        y, x, w = left[half], columns[half], weight[half]
        none, best, crossed = (float(w @ np.square(y - x @ v)) for v in (0.0 * own, own, other))
        if none - crossed < HALF * (none - best):
            return None
        before, after = before + none, after + crossed
    return 1.0 - float(np.sqrt(after / before))


def _in_common(
    rests: RestRows,
    left: Float[np.ndarray, " row"],
    weight: Float[np.ndarray, " row"],
    mean: Float[np.ndarray, " rest"],
    drop: float,
) -> bool:
    """Whether a course that all rests have after their moves explains what a line does: what settles, where rests
    follow each other in even steps, has lines at multiples of their rate.

    The course is the same in every rest, or goes with the change of the channel's mean by the move.
    """
    if len(rests.count) < FEWEST_RESTS:
        return False
    place = np.arange(len(left)) - rests.starts[rests.rest]
    step = max(int(np.median(rests.count)) // COURSE, 1)
    place = place // step
    for size in (np.ones(len(mean)), np.diff(mean, prepend=mean[0])):
        each = size[rests.rest]
        product = np.bincount(place, weight * each * left)
        square = np.bincount(place, weight * each * each)
        known = square > 0.0
        explained = float(np.sum(np.square(product[known]) / square[known])) - float(known.sum())
        if explained >= LOCKED * drop:
            return True
    return False
