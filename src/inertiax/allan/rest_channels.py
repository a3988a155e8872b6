"""The longest rest of a log, channel by channel; also of a log in parts that stay on the disk."""

from collections.abc import Iterator, Sequence

import numpy as np

from .._records import field, Module
from ..data.recording import Recording
from ..data.stored_recording import StoredRecording
from ..reduction.host_stamps import remark
from ..reduction.rests import PAUSE, usual_step
from ..reduction.segments import segment
from .identify import FEWEST
from .stored_channel import BLOCK, Log, StoredChannel


_WINDOW = 1.0  # s, over which motion is judged
LONG = 2 * BLOCK  # samples of a rest from which on its channels stay on the disk
_LEAST_WINDOW = 16  # samples that tell a window's scatter to a fifth
_NEAR_END, _FEWEST_WINDOWS = 30, 5  # windows that tell what is usual near an end
_MOST_MOVED = 2  # windows at an end: a longer motion is told as one
# Of the usual scatter: three times is ten times its error at 16 samples, and few windows of a pure walk have it.
_MOVED = 3.0
_CUT = 2.5  # windows: what is cut off a rest's end at most, and a little


class RestChannels(Module):
    """Rows of one log: those `[start, stop)` of each of its parts, which follow one another."""

    parts: tuple[Recording, ...]
    ranges: tuple[tuple[int, int], ...] = field(static=True)

    @property
    def num_samples(self) -> int:
        """Number of rows."""
        return sum(b - a for a, b in self.ranges)

    @property
    def span(self) -> tuple[float, float]:
        """Stamps of the first and the last row, s."""
        first, last = self.ranges[0][0], self.ranges[-1][1] - 1
        return float(self.parts[0].time[first]), float(self.parts[-1].time[last])

    def pieces(self, column: str) -> Iterator[np.ndarray]:
        """A column's rows, part after part."""
        for part, (a, b) in zip(self.parts, self.ranges, strict=True):
            yield getattr(part, column)[a:b]

    def has(self, column: str) -> bool:
        """Whether it was recorded."""
        return getattr(self.parts[0], column) is not None

    def channel(self, column: str, axis: int) -> Log:
        """One axis of a column; of a long rest on the disk."""
        pieces = (piece[:, axis] for piece in self.pieces(column))
        if len(self.parts) > 1 and self.num_samples > LONG:
            return StoredChannel(pieces)
        return np.concatenate(list(pieces))


def logs_of(recordings: Sequence[Recording]) -> list[tuple[Recording, ...]]:
    """Recordings, those together that are parts of one log."""
    logs: list[tuple[Recording, ...]] = []
    whole = ""
    for recording in recordings:
        mine = recording.whole if isinstance(recording, StoredRecording) else ""
        if mine and mine == whole:
            logs[-1] = (*logs[-1], recording)
        else:
            logs.append((recording,))
        whole = mine
    return logs


def name_of(log: Sequence[Recording]) -> str:
    """The name of a log, which its parts share."""
    first = log[0]
    return first.whole if isinstance(first, StoredRecording) and first.whole else first.name


def longest_rest(
    log: Sequence[Recording], *, compensated: bool = False
) -> tuple[RestChannels, list[str]]:
    """The longest rest without a pause, and what a reader should know of it, also where it is `compensated`.

    Raises `ValueError` where it has fewer than 256 samples.
    """
    where = name_of(log) or "the recording"
    step = usual_step(log[0])
    rests: list[list[tuple[int, int, int]]] = []  # number of the part, and rows of it
    for number, part in enumerate(log):
        for a, b in _rests_of(part):
            if rests and _goes_on(log, rests[-1][-1], (number, a, b), step):
                last, begin, _ = rests[-1].pop()
                rests[-1] += [(last, begin, log[last].num_samples), (number, 0, b)]
            else:
                rests.append([(number, a, b)])
    longest = max(rests, key=lambda r: sum(b - a for _, a, b in r), default=[(0, 0, 0)])
    longest = _between_motions(log, longest, step)
    rest = RestChannels(tuple(log[k] for k, _, _ in longest), tuple((a, b) for _, a, b in longest))
    if rest.num_samples < FEWEST:
        raise ValueError(
            f"{where}: the longest rest has {rest.num_samples} samples; noise needs a log of {FEWEST} or "
            f"more at rest, and hours of it for bias instability and random walk.{remark(log[0])}"
        )
    return rest, _notes(log, rest, compensated=compensated)


def _rests_of(recording: Recording) -> list[tuple[int, int]]:
    """Rests of one recording, cut at pauses."""
    found = segment(recording, window=_WINDOW)
    return [
        piece
        for start, stop, rests in zip(found.start, found.stop, found.resting, strict=True)
        if rests
        for piece in _without_pauses(recording, int(start), int(stop))
    ]


def _between_motions(
    log: Sequence[Recording], rest: list[tuple[int, int, int]], step: float
) -> list[tuple[int, int, int]]:
    """A rest without the seconds at its ends in which a motion has begun, or has not ended."""
    width = max(round(_WINDOW / step), 1) if step > 0.0 else 0
    if width < _LEAST_WINDOW:
        return rest
    (first, a, b), (last, c, d) = rest[0], rest[-1]
    near = _NEAR_END * width
    before = _moved(log[first], slice(a, min(b, a + near)), width)
    after = _moved(log[last], slice(max(c, d - near), d), width, backwards=True)
    if sum(stop - start for _, start, stop in rest) - before - after < FEWEST:
        return rest
    rest = [(first, a + before, b), *rest[1:]]
    last, c, d = rest[-1]
    return [*rest[:-1], (last, c, d - after)]


def _moved(part: Recording, rows: slice, width: int, *, backwards: bool = False) -> int:
    """How many rows at a rest's end are in windows that scatter as no others near it do."""
    columns = [x for x in (part.accel, part.gyro) if x is not None]
    moved = 0
    for values in columns:
        near = np.asarray(values[rows])[:: -1 if backwards else 1]
        count = len(near) // width
        if count < _FEWEST_WINDOWS:
            return 0
        scatter = near[: count * width].reshape(count, width, 3).std(axis=1)
        away = (scatter > _MOVED * np.median(scatter, axis=0)).any(axis=1)
        moved = max(moved, *(k + 1 for k in range(_MOST_MOVED) if away[k]), 0)
    return moved * width


def _goes_on(
    log: Sequence[Recording], before: tuple[int, int, int], after: tuple[int, int, int], step: float
) -> bool:
    """Whether a rest that reaches a part's end is the one at the next part's beginning."""
    part, near = log[before[0]], _CUT * _WINDOW / step if step > 0.0 else 0.0
    if after[0] != before[0] + 1:
        return False
    reaches = part.num_samples - before[2] <= near and after[1] <= near
    return reaches and bool(log[after[0]].time[0] - part.time[-1] <= PAUSE * step)


def _notes(log: Sequence[Recording], rest: RestChannels, *, compensated: bool) -> list[str]:
    notes, (first, last) = [], rest.span
    if rest.num_samples < sum(part.num_samples for part in log):
        notes.append(
            f"only the longest rest is used: {last - first:.0f} s from {first:.0f} s on, of "
            f"{log[-1].time[-1] - log[0].time[0]:.0f} s"
        )
    count = rest.num_samples - len(rest.parts)
    mean = sum(float(t[-1] - t[0]) for t in rest.pieces("time")) / count
    squares = (float(np.square(np.diff(t) - mean).sum()) for t in rest.pieces("time"))
    if np.sqrt(sum(squares) / count) > 0.2 * mean:
        notes.append("the time stamps are uneven; equal steps were assumed")
    if rest.has("temperature"):
        ends = [(p[:, 0].min(), p[:, 0].max()) for p in rest.pieces("temperature")]
        moved = float(max(high for _, high in ends) - min(low for low, _ in ends))
        if moved > 2.0:
            left = (
                ": the columns are compensated, so that what B, K and R show of it is what the calibration left"
                if compensated
                else ", which looks like random walk or ramp; compensate the log first, and take what that wrote"
            )
            notes.append(f"the temperature moved by {moved:.1f} °C{left}")
    return notes


def _without_pauses(recording: Recording, start: int, stop: int) -> list[tuple[int, int]]:
    steps = np.diff(recording.time[start:stop])
    cuts = start + 1 + np.flatnonzero(steps > PAUSE * usual_step(recording))
    edges = [start, *cuts.tolist(), stop]
    return list(zip(edges[:-1], edges[1:], strict=True))
