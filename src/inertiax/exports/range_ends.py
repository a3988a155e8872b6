"""Samples at the end of a channel's range, which compensated outputs do not show any more, counted piece by piece.

Where an output is clipped all samples read one value, by which calibrations and diagnoses leave such motions out.
Compensated, each channel holds parts of the others and that value is gone.
"""

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..data.frames import TRIADS
from ..data.recording import Recording
from ..reduction.clipping import beyond_habit


_UNITS = {"accel": (1.0, "m/s²"), "gyro": (180.0 / math.pi, "°/s")}


class _End(NamedTuple):
    """Of one end of a channel: what it reads, in how many rows, at most in a row, and neighbours that touch it."""

    value: float
    rows: int
    longest: int
    pairs: int
    repeats: int

    @classmethod
    def of(cls, x: Float[np.ndarray, " time"], value: float) -> "_End":
        there = x == value
        edges = np.flatnonzero(np.diff(np.concatenate([[False], there, [False]]).astype(np.int8)))
        touching = there[1:] | there[:-1]
        repeats = int(np.sum(there[1:] & there[:-1]))
        longest = int((edges[1::2] - edges[::2]).max())
        return cls(value, int(there.sum()), longest, int(touching.sum()), repeats)

    def beside(self, other: "_End", sign: float) -> "_End":
        """Of both pieces together: the farther one, or the sums of the two."""
        if self.value != other.value:
            return self if sign * self.value > sign * other.value else other
        longest = max(self.longest, other.longest)
        sums = (a + b for a, b in zip(self[3:], other[3:], strict=True))
        return _End(self.value, self.rows + other.rows, longest, *sums)


class RangeEnds:
    """Ends of the ranges of a log's accelerometers and gyros, filled piece by piece."""

    def __init__(self) -> None:
        """Without a row."""
        self._ends: dict[tuple[str, int, float], _End] = {}
        self._sums: dict[tuple[str, int], np.ndarray] = {}  # rows, pairs, repeats

    def add(self, recording: Recording) -> None:
        """Count a piece as it was recorded."""
        for triad in TRIADS:
            values = getattr(recording, triad)
            if triad not in _UNITS or values is None or not len(values):
                continue
            for axis, x in enumerate(np.asarray(values, float).T):
                counts = np.array([len(x), len(x) - 1, np.sum(x[1:] == x[:-1])])
                self._sums[triad, axis] = self._sums.get((triad, axis), 0) + counts
                for sign, value in ((-1.0, float(x.min())), (1.0, float(x.max()))):
                    key, found = (triad, axis, sign), _End.of(x, value)
                    before = self._ends.get(key)
                    self._ends[key] = found if before is None else before.beside(found, sign)

    def notes(self, name: str) -> tuple[str, ...]:
        """A line for each channel that stays at an end of its range."""
        said = []
        for (triad, axis, _), end in self._ends.items():
            if self._stays(triad, axis, end):
                factor, unit = _UNITS[triad]
                reads = f"reads no further than {factor * end.value:.4g} {unit}, in {end.rows} rows"
                said.append(
                    f"{name}: {triad} {'xyz'[axis]} {reads}: what was beyond is lost, and compensated outputs do not "
                    "show which rows these are; find them in the recorded column"
                )
        return tuple(said)

    def _stays(self, triad: str, axis: int, end: _End) -> bool:
        rows, pairs, repeats = (int(v) for v in self._sums[triad, axis])
        # What a channel reads most of the time, as gyros do in rests without noise, is no end of its range.
        if end.rows > rows // 2:
            return False
        return beyond_habit(end.longest, rows, repeats - end.repeats, pairs - end.pairs)
