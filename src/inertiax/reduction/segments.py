"""Where a recording rests or turns at a constant rate, as ranges of rows.

What the recording says decides first: `position` (rests, and with `reference_gyro` the plateaus among the
rows of position −1), then `reference_gyro` alone; a recording with neither is searched for rests.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Int

from .._records import field, Module
from ..data.recording import Recording
from ..data.stored_recording import StoredRecording
from ..numerics.side_by_side import side_by_side
from ..physics.directions import FEWEST_DIRECTIONS, num_directions
from ..physics.vectors import angle_between
from ..physics.wgs84 import EARTH_RATE
from .handling import Disturbance, undisturbed, with_force_kept
from .held_rests import kept_for_magnitude
from .plateaus import (
    and_beside,
    plateaus,
    SHORTEST,
    STANDS,
    steady_steps,
    TURNING,
    turning_rows,
    without_ramps,
    without_unsaid_ramps,
)
from .rests import find_rests, PAUSE, Rests, usual_step
from .slow_turn import slow_turn


# From a rest's first half to its second; a hand that holds still creeps by 1°.
_LYING = np.radians(3.0)
_MORE = 1.25  # times as many rests, from which brief ones count (convention)
_SEVERAL = 4.0  # times as many brief rests as of long ones in too few directions (convention)
_CLEAR = 10.0  # thresholds, highest to lowest, that find the same rests held by hand (convention)


class Segments(Module):
    """Ranges `[start, stop)` of rows, in order, at rest or at a constant rate, and which of the rows count."""

    start: Int[np.ndarray, " segment"]
    stop: Int[np.ndarray, " segment"]
    position: Int[np.ndarray, " segment"]  # -1 at constant rate
    used: Bool[np.ndarray, " time"]  # rows of a segment that nothing disturbs
    disturbances: tuple[Disturbance, ...] = ()  # what was left out, and why
    threshold: float | None = field(static=True, default=None)  # times the quietest level
    statement: str = field(static=True, default="")  # how they were found, for a report
    # m/s², 1 sigma of each mean: the device turned slowly all along, and stretches of that stand for rests.
    turning: float | None = field(static=True, default=None)
    # By hand: good for the magnitude of the force alone.
    held: Bool[np.ndarray, " segment"] | None = None
    # s, of plateaus at whose ends the gyros still changed; left out. See `plateaus.without_unsaid_ramps`.
    ramps: float = field(static=True, default=0.0)
    # From rest to rest, at rates that change and are known all along. See `known_moves`.
    moves: Bool[np.ndarray, " segment"] | None = None

    @property
    def num_segments(self) -> int:
        """Length of the arrays."""
        return len(self.start)

    @property
    def resting(self) -> Bool[np.ndarray, " segment"]:
        """Which segments are rests; the others are plateaus of constant rate, or known moves."""
        return self.position >= 0

    @property
    def known_moves(self) -> Bool[np.ndarray, " segment"]:
        """Which segments are moves at known rates; none where they were not asked for."""
        return np.zeros(self.num_segments, bool) if self.moves is None else self.moves

    @property
    def held_by_hand(self) -> Bool[np.ndarray, " segment"]:
        """Which segments are rests held by hand; none where they were left out."""
        return np.zeros(self.num_segments, bool) if self.held is None else self.held

    def without_held(self) -> "Segments":
        """The same without the rests held by hand."""
        if not self.held_by_hand.any():
            return dataclasses.replace(self, held=None)
        held, kept = self.held_by_hand, ~self.held_by_hand
        used = self.used & ~_inside(self.start[held], self.stop[held], len(self.used))
        return Segments(
            self.start[kept],
            self.stop[kept],
            self.position[kept],
            used,
            self.disturbances,
            self.threshold,
            self.statement,
            self.turning,
            ramps=self.ramps,
            moves=None if self.moves is None else self.moves[kept],
        )

    def runs(
        self,
    ) -> tuple[Int[np.ndarray, " run"], Int[np.ndarray, " run"], Int[np.ndarray, " run"]]:
        """Ranges of rows without a gap that count, and the segment that each belongs to."""
        edge = np.zeros(len(self.used) + 1, bool)
        edge[self.start] = edge[self.stop] = True
        fresh = self.used & (edge[:-1] | ~np.append(False, self.used[:-1]))
        start = np.flatnonzero(fresh)
        ends = self.used & (edge[1:] | ~np.append(self.used[1:], False))
        stop = np.flatnonzero(ends) + 1
        return start, stop, np.searchsorted(self.start, start, side="right") - 1


def rests_are_searched(recording: Recording) -> bool:
    """Whether a recording does not say itself when it rests, so that this is sought in its data."""
    return recording.position is None and recording.reference_gyro is None


def segment(
    recording: Recording, *, window: float = 1.0, handling: bool = True, held: bool = False
) -> Segments:
    """Rests and constant-rate plateaus of one recording.

    **Arguments:** `window` (s) is used only where rests are searched in the data: over how long the
    motion is judged, the shortest rest, and twice what is cut off a rest's two ends together. It is half of that
    where most rests are hardly longer and half of it finds a quarter more of them. With
    `handling`, rows in which a rest was disturbed are left out (`handling.undisturbed`), but with `held` rests that
    were held by hand stay, and are marked.

    Raises `ValueError` for a window that is not positive. A recording without any rest gives no
    segments and says so in `statement`.
    """
    if not window > 0:
        raise ValueError(f"`segment(window=...)` must be positive seconds; got {window}.")
    found = _found(recording, window)
    return without_disturbances(recording, found, held=held) if handling else found


def without_disturbances(recording: Recording, found: Segments, *, held: bool = False) -> Segments:
    """The segments of a recording without the rows in which a rest was disturbed (`handling.undisturbed`).

    Stretches of a slow turn stay as they are: what a hand adds there is in their scatter. With `held`, rests that were
    held by hand for long enough stay as a whole, and are marked.
    """
    if found.turning is not None:
        return found
    rests = np.flatnonzero(found.resting)
    kept = undisturbed(recording, found.start[rests], found.stop[rests], found.position[rests])
    start, stop = found.start.copy(), found.stop.copy()
    start[rests], stop[rests] = kept.start[: len(rests)], kept.stop[: len(rests)]
    start, stop = (
        np.append(a, b[len(rests) :]) for a, b in ((start, kept.start), (stop, kept.stop))
    )
    position = np.append(found.position, kept.position[len(rests) :])
    used, disturbances = kept.used.copy(), kept.disturbances
    marked = np.zeros(len(start), bool)
    if held:
        marked[rests] = kept_for_magnitude(
            kept,
            found.start[rests],
            found.stop[rests],
            found.position[rests],
            usual_step(recording),
        )
        start[marked], stop[marked] = (
            found.start[marked[: len(found.start)]],
            found.stop[marked[: len(found.start)]],
        )
        used[_inside(start[marked], stop[marked], recording.num_samples)] = True
        disturbances = with_force_kept(disturbances, found.position[marked[: len(found.start)]])
    order = np.argsort(start, kind="stable")
    order = order[start[order] < stop[order]]
    start, stop, marked = start[order], stop[order], marked[order]
    return Segments(
        start,
        stop,
        position[order],
        _inside(start, stop, recording.num_samples) & used,
        disturbances,
        found.threshold,
        found.statement,
        held=marked if held else None,
        ramps=found.ramps,
    )


def segment_each(
    recordings: Sequence[Recording],
    *,
    window: float = 1.0,
    handling: bool = True,
    held: bool = False,
) -> list[Segments]:
    """`segment` of each recording, of long ones side by side."""
    one = lambda r: segment(r, window=window, handling=handling, held=held)
    return side_by_side(one, recordings, rows=sum(r.num_samples for r in recordings))


def each_without_disturbances(
    recordings: Sequence[Recording], found: Sequence[Segments], *, held: bool = False
) -> list[Segments]:
    """`without_disturbances` of each recording, of long ones side by side."""
    pairs, rows = zip(recordings, found, strict=True), sum(r.num_samples for r in recordings)
    return side_by_side(lambda pair: without_disturbances(*pair, held=held), pairs, rows=rows)


def joined(segments: Sequence[Segments]) -> Segments:
    """The segments of recordings that are put behind each other, row after row."""
    sizes = [len(s.used) for s in segments]
    offsets = np.cumsum([0, *sizes[:-1]])
    return Segments(
        np.concatenate([s.start + k for s, k in zip(segments, offsets)]),
        np.concatenate([s.stop + k for s, k in zip(segments, offsets)]),
        np.concatenate([s.position for s in segments]),
        np.concatenate([s.used for s in segments]),
        tuple(d for s in segments for d in s.disturbances),
        held=np.concatenate([s.held_by_hand for s in segments]),
        moves=np.concatenate([s.known_moves for s in segments]),
    )


def _found(recording: Recording, window: float) -> Segments:
    if recording.position is not None:
        return _planned(recording, recording.position)
    if recording.reference_gyro is not None:
        still = np.linalg.norm(recording.reference_gyro, axis=1) <= STANDS * EARTH_RATE
        # As of plateaus: at its ends a rest still moves, or already, where a table writes fewer rows than the device.
        inside = ~and_beside(~still)
        runs = np.cumsum(np.diff(still, prepend=still[0]))
        # Between a ramp and the next move a table hardly turns, and is not at rest.
        brief = np.bincount(runs)[runs] * usual_step(recording) < SHORTEST
        position = np.where(inside & ~brief, runs // 2, -1)
        return _planned(recording, position, "the reference rates say")
    found = _long_or_brief(recording, find_rests(recording, window=window), window)
    found = _with_held(recording, found, window)
    turn = _slow_turn(recording, found)
    if turn is not None:
        return turn
    labels = np.arange(len(found.start))
    used = _inside(found.start, found.stop, recording.num_samples)
    return Segments(found.start, found.stop, labels, used, (), found.threshold, found.statement)


def _long_or_brief(recording: Recording, found: Rests, window: float) -> Rests:
    """The rests by half the window, for a hand that lays the device down for a second at a time.

    Where most that were found are hardly longer than it can find, and half of it finds a quarter more of them; where
    they are long, but lie in too few directions to calibrate by, and half of it finds several times as many that do
    not.
    """
    if not len(found.start) or isinstance(recording, StoredRecording):
        return found  # parts of a long log are cut alike
    long = np.median(found.stop - found.start) * usual_step(recording) >= 2.0 * window
    if long and (recording.accel is None or _lies_about(recording.accel, found)):
        return found
    brief = find_rests(recording, window=0.5 * window)
    if long:
        several = len(brief.start) >= _SEVERAL * len(found.start)
        assert recording.accel is not None
        return brief if several and _lies_about(recording.accel, brief) else found
    return brief if len(brief.start) >= _MORE * len(found.start) else found


def _with_held(recording: Recording, found: Rests, window: float) -> Rests:
    """The rests, and those held by hand between two of them, or before or after all.

    A hand is a hundred times as restless as a table. Where the rests lie in too few directions, the longest stretch
    between them is searched by itself, against its own quietest windows.
    """
    if not len(found.start) or recording.accel is None or isinstance(recording, StoredRecording):
        return found
    if _lies_about(recording.accel, found):
        return found
    start, stop = np.append(0, found.stop), np.append(found.start, recording.num_samples)
    longest = int(np.argmax(stop - start))
    first, last = int(start[longest]), int(stop[longest])
    if (last - first) * usual_step(recording) < FEWEST_DIRECTIONS * window:
        return found
    held = find_rests(recording[first:last], window=window)
    if held.apart < _CLEAR or not _lies(recording.accel[first:last], held):
        return found
    statement = f"{found.statement}. Between these, held by hand: {held.statement}"
    begin = np.append(found.start, held.start + first)
    order = np.argsort(begin)
    end = np.append(found.stop, held.stop + first)[order]
    return Rests(begin[order], end, held.threshold, statement, held.apart, held.levels)


def _lies_about(accel: Float[np.ndarray, "time 3"], found: Rests) -> bool:
    """Whether rests lie in directions enough."""
    means = [accel[a:b].mean(axis=0) for a, b in zip(found.start, found.stop, strict=True)]
    return num_directions(np.array(means)) >= FEWEST_DIRECTIONS


def _slow_turn(recording: Recording, found: Rests) -> Segments | None:
    """Stretches of accelerometers alone that turn slowly all along, where they do not lie in enough directions."""
    accel = recording.accel
    if accel is None or recording.gyro is not None or isinstance(recording, StoredRecording):
        return None
    if _lies(accel, found):
        return None
    turn = slow_turn(accel)
    if turn is None:
        return None
    number = len(turn.start)
    rows = int(turn.stop[0] - turn.start[0])
    statement = (
        f"it never lies still for long, so {number} stretches of {rows} row{'s' * (rows > 1)}, in which it hardly "
        f"turns, stand for rests; each is known to {turn.sigma:.2g} m/s² (1 sigma) by its distance from their ellipsoid"
    )
    used = _inside(turn.start, turn.stop, recording.num_samples)
    return Segments(
        turn.start, turn.stop, np.arange(number), used, statement=statement, turning=turn.sigma
    )


def _lies(accel: Float[np.ndarray, "time 3"], found: Rests) -> bool:
    """Whether rests that were found show directions enough, and are rests: most of them do not turn."""
    middle = (found.start + found.stop) // 2
    ranges = zip(found.start, middle, found.stop, strict=True)
    halves = np.array([(accel[a:m].mean(axis=0), accel[m:b].mean(axis=0)) for a, m, b in ranges])
    if num_directions(halves.reshape(-1, 2, 3).mean(axis=1)) < FEWEST_DIRECTIONS:
        return False
    first, second = halves[:, 0], halves[:, 1]
    return bool(np.median(angle_between(first, second)) < _LYING)


def _inside(
    start: Int[np.ndarray, " segment"], stop: Int[np.ndarray, " segment"], rows: int
) -> Bool[np.ndarray, " time"]:
    """Rows of any of the ranges."""
    change = np.zeros(rows + 1, np.int64)
    np.add.at(change, start, 1)
    np.add.at(change, stop, -1)
    return np.cumsum(change[:-1]) > 0


def _planned(
    recording: Recording, position: Int[np.ndarray, " time"], source: str = "`position` says"
) -> Segments:
    """Runs of one position, and runs of −1 in which the reference rate is constant.

    A station that numbers its rates as it numbers its positions means plateaus where the reference turns.
    """
    if recording.position is not None and recording.reference_gyro is not None:
        position = np.where(turning_rows(recording.reference_gyro, position < 0), -1, position)
    breaks = np.diff(position) != 0
    if recording.experiment is not None:
        breaks |= np.diff(recording.experiment) != 0
    breaks |= np.diff(recording.time) > PAUSE * usual_step(recording)
    rate = recording.reference_gyro
    if rate is not None:
        turning = (position[1:] < 0) & (position[:-1] < 0)
        breaks |= turning & ~steady_steps(recording)
    edges = np.concatenate([[0], np.flatnonzero(breaks) + 1, [len(position)]])
    start, stop = edges[:-1], edges[1:]
    kept = resting = position[start] >= 0
    if rate is not None:
        back = resting & _turning_back(recording, rate, start, stop)
        start, stop, resting = start[~back], stop[~back], resting[~back]
        first, last = without_ramps(rate, position, start, stop)
        start, stop = np.where(resting, start, first), np.where(resting, stop, last)
        long = np.flatnonzero(~resting & (start < stop))
        kept = resting.copy()
        kept[long] = plateaus(recording, start[long], stop[long])
    start, stop = start[kept], stop[kept]
    ramps = 0.0
    if rate is not None:
        turning = position[start] < 0
        before = int((stop - start).sum())
        start[turning], stop[turning] = without_unsaid_ramps(
            recording, start[turning], stop[turning]
        )
        ramps = (before - int((stop - start).sum())) * usual_step(recording)
    rests = int((position[start] >= 0).sum())
    statement = f"{rests} rests"
    if rate is not None:
        statement += f" and {len(start) - rests} plateaus of constant rate"
    where = np.maximum(position[start], -1).astype(np.int64)
    used = _inside(start, stop, len(position))
    return Segments(start, stop, where, used, statement=f"{statement}, as {source}", ramps=ramps)


def _turning_back(
    recording: Recording,
    rate: Float[np.ndarray, "time 3"],
    start: Int[np.ndarray, " run"],
    stop: Int[np.ndarray, " run"],
) -> Bool[np.ndarray, " run"]:
    """Runs shorter than a rest with a turn right before and right after: rows in which a table turns back."""
    turning = np.linalg.norm(rate, axis=1) > TURNING * EARTH_RATE
    before, after = np.maximum(start - 1, 0), np.minimum(stop, len(turning) - 1)
    inside = (start > 0) & (stop < len(turning)) & turning[before] & turning[after]
    return inside & (recording.time[after] - recording.time[before] < SHORTEST)
