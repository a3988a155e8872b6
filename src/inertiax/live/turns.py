"""The turns between accepted rests that follow each other in one recording, as the batch estimate takes them.

A turn is integrated by its stamps, over a missing row too: counted at a mean rate, all rows behind it would be late
by a part of the gap. Only where a host stamps unevenly, and gravity says so, are rows counted (`motion_clock`). A turn
that alone misses gravity's turn is left out (`missed_turns`), and one at whose rates a gyro is at the end of its range.
"""

import dataclasses
from collections.abc import Callable

import numpy as np
from jaxtyping import Bool, Float

from ..data.recording import Recording
from ..physics.vectors import angle_between, unit_vector
from ..reduction.clipping import clipped_rows
from ..reduction.missed_turns import missed
from ..reduction.motion_clock import motion_clock, step_angles, Turn as Motion
from ..reduction.rests import PAUSE
from ..reduction.turned_direction import turned
from .gyro_rows import LONGEST, mean_rates, Turn
from .rest_ledger import Rest
from .row_store import RowStore


FEWEST = 4  # steps of a turn, as in the batch estimate
LARGEST_STEP = 0.5  # rad from row to row, as there

_Clock = Float[np.ndarray, " row"] | None  # s, of the rows of a recording where they are counted
Force = Callable[[Float[np.ndarray, "turn 3"]], Float[np.ndarray, "turn 3"]]


@dataclasses.dataclass(frozen=True)
class _Judged:
    """What gravity says of the turns of one recording."""

    count: int  # turns that were looked at
    clock: _Clock
    off: frozenset[tuple[int, int]]  # rows of those that miss gravity's turn


_UNKNOWN = _Judged(0, None, frozenset())


class Turns:
    """Turns of a session; those of the same rows are kept, with what was integrated of them."""

    def __init__(self, stores: list[RowStore]):
        self._stores = stores  # of each recording, growing
        self._known: dict[tuple[int, int, int, bool], Turn] = {}
        self._judged: dict[int, _Judged] = {}

    def between(self, rests: list[Rest], force: Force) -> list[Turn]:
        """The turns between rests that no hand held. **Arguments:** `force` compensates mean outputs of the
        accelerometers, m/s²."""
        ordered = sorted((r for r in rests if not r.held), key=lambda r: (r.part, r.start))
        pairs: dict[int, list[tuple[Rest, Rest]]] = {}
        for before, after in zip(ordered[:-1], ordered[1:]):
            if before.part == after.part and self._turn(before, after, None):
                pairs.setdefault(before.part, []).append((before, after))
        found = []
        for part, mine in pairs.items():
            judged = self._judged.get(part, _UNKNOWN)
            if judged.count != len(mine):
                judged = self._judged[part] = _judge(mine, self._stores[part - 1], force)
            kept = [p for p in mine if _rows(*p) not in judged.off]
            made = [self._turn(*p, judged.clock) for p in kept]
            found += [t for t in made if t is not None]
        return found

    def _turn(self, before: Rest, after: Rest, clock: _Clock) -> Turn | None:
        key = before.part, *_rows(before, after), clock is not None
        if key not in self._known:
            made = _turn(before, after, self._stores[before.part - 1], clock)
            if made is None:
                return None
            self._known[key] = made
        return self._known[key]


def _rows(before: Rest, after: Rest) -> tuple[int, int]:
    """The last row of the rest before and the first of the one after, of the thinned rows."""
    return before.stop - 1, after.start


def _bias(before: Rest, after: Rest) -> Float[np.ndarray, "3"]:
    assert before.gyro is not None and after.gyro is not None
    return 0.5 * (before.gyro + after.gyro)


def _turn(before: Rest, after: Rest, store: RowStore, clock: _Clock) -> Turn | None:
    first, last = _rows(before, after)
    if before.accel is None or after.accel is None or before.gyro is None or last >= store.count:
        return None
    rows = store.recording(first, last + 1, means=True)
    assert rows.gyro is not None
    if last - first < FEWEST:
        return None
    stamped = np.diff(rows.time)
    step = stamped if clock is None else np.diff(clock[first : last + 1])
    rate = rows.gyro - _bias(before, after)
    if stamped.max() > PAUSE * np.median(stamped) or step.sum() > LONGEST:
        return None
    speed = np.linalg.norm(rate, axis=1)
    if np.any(np.maximum(speed[1:], speed[:-1]) * step > LARGEST_STEP):
        return None
    walk = _walk(before, after, float(step.sum()))
    return Turn(mean_rates(rate, step), step, before.accel, after.accel, walk)


def _judge(pairs: list[tuple[Rest, Rest]], store: RowStore, force: Force) -> _Judged:
    """By which clock the turns of one recording are integrated, and which of them are left out."""
    rows = store.recording(means=True)
    assert rows.gyro is not None
    direction = lambda outputs: unit_vector(force(np.array(outputs)))
    ups = zip(direction([b.accel for b, _ in pairs]), direction([a.accel for _, a in pairs]))
    motions = [Motion(*_rows(*p), *up, _bias(*p)) for p, up in zip(pairs, ups)]
    ended = clipped_rows(rows.gyro)
    off = np.array([bool(ended[m.first : m.last + 1].any()) for m in motions], bool)
    within = [m for m, out in zip(motions, off) if not out]
    if within:
        off[~off] = _missed(rows, within)
    agreeing = [m for m, out in zip(motions, off) if not out]
    clock = motion_clock(rows.time, rows.gyro, agreeing)
    left_out = frozenset((m.first, m.last) for m, out in zip(motions, off) if out)
    return _Judged(len(pairs), None if clock.rate is None else clock.time, left_out)


def _missed(rows: Recording, motions: list[Motion]) -> Bool[np.ndarray, " motion"]:
    assert rows.gyro is not None
    angle = step_angles(rows.time, rows.gyro, motions)
    before, after = (np.stack([getattr(m, name) for m in motions]) for name in ("before", "after"))
    end = np.einsum("mij,mj->mi", turned(angle), before)
    path = np.linalg.norm(angle, axis=2).sum(axis=1)
    return missed(angle_between(end, after), path)


def _walk(before: Rest, after: Rest, seconds: float) -> float:
    """Variance of the integrated rate: N² T by the noise at rest, and the bias' own times T²."""
    walk = 0.0
    for rest in (before, after):
        assert rest.gyro_covariance is not None
        of_mean = float(np.trace(rest.gyro_covariance)) / 3.0
        lasts = rest.time[1] - rest.time[0]
        walk += 0.5 * of_mean * lasts * seconds + 0.25 * of_mean * seconds**2
    return walk
