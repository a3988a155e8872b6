"""The samples of all rests as one series with gaps, and its spectrum.

Each rest is seen less its own mean, which the calibration takes, and weighted by what it scatters.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from ...effects.interference import highest_of_blocks
from .blocks import FEWEST_SAMPLES, Log, MOST_BLOCKS


PADDING = (
    2  # points of the spectrum to an independent frequency, so that none falls between two of them
)
BESIDE = 32  # independent frequencies on each side, which tell the noise at a line to a sixth
GAP = (
    1.5  # independent frequencies between a line and those: what was taken away leaves a hole there
)
MOST_CELLS = (
    1 << 22
)  # in time, whose spectrum takes a second: twelve hours at 100 Hz; longer logs in sums of rows
LONGEST_BLOCK = 4  # times the shortest: `blocks.cut`
FEWEST_ROWS = 8  # of a rest that tells a line beside its mean


@dataclass(frozen=True, eq=False)
class RestRows:
    """Rows of rests, one rest after another."""

    rows: Int[np.ndarray, " row"]  # of the log
    time: Float[np.ndarray, " row"]  # s, of the log
    starts: Int[np.ndarray, " rest"]  # where each rest begins among them
    count: Int[np.ndarray, " rest"]

    @property
    def rest(self) -> Int[np.ndarray, " row"]:
        """The number of each row's rest."""
        return np.repeat(np.arange(len(self.count)), self.count)

    def mean(self, values: Float[np.ndarray, "row ..."]) -> Float[np.ndarray, "rest ..."]:
        """Of each rest."""
        count = self.count.reshape(-1, *[1] * (values.ndim - 1))
        return np.add.reduceat(values, self.starts) / count

    def centred(self, values: Float[np.ndarray, "row ..."]) -> Float[np.ndarray, "row ..."]:
        """Less each rest's mean."""
        return values - np.repeat(self.mean(values), self.count, axis=0)


def rows_of_rests(log: Log) -> RestRows | None:
    """The undisturbed runs of rows at rest that no hand holds; `None` where there is none."""
    first, last, owner = log.segments.runs()
    still = (log.segments.position[owner] >= 0) & ~log.segments.held_by_hand[owner]
    still &= last - first >= FEWEST_ROWS
    first, last = first[still], last[still]
    if not len(first):
        return None
    rows = np.concatenate([np.arange(a, b) for a, b in zip(first, last, strict=True)])
    count = last - first
    return RestRows(rows, log.time[rows], np.append(0, np.cumsum(count)[:-1]), count)


@dataclass(frozen=True, eq=False)
class Spectrum:
    """An even grid in time, on which the spectrum of all rests together is one FFT."""

    place: Int[np.ndarray, " row"]  # cell of each row
    number: int  # of cells with their padding
    step: float  # s
    first: int  # point from which on lines are looked for: what is slower, means of blocks show
    last: int

    @classmethod
    def of(cls, log: Log, rests: RestRows) -> "Spectrum | None":
        """The grid of a log's rests; `None` where it has too few frequencies to tell noise from a line."""
        span = float(rests.time[-1] - rests.time[0])
        step = max(log.step, span / MOST_CELLS)
        place = np.round((rests.time - rests.time[0]) / step).astype(int)
        number = 1 << int(np.ceil(np.log2(PADDING * (int(place[-1]) + 1))))
        shortest = max(FEWEST_SAMPLES, -(-len(rests.rows) // MOST_BLOCKS))
        lowest = highest_of_blocks(LONGEST_BLOCK * shortest * log.step)
        made = cls(place, number, step, int(np.ceil(lowest * number * step)), number // 2)
        return made if made.last - made.first >= 2 * BESIDE * made.apart else None

    @property
    def apart(self) -> float:
        """Points from one independent frequency to the next."""
        return self.number / (self.place[-1] + 1.0)

    @property
    def trials(self) -> float:
        """Independent frequencies that are looked at."""
        return (self.last - self.first) / self.apart

    @property
    def lowest(self) -> float:
        """Hz."""
        return self.frequency(self.first)

    def frequency(self, point: int) -> float:
        """Hz."""
        return float(point / (self.number * self.step))

    def power(self, values: Float[np.ndarray, " row"]) -> Float[np.ndarray, " point"]:
        """|Σ values exp(−2πi f t)|² at every point."""
        made = np.fft.rfft(np.bincount(self.place, values, minlength=self.number))
        return np.square(made.real) + np.square(made.imag)

    def slow(
        self, power: Float[np.ndarray, " point"], rests: RestRows, weight: Float[np.ndarray, " row"]
    ) -> float:
        """The frequency below the band whose line would explain most, Hz: of a slow one each rest's mean takes part."""
        frequency = np.arange(int(np.ceil(self.apart)), self.first + 1) / (self.number * self.step)
        length = rests.count * self.step
        seen = np.add.reduceat(weight, rests.starts) @ (
            1.0 - np.square(np.sinc(frequency * length[:, None]))
        )
        part = power[int(np.ceil(self.apart)) : self.first + 1]
        return float(frequency[int(np.argmax(part / np.maximum(seen, 1e-300)))])

    def usual(self, power: Float[np.ndarray, " point"]) -> Float[np.ndarray, " piece"]:
        """Mean power of noise in pieces of the band, by their medians."""
        pieces = np.array_split(power[self.first : self.last], self._pieces)
        return np.array([np.median(p) for p in pieces]) / np.log(2.0)

    @property
    def _pieces(self) -> int:
        return max(int((self.last - self.first) / (BESIDE * self.apart)), 1)

    def stands_out(self, power: Float[np.ndarray, " point"]) -> int:
        """The point that stands highest above the median of those about it."""
        part = power[self.first : self.last]
        usual = self.usual(power)
        beside = np.pad(usual, 1, mode="edge")
        level = np.maximum(np.maximum(beside[:-2], beside[2:]), usual)
        level = np.repeat(level, [len(p) for p in np.array_split(part, self._pieces)])
        return self.first + int(np.argmax(part / (level + 1e-300)))

    def level(self, power: Float[np.ndarray, " point"], frequency: float) -> float:
        """Mean power beside a frequency, of the side that has more: a spectrum that rises towards low ones is no
        line. A side that the spectrum's end cuts to less than a quarter does not count."""
        point = frequency * self.number * self.step
        gap, width = GAP * self.apart, BESIDE * self.apart
        low, high = max(point - gap - width, self.apart), min(point + gap + width, self.last)
        left = power[int(low) : max(int(point - gap), 0) + 1]
        right = power[int(np.ceil(point + gap)) : int(high)]
        return max(float(np.mean(s)) for s in (left, right) if len(s) >= 0.25 * width)
