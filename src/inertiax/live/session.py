"""A recording while it is made: rows in, events out.

An event is a mapping that goes out as one line of JSON: `start`, `rest`, `problem`, `progress`, `next`, `done`
(docs/live.md). A rest that is said again under its number is one whose verdict changed, since later rests showed what
is usual.
"""

import dataclasses
from collections.abc import Generator, Iterator

import numpy as np
from jaxtyping import Float

from ..data.recording import Campaign, Recording
from ..plausibility import check_campaign
from .estimate import counts_held, Estimate, estimate
from .events import (
    done_event,
    Event,
    far_target_event,
    next_event,
    problem_event,
    progress_event,
    rest_event,
    start_event,
    state_event,
    warming_event,
    withdrawn_event,
)
from .far_target import nothing_gains, rests_to_target
from .itinerary import Itinerary
from .next_position import NextPosition
from .rest_ledger import judge, Judged, matched, RECENT, Rest, WINDOW
from .rest_watch import LONGEST, RestWatch
from .row_store import RowStore
from .target import Target
from .turns import Turns


LOOK = 0.1  # s of rows between two looks at the newest ones
FIRST = 4.0  # s of rows before which no rest is said: what is quiet is not known yet
RETRY = 0.5  # s of motion after which the rests are asked for again
HOLD = 4.0  # s that a rest lasts when the next position is told, unless asked otherwise
CHECKED = (1, 2, 4, 7, 12, 20, 40)  # rests after which the plausibility is looked at
AFFORDABLE = 4000  # thinned rows at rest that are judged anew together within a tenth of a second
REFRESHED = 10  # rests after which all are judged anew where that takes longer


@dataclasses.dataclass(eq=False)
class Session:
    """State of one session. `feed` and `end` give events; `finished` says that nothing more is needed."""

    campaign: Campaign  # settings; its recordings are not looked at
    target: Target
    hold: float = HOLD
    itinerary: Itinerary | None = None  # steps to be followed instead of the target
    finished: bool = False
    rests: list[Rest] = dataclasses.field(default_factory=list)
    estimate: Estimate | None = None

    def __post_init__(self) -> None:
        self._stores: list[RowStore] = []
        self._turns = Turns(self._stores)
        self._told: set[tuple[str, str]] = set()
        self._seconds = 0.0
        self._exhausted = 0
        self._checked = 0
        self._begin()

    def _begin(self) -> None:
        self._errors: dict[tuple[str, str], str] = {}  # of this recording, as they were told
        self._stores.append(RowStore(f"recording-{len(self._stores) + 1}"))
        self._watch = RestWatch(self.store)

    @property
    def store(self) -> RowStore:
        """Rows of the present recording."""
        return self._stores[-1]

    @property
    def seconds(self) -> float:
        """How long was recorded."""
        return self._seconds

    @property
    def moving(self) -> bool:
        """Whether the device moved in the newest second of rows."""
        return self._watch.moving

    def state(self) -> Event | None:
        """The device now; `None` while there are too few rows."""
        if not self.store.count:
            return None
        return state_event(self.store, self._watch.step, moving=self.moving)

    @property
    def accepted(self) -> list[Rest]:
        """Rests that are used."""
        return [r for r in self.rests if r.accepted]

    def leap(self, statement: str) -> Iterator[Event]:
        """The clock leapt, or the log began anew: the next rows are another recording."""
        yield problem_event("clock", "warning", statement)
        if self.store.count:
            yield from self._refresh(self.store.count, ended=False)
        if self.store.last is not None:  # `count` is 0 for the first second
            self._begin()

    def feed(self, rows: Recording, stamps: Float[np.ndarray, " time"]) -> Iterator[Event]:
        """Further rows of the present recording, with increasing stamps."""
        if len(stamps):
            begin = self.store.last if self.store.last is not None else float(stamps[0])
            self._seconds += float(stamps[-1]) - begin
        self.store.add(rows, stamps)
        while not self.finished and self._watch.looked < self.store.count:
            step = self._watch.step
            ahead = self._watch.looked + max(round(LOOK / step), 1)
            if ahead > self.store.count:
                break
            self._watch.looked = ahead
            yield from self._look(ahead, step)

    def end(self) -> Iterator[Event]:
        """The input ended."""
        if self.finished:
            return
        if self.store.count:
            yield from self._refresh(self.store.count, ended=False)
        reached = self.estimate is not None and self.estimate.reached
        reason = "target reached" if reached else "input ended"
        if self.itinerary is not None and self.itinerary.finished(self.accepted):
            reason = "run completed"
        yield from self._done(reason)

    # --- rests -----------------------------------------------------------------------------------

    def _look(self, row: int, step: float) -> Iterator[Event]:
        """One look at the newest rows, up to `row`."""
        width = max(round(WINDOW / step), 16)
        if row < width:
            return
        window = self.store.recording(row - width, row)
        if self._checked == 0 and row * step > 3.0 * WINDOW:
            yield from self._check(row)
        if not self._watch.asked_before and window.position is None:
            if row < 2 * width:  # too short for the finder
                return
            self._watch.search(row)
        if self._watch.moves(window) and (yield from self._moved_on(row, step, window)):
            return
        later = (
            self._watch.held + self.hold if self.itinerary is not None else 2.0 * self._watch.held
        )
        due = self.hold if self._watch.held == 0.0 else later
        if self._watch.rested(row) < due:
            return
        found = self._watch.search(row)
        self._watch.begins_with(found, width)
        rested = self._watch.rested(row)
        if rested >= due:
            self._watch.held = rested
            yield from self._resting(row, found)

    def _moved_on(self, row: int, step: float, window: Recording) -> Generator[Event, None, bool]:
        """The newest window moves, by what was usual when the finder was last asked: it is asked again, and the rests
        that ended are told. Whether it moves indeed."""
        now = float(window.time[-1])
        began = self._watch.moved is None or self._watch.moved < row - 2 * max(
            round(LOOK / step), 1
        )
        due = began or self._watch.asked is None or now - self._watch.asked >= RETRY
        if due and row * step >= FIRST:
            self._watch.asked = now
            found = self._watch.search(row)
            if not self._watch.moves(window):
                self._watch.begins_with(found, window.num_samples)
                return False
            self._watch.moved, self._watch.held = row, 0.0
            yield from self._ended(row, found)
        self._watch.moved, self._watch.held = row, 0.0
        return True

    def _ended(self, row: int, found: list[tuple[int, int, int]]) -> Iterator[Event]:
        """Rests that ended before `row`."""
        ended = [r for r in found if r[1] <= row and self._watch.is_over(r, row)]
        fresh = [r for r in ended if not self._known(r)]
        if not fresh:
            return
        if self._affordable(fresh) or any(self._overlapping(r) for r in fresh):
            yield from self._refresh(row, ended=True)
        else:
            yield from self._rests(self._judged(fresh, row))
            yield from self._answer()
            if len(self.rests) % REFRESHED == 0:
                yield from self._refresh(row, ended=True)
        yield from self._stop(row)
        yield from self._check(row)

    def _overlapping(self, rest: tuple[int, int, int]) -> list[Rest]:
        part = len(self._stores)
        return [r for r in self.rests if r.part == part and r.overlaps(rest[0], rest[1])]

    def _known(self, rest: tuple[int, int, int]) -> bool:
        """Whether a rest was said with these ends."""
        slack = self._watch.slack
        return any(r.is_like(rest[0], rest[1], slack) for r in self._overlapping(rest))

    def _judged(self, fresh: list[tuple[int, int, int]], row: int) -> list[Rest]:
        """Further rests, judged by those shortly before."""
        part = len(self._stores)
        mine = [r for r in self.rests if r.part == part][-RECENT:]
        both = [(r.start, r.stop, k) for k, r in enumerate(mine)]
        both += [(a, b, len(mine) + k) for k, (a, b, _) in enumerate(fresh)]
        first = min(a for a, _, _ in both)
        moved = [(a - first, b - first, label) for a, b, label in both]
        found = self._judge(first, row, moved)
        made = []
        for judged, (a, b, _) in zip(found[len(mine) :], fresh):
            rest = self._made(a, b)
            rest.take(judged)
            made.append(rest)
        return made

    def _judge(self, first: int, row: int, rests: list[tuple[int, int, int]]) -> list[Judged]:
        """Rests among the rows `[first, row)`, numbered from there."""
        picked = self.store.recording(first, row)
        averaged = self.store.recording(first, row, means=True)
        return judge(picked, averaged, rests, by_magnitude=counts_held(picked, self.campaign))

    def _made(self, start: int, stop: int) -> Rest:
        time_ = self.store.recording(start, stop).time
        ends = float(time_[0]), float(time_[-1])
        return Rest(len(self.rests) + 1, len(self._stores), start, stop, ends)

    def _rests(self, added: list[Rest]) -> Iterator[Event]:
        for rest in added:
            rest.number = len(self.rests) + 1
            self.rests.append(rest)
            missed = None
            if self.itinerary is not None and rest.accepted:
                missed = self.itinerary.missed(self.accepted)
            yield rest_event(rest, self._stores[rest.part - 1], missed)

    def _resting(self, row: int, found: list[tuple[int, int, int]]) -> Iterator[Event]:
        """The device still rests: where to turn next, or that this rest was the last one needed."""
        if not found or self._overlapping(found[-1]) or found[-1][1] <= (self._watch.moved or 0):
            return
        (rest,) = self._judged([found[-1]], row)
        if not rest.accepted:
            return
        tried = [*self.accepted, rest]
        found_now = self._estimated(tried)
        if self._is_last(tried, found_now):
            yield from self._rests([rest])
            yield from self._refresh(row, ended=False)
            yield from self._answer(provisional=True)
            yield from self._stop(row)
        elif (position := self._position(tried, found_now)) is not None:
            yield next_event(position, provisional=True)

    # --- answers ---------------------------------------------------------------------------------

    def _estimated(self, rests: list[Rest]) -> Estimate:
        force = (lambda outputs: outputs) if self.estimate is None else self.estimate.force
        return estimate(
            rests,
            self.campaign,
            self.target,
            self.estimate,
            self._turns.between(rests, force),
        )

    def _answer(self, *, provisional: bool = False) -> Iterator[Event]:
        """Progress and the next position."""
        self.estimate = self._estimated(self.accepted)
        if not self.accepted:
            return
        for triad in self.estimate.triads:
            key = "temperature", triad.names[0]
            if triad.slopes is not None and key not in self._told:
                self._told.add(key)
                yield warming_event(triad, self.accepted)
        yield progress_event(self.estimate)
        yield from self._far(self.estimate)
        position = self._position(self.accepted, self.estimate)
        if position is not None and not provisional:
            yield next_event(position)

    def _far(self, found: Estimate) -> Iterator[Event]:
        """That the target is far away, told once."""
        further = rests_to_target(found)
        if further is not None and self.itinerary is None and ("target", "far") not in self._told:
            self._told.add(("target", "far"))
            yield far_target_event(found, further)

    def _position(self, rests: list[Rest], found: Estimate) -> NextPosition | None:
        """What comes next: the itinerary's next step, or what gains most."""
        if self.itinerary is not None:
            return self.itinerary.next_position(rests)
        return found.next_position()

    def _is_last(self, rests: list[Rest], found: Estimate) -> bool:
        """Whether nothing is needed after these rests, as far as it can be said before all are judged anew."""
        if self.itinerary is not None:
            return self.itinerary.finished(rests)
        return found.reached or self._is_exhausted(found, count=False)

    def _stop(self, row: int) -> Iterator[Event]:
        """Done, where all rests judged anew still say so."""
        if self.estimate is None:
            return
        if self.itinerary is not None:
            if self.itinerary.finished(self.accepted):
                yield from self._refresh(row, ended=False)
                if self.itinerary.finished(self.accepted):
                    yield from self._done("run completed")
            return
        if not (self.estimate.reached or self._is_exhausted(self.estimate)):
            return
        yield from self._refresh(row, ended=False)
        assert self.estimate is not None
        if self.estimate.reached:
            yield from self._done("target reached")
        elif self._is_exhausted(self.estimate, count=False):
            yield from self._done("nothing more to gain")

    def _is_exhausted(self, found: Estimate, *, count: bool = True) -> bool:
        """Whether nothing gains, twice in a row."""
        self._exhausted = self._exhausted + count if nothing_gains(found) else 0
        return self._exhausted >= 2

    def _affordable(self, fresh: list[tuple[int, int, int]]) -> bool:
        """Whether all rests of the present recording can be judged anew at once."""
        part = len(self._stores)
        rows = sum(r.stop - r.start for r in self.rests if r.part == part)
        return rows + sum(b - a for a, b, _ in fresh) <= AFFORDABLE

    def _refresh(self, row: int, *, ended: bool) -> Iterator[Event]:
        """All rests of the present recording judged together, as the batch command will; tells what changed.

        With `ended` a rest at the very end is left for later.
        """
        found = self._watch.search(row)
        if ended and found and not self._watch.is_over(found[-1], row):
            found = found[:-1]
        if not found:
            return
        judged = self._judge(0, row, found)
        fresh = [(one, self._made(one.start, one.stop)) for one in judged]
        first, part = max(row - LONGEST, 0), len(self._stores)
        before = [r for r in self.rests if r.part == part and r.start >= first]
        changed, added = matched(before, fresh, self._watch.slack)
        for rest in changed:
            yield rest_event(rest, self._stores[rest.part - 1])
        yield from self._rests(added)
        if changed or added:
            yield from self._answer()
        elif self.accepted:
            self.estimate = self._estimated(self.accepted)

    def _check(self, row: int) -> Iterator[Event]:
        """What cannot be right, told once each."""
        count = len(self.rests)
        if self._checked and not any(self._checked <= n <= count for n in CHECKED):
            return
        self._checked = count + 1
        yield from self._problems(row)

    def _problems(self, row: int) -> Iterator[Event]:
        """What a look at the rows finds and was not told yet; errors that it finds no longer are withdrawn: with few
        rests, or with one that was none, a triad may seem to read what it does not."""
        recording = self.store.recording(0, row)
        seen = check_campaign(dataclasses.replace(self.campaign, recordings=(recording,)))
        wrong = {(f.kind, f.what) for f in seen.findings if f.severity == "error"}
        for key in self._errors.keys() - wrong:
            self._told.discard(key)
            yield withdrawn_event(key[0], self._errors.pop(key))
        for found in seen.findings:
            key = found.kind, found.what
            if key not in self._told and found.severity != "note":
                self._told.add(key)
                if found.severity == "error":
                    self._errors[key] = found.statement
                yield problem_event(found.kind, found.severity, found.statement, found.remedy)

    def start_event(self) -> Event:
        """What is asked for; the first event."""
        return start_event(self.target, self.hold)

    def first_step(self) -> Iterator[Event]:
        """The first step of an itinerary, told before anything was recorded."""
        if self.itinerary is not None and (first := self.itinerary.next_position([])) is not None:
            yield next_event(first)

    def _done(self, reason: str) -> Iterator[Event]:
        if self._errors:
            yield from self._problems(self.store.count)
        self.finished = True
        yield done_event(reason, len(self.accepted), self._seconds)
