"""One recording's samples as sums over its dwells: all that means and their covariances take.

Sums of recordings are put side by side, so that no more than the samples of one recording are in memory.
"""

from collections.abc import Sequence
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float, Int

from .._records import Module
from ..data.recording import Recording
from .chord import shortening
from .dwells import is_told
from .mean_covariance import Scatter
from .mean_noise import converter_steps
from .swinging_force import Swing, swing, swung_by


_SAMPLES_FOR_SLOPE = 8
_COLUMNS = ("time", "accel", "gyro", "temperature", "reference_accel", "reference_gyro")
_TRIADS = ("accel", "gyro", "mag")


class Line(Module):
    """What a triad (less its reference, where there is one) should read in each dwell: a straight line in time.

    A steady drift through a dwell, such as temperature brings, belongs to the dwell's mean time and temperature and is
    no error of the mean; left in, it would look like noise of infinite memory. Where samples are few, the mean.
    What goes with a force that swings (`swinging_force`) is none, either.
    """

    mean: Float[np.ndarray, "dwell 3"]
    time: Float[np.ndarray, " dwell"]  # s, mean
    slope: Float[np.ndarray, "dwell 3"]  # a second; 0 where samples are few
    products: Float[np.ndarray, "dwell 3 3"]  # sums of products of deviations from the line
    step: Float[np.ndarray, "3"]  # LSB of the converter
    swing: Swing | None = None


class Reduced(Module):
    """The sums of one recording, and where its samples are."""

    recording: Recording
    start: Int[np.ndarray, " dwell"]
    stop: Int[np.ndarray, " dwell"]
    used: Bool[np.ndarray, " time"]  # rows that count
    counts: Int[np.ndarray, " dwell"]  # of them in each dwell
    means: dict[str, np.ndarray]  # of each column, a row a dwell
    accel: Line | None
    gyro: Line | None
    mag: Line | None
    spread: Float[np.ndarray, " dwell"] | None  # mean square of rates about their mean, (rad/s)²
    # Part by which the mean force is shorter than the force, where no reference tells it (`chord.shortening`).
    shorter: Float[np.ndarray, " dwell"] | None = None

    @property
    def rows(self) -> Int[np.ndarray, " row"]:
        """Rows that count, dwell after dwell."""
        lengths = self.stop - self.start
        first = np.repeat(self.start - (np.cumsum(lengths) - lengths), lengths)
        inside = np.arange(lengths.sum()) + first
        return inside[self.used[inside]]

    def first(
        self,
        triad: Literal["accel", "gyro", "mag"],
        dwells: Int[np.ndarray, " chosen"],
        kept: Int[np.ndarray, " chosen"],
    ) -> Float[np.ndarray, "row 3"]:
        """Deviations of the first `kept` samples of some dwells."""
        # Dwell by dwell: `rows` would count through all of a long log.
        of_one = lambda k, n: (
            self.start[k] + np.flatnonzero(self.used[self.start[k] : self.stop[k]])[:n]
        )
        rows = np.concatenate([of_one(k, n) for k, n in zip(dwells, kept, strict=True)])
        line = getattr(self, triad)
        return _deviations(self.recording, triad, rows, np.repeat(dwells, kept), line)


def reduced(
    recording: Recording,
    start: Int[np.ndarray, " dwell"],
    stop: Int[np.ndarray, " dwell"],
    used: Bool[np.ndarray, " time"],
    columns: Sequence[str] = _COLUMNS,
) -> Reduced:
    """The sums over the rows `[start, stop)` of each dwell, of which those count that are `used`.

    Of a column with gaps, such as the magnetometers', the rows without a number must not be among them.
    """
    total = np.append(0, np.cumsum(used))
    counts = total[stop] - total[start]
    made = Reduced(recording, start, stop, used, counts, {}, None, None, None, None)
    rows, starts = made.rows, np.cumsum(counts) - counts

    def mean(x: np.ndarray) -> np.ndarray:
        return np.add.reduceat(x, starts, axis=0) / counts.reshape(-1, *[1] * (x.ndim - 1))

    given = [c for c in columns if getattr(recording, c) is not None]
    means = {c: mean(getattr(recording, c)[rows]) for c in given}
    stated = recording.reference_accel
    if (
        stated is not None and "reference_accel" in given
    ):  # what a part of a dwell lacks, its mean does not tell
        lacking = mean(np.asarray(~is_told(stated[rows]), float)) > 0.0
        means["reference_accel"][lacking] = 0.0
    lines = {t: _line(made, t, rows, starts) if t in given else None for t in _TRIADS}
    spread = None
    if recording.gyro is not None and {"gyro", "reference_gyro"} <= set(given):
        about = recording.gyro[rows] - np.repeat(means["gyro"], counts, axis=0)
        spread = mean(np.sum(np.square(about), axis=1))
    shorter = None
    if recording.accel is not None and "accel" in given and stated is None:
        shorter = shortening(recording.accel[rows], starts)
    return Reduced(
        recording,
        start,
        stop,
        used,
        counts,
        means,
        lines["accel"],
        lines["gyro"],
        lines["mag"],
        spread,
        shorter,
    )


def joined_means(found: Sequence[Reduced], column: str) -> np.ndarray | None:
    """A column's means over the dwells of all recordings, `None` where it was not recorded."""
    if column not in found[0].means:
        return None
    return np.concatenate([f.means[column] for f in found])


def scatter_of(found: Sequence[Reduced], triad: Literal["accel", "gyro", "mag"]) -> Scatter | None:
    """A triad's scatter within the dwells of all recordings, `None` where it was not recorded."""
    lines = [line for f in found if (line := getattr(f, triad)) is not None]
    if not lines:
        return None
    counts = np.concatenate([f.counts for f in found])
    ends = np.cumsum([len(f.counts) for f in found])

    def first(dwells: np.ndarray, kept: np.ndarray) -> np.ndarray:
        edges = np.searchsorted(dwells, [0, *ends])
        parts = [
            f.first(triad, dwells[a:b] - end + len(f.counts), kept[a:b])
            for f, end, a, b in zip(found, ends, edges[:-1], edges[1:], strict=True)
            if a < b
        ]
        return np.concatenate(parts)

    steps = [np.broadcast_to(line.step, (len(line.time), 3)) for line in lines]
    return Scatter(
        counts,
        np.concatenate([line.products for line in lines]),
        counts >= _SAMPLES_FOR_SLOPE,
        np.concatenate(steps),
        np.arange(len(counts)),
        first,
    )


def _line(
    part: Reduced, triad: str, rows: Int[np.ndarray, " row"], starts: Int[np.ndarray, " dwell"]
) -> Line:
    recording, counts = part.recording, part.counts
    x = outputs_of(recording, triad, rows)
    over = lambda v: np.add.reduceat(v, starts, axis=0)
    mean = over(x) / counts[:, None]
    deviations = x - np.repeat(mean, counts, axis=0)
    time = recording.time[rows]
    middle = over(time) / counts
    t = (time - np.repeat(middle, counts))[:, None]
    square = over(t**2)
    slope = over(t * deviations) / np.where(square > 0, square, 1.0)
    slope = slope * (counts >= _SAMPLES_FOR_SLOPE)[:, None]
    deviations = deviations - t * np.repeat(slope, counts, axis=0)
    force, found = swung_by(recording, triad, rows), None
    if force is not None:
        found = swing(force, starts, t[:, 0], deviations)
    if force is not None and found is not None:
        dwell = np.repeat(np.arange(len(counts)), counts)
        deviations = deviations - found.part(force, t[:, 0], dwell)
    products = np.empty((len(counts), 3, 3))
    for i in range(3):
        for j in range(i + 1):
            products[:, i, j] = products[:, j, i] = over(deviations[:, i] * deviations[:, j])
    return Line(mean, middle, slope, products, converter_steps(getattr(recording, triad)), found)


def outputs_of(recording: Recording, triad: str, rows: Int[np.ndarray, " row"]) -> np.ndarray:
    """A triad's outputs, less the reference where there is one."""
    x, ideal = getattr(recording, triad)[rows], getattr(recording, f"reference_{triad}", None)
    return x if ideal is None else x - ideal[rows]


def _deviations(
    recording: Recording,
    triad: str,
    rows: Int[np.ndarray, " row"],
    dwell: Int[np.ndarray, " row"],
    line: Line,
) -> Float[np.ndarray, "row 3"]:
    deviations = outputs_of(recording, triad, rows) - line.mean[dwell]
    time = recording.time[rows] - line.time[dwell]
    deviations = deviations - time[:, None] * line.slope[dwell]
    force = None if line.swing is None else swung_by(recording, triad, rows)
    if line.swing is None or force is None:
        return deviations
    return deviations - line.swing.part(force, time, dwell)
