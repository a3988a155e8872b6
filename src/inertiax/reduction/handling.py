"""Where a device was disturbed at rest: knocks, slips, slow tilts, ends that still move, spikes and clipped rests.

All of it is handling, or a fault of the read-out, and none is physics of the sensor: it is left out, counted and said.
What a device does at rest is seen by both triads together (`knocks`, `tilts`); what one triad alone shows is left to
the diagnosis. One exception: where rests were found in the data, nobody vouches for them, and a burst of the gyros
alone may be a turn about the vertical.
"""

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import SupportsIndex

import numpy as np
from jaxtyping import Bool, Int

from .._records import field, Module
from ..data.recording import Recording
from .clipping import clipped
from .hand_motion import moved_by_hand
from .knocks import knocked, levels_of, spiked
from .mean_noise import converter_steps
from .quiet_level import runs_of
from .rest_ends import quiet_part
from .rests import usual_step
from .tilts import slips, tilting


KINDS = ("knock", "motion", "slip", "slow tilt", "not at rest", "spike", "clipped", "held", "alone")


@dataclass(frozen=True)
class HandlingThresholds:
    """What becomes of a disturbed rest."""

    held: float = 0.5  # of a rest: where more is disturbed, it was held by hand, and all of it goes (convention)
    least_rests: float = (
        0.5  # of the rests stay: where more would go, what is usual is not known, and all stay
    )
    part: float = (
        2.0  # s, that a part of a searched rest beside a slip lasts to be a rest (convention)
    )


THRESHOLDS = HandlingThresholds()
PAUSE = 20.0  # usual steps without a sample that are a gap, as `check` counts them
MOST_SLIPS = 3  # of a rest that are looked for, one after another


class Disturbance(Module):
    """A stretch of a rest that was disturbed."""

    recording: str = field(static=True)  # its name
    start: float = field(static=True)  # s, on the recording's clock
    end: float = field(static=True)  # s
    kind: str = field(static=True)  # one of `KINDS`
    position: int = field(static=True)  # of the rest
    # False: kept, since it is so in most rests
    left_out: bool = field(static=True, default=True)
    # True: left out of all but |a|, which a hand that holds the device does not change
    force_kept: bool = field(static=True, default=False)

    def as_dict(self) -> dict:
        """The entry of a result's `handling`."""
        return {k: getattr(self, k) for k in self.__dataclass_fields__}


@dataclass(frozen=True)
class Undisturbed:
    """What is left of the rests of one recording: their ends, and which rows count."""

    start: Int[np.ndarray, " rest"]  # start = stop where nothing is left of a rest
    stop: Int[np.ndarray, " rest"]
    position: Int[np.ndarray, " rest"]
    used: Bool[np.ndarray, " time"]  # True outside the rests
    disturbances: tuple[Disturbance, ...]

    def ranges(self) -> Iterator[tuple[int, slice]]:
        """Number and rows of each rest of which something is left."""
        for k, (a, b) in enumerate(zip(self.start, self.stop)):
            if a < b:
                yield k, slice(int(a), int(b))

    def noted(
        self,
        recording: Recording,
        kind: str,
        rest: SupportsIndex,
        first: SupportsIndex,
        last: SupportsIndex,
        left_out: bool = True,
    ) -> Disturbance:
        """The rows `[first, last)` of a rest as a disturbance."""
        time, step = recording.time, usual_step(recording)
        before, end = (float(time[min(last.__index__() - k, len(time) - 1)]) for k in (1, 0))
        if (
            end - before > PAUSE * step
        ):  # nobody knows how the device lay while nothing was recorded
            end = before + step
        where = int(self.position[rest])
        return Disturbance(recording.name, float(time[first]), end, kind, where, left_out)

    def without(
        self, recording: Recording, kind: str, marked: Bool[np.ndarray, " rest"]
    ) -> "Undisturbed":
        """Without whole rests; all stay, and are noted, where too few would."""
        there = self.stop > self.start
        marked = marked & there
        out = bool((there & ~marked).sum() >= THRESHOLDS.least_rests * len(there))
        found = [
            self.noted(recording, kind, k, self.start[k], self.stop[k], out)
            for k in np.flatnonzero(marked)
        ]
        stop = np.where(marked & out, self.start, self.stop)
        return Undisturbed(self.start, stop, self.position, self.used, (*self.disturbances, *found))

    def without_rows(
        self, recording: Recording, kind: str, marked: Mapping[int, Bool[np.ndarray, " _"]]
    ) -> "Undisturbed":
        """Without rows of rests, by number of the rest; a rest of which too much would go was held, and goes whole."""
        used, found = self.used.copy(), list(self.disturbances)
        held = np.zeros(len(self.start), bool)
        for k, rows in self.ranges():
            if k not in marked:
                continue
            out = marked[k] & used[rows]
            held[k] = (out | ~used[rows]).mean() > THRESHOLDS.held and out.any()
            if held[k]:
                continue
            for a, b in zip(*runs_of(out)):
                found.append(self.noted(recording, kind, k, rows.start + a, rows.start + b))
            used[rows] &= ~out
        left = Undisturbed(self.start, self.stop, self.position, used, tuple(found))
        return left.without(recording, "held", held)


Step = Callable[[Recording, "Undisturbed"], "Undisturbed"]


def undisturbed(
    recording: Recording,
    start: Int[np.ndarray, " rest"],
    stop: Int[np.ndarray, " rest"],
    position: Int[np.ndarray, " rest"],
) -> Undisturbed:
    """The rests of one recording without what was disturbed, and what that was.

    Rests that a slip cuts in two stay where they are in the arrays, and their other parts follow all of them.
    """
    left = Undisturbed(start, stop, position, np.ones(recording.num_samples, bool), ())
    if not len(start):
        return left
    for step in STEPS:
        left = step(recording, left)
    order = sorted(left.disturbances, key=lambda d: (d.start, d.end))
    return replace(left, disturbances=tuple(order))


def _without_moving_ends(recording: Recording, left: Undisturbed) -> Undisturbed:
    """Rests whose position is stated may begin before the device has stopped."""
    if recording.position is None:
        return left
    step = usual_step(recording)
    start, stop, found = left.start.copy(), left.stop.copy(), list(left.disturbances)
    for k, rows in left.ranges():
        accel, gyro = (None if x is None else x[rows] for x in (recording.accel, recording.gyro))
        if accel is None and gyro is None:
            continue
        first, last = quiet_part(accel, gyro, step)
        start[k], stop[k] = left.start[k] + first, left.start[k] + last
        for a, b in ((left.start[k], start[k]), (stop[k], left.stop[k])):
            if a < b:
                found.append(left.noted(recording, "not at rest", k, a, b))
    return Undisturbed(start, stop, left.position, left.used, tuple(found))


def _without_clipped(recording: Recording, left: Undisturbed) -> Undisturbed:
    marked = np.zeros(len(left.start), bool)
    for values in (recording.accel, recording.gyro):
        if values is not None:
            marked |= clipped(values, left.start, left.stop)
    return left.without(recording, "clipped", marked)


def _without_slips(recording: Recording, left: Undisturbed) -> Undisturbed:
    """Of a rest with a slip the longer part stays, and may hold another one.

    The shorter part is one more rest where rests were found in the data: it lies in a pose of its own, as any of them
    does. A stated position is one pose, so there the shorter part goes, and counts as left out.
    """
    accel, gyro = recording.accel, recording.gyro
    if accel is None or gyro is None:
        return left
    step = usual_step(recording)
    searched = recording.position is None and recording.reference_gyro is None
    shortest = max(THRESHOLDS.part / step, 16.0) if step > 0.0 and searched else np.inf
    for _ in range(MOST_SLIPS):
        rests = [(accel[rows], gyro[rows]) for _, rows in left.ranges()]
        moments = slips(rests, step)
        if all(m is None for m in moments):
            break
        start, stop, found = left.start.copy(), left.stop.copy(), list(left.disturbances)
        further = []  # behind the others, so that those keep their numbers
        for (k, rows), moment in zip(left.ranges(), moments):
            if moment is None:
                continue
            first, last = rows.start + moment[0], rows.start + moment[1]
            parts = sorted([(rows.start, first), (last, rows.stop)], key=lambda p: p[0] - p[1])
            (start[k], stop[k]), other = parts
            if other[1] - other[0] >= shortest:
                further.append(other)
            else:
                first, last = min(first, other[0]), max(last, other[1])
            found.append(left.noted(recording, "slip", k, first, last))
        added = np.array(further, dtype=np.int64).reshape(-1, 2)
        labels = left.position.max() + 1 + np.arange(len(added))
        left = Undisturbed(
            np.append(start, added[:, 0]),
            np.append(stop, added[:, 1]),
            np.append(left.position, labels),
            left.used,
            tuple(found),
        )
    return left


def _without_hand_motion(recording: Recording, left: Undisturbed) -> Undisturbed:
    """Slow motion by hand, where rests were found in the data."""
    gyro = recording.gyro
    if gyro is None or recording.position is not None or recording.reference_gyro is not None:
        return left
    inside = list(left.ranges())
    marked = moved_by_hand([gyro[rows] for _, rows in inside], usual_step(recording))
    return left.without_rows(recording, "motion", {k: m for (k, _), m in zip(inside, marked)})


def _without_bursts(recording: Recording, left: Undisturbed) -> Undisturbed:
    """Knocks by both triads, and single samples of either."""
    step = usual_step(recording)
    triads = [x for x in (recording.accel, recording.gyro) if x is not None]
    converters = [converter_steps(x) for x in triads]
    searched = recording.position is None and recording.reference_gyro is None
    knocks, spikes = {}, {}
    for k, rows in left.ranges():
        levels = [levels_of(x[rows], step, c) for x, c in zip(triads, converters)]
        if len(levels) == 2:
            knocks[k] = knocked(levels[0], levels[1], step, searched)
        spikes[k] = np.any([spiked(x) for x in levels], axis=0)
    return left.without_rows(recording, "knock", knocks).without_rows(recording, "spike", spikes)


def _without_tilts(recording: Recording, left: Undisturbed) -> Undisturbed:
    accel, gyro = recording.accel, recording.gyro
    if accel is None or gyro is None:
        return left
    inside = list(left.ranges())
    rests = [(_kept(accel[r], left.used[r]), _kept(gyro[r], left.used[r])) for _, r in inside]
    marked = np.zeros(len(left.start), bool)
    marked[[k for k, _ in inside]] = tilting(rests, usual_step(recording))[0]
    return left.without(recording, "slow tilt", marked)


def _kept(x: np.ndarray, used: np.ndarray) -> np.ndarray:
    """Rows that count; no copy where all do."""
    return x if used.all() else x[used]


STEPS: tuple[Step, ...] = (
    _without_moving_ends,
    _without_clipped,
    _without_slips,
    _without_hand_motion,
    _without_bursts,
    _without_tilts,
)


NOUNS = {
    "knock": ("knock", "knocks"),
    "motion": ("motion by hand", "motions by hand"),
    "slip": ("slip", "slips"),
    "slow tilt": ("rest that tilts slowly", "rests that tilt slowly"),
    "not at rest": (
        "end of a labelled rest that still moves",
        "ends of labelled rests that still move",
    ),
    "spike": ("spike of one channel", "spikes of one channel"),
    "clipped": ("clipped rest", "clipped rests"),
    "held": ("rest held by hand", "rests held by hand"),
    "alone": ("part of a rest that stands out alone", "parts of rests that stand out alone"),
}


def with_force_kept(
    found: Sequence[Disturbance], positions: Int[np.ndarray, " rest"]
) -> tuple[Disturbance, ...]:
    """The same with the rests at some positions that a hand held kept for the magnitude of the force."""
    kept = set(positions.tolist())
    return tuple(replace(d, force_kept=d.kind == "held" and d.position in kept) for d in found)


def with_force_counted(found: Sequence[Disturbance], counts: bool) -> tuple[Disturbance, ...]:
    """The same where the magnitude of the force `counts`, or where none of it does, as against a reference."""
    return tuple(replace(d, force_kept=d.force_kept and counts) for d in found)


def handling_words(found: Sequence[Disturbance]) -> list[str]:
    """What was left out of the rests, and which count for the magnitude of the force alone: a sentence each."""
    return [s for s in (left_out_sentence(found), held_sentence(found)) if s is not None]


def held_sentence(found: Sequence[Disturbance]) -> str | None:
    """Which rests count for the magnitude of the force alone, in one sentence; `None` where none does."""
    held = [d for d in found if d.force_kept]
    if not held:
        return None
    count = f"{_counted(held)}, {_seconds(held)}, {'count' if len(held) > 1 else 'counts'}"
    return f"Handling: {count} for the accelerometers' |a| alone, which a turn does not change."


def left_out_sentence(found: Sequence[Disturbance]) -> str | None:
    """What was left out of the rests, in one sentence; `None` where nothing was."""
    out = [d for d in found if d.left_out and not d.force_kept]
    return f"Handling: {_counted(out)} left out, {_seconds(out)} of rest in all." if out else None


def kept_sentence(found: Sequence[Disturbance]) -> str | None:
    """What was seen and kept all the same, in one sentence; `None` where nothing was."""
    kept = [d for d in found if not d.left_out]
    if not kept:
        return None
    return (
        f"Handling: {_counted(kept)} kept, since too few rests are left without; the uncertainties do not hold "
        "that, so let the device lie untouched and record it again."
    )


def _seconds(found: Sequence[Disturbance]) -> str:
    return f"{sum(d.end - d.start for d in found):.3g} s"


def _counted(found: Sequence[Disturbance]) -> str:
    number = Counter(d.kind for d in found)
    return ", ".join(f"{n} {NOUNS[k][n > 1]}" for k in KINDS if (n := number[k]))
