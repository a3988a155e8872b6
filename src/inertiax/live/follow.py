"""From the bytes of a log to the events of a session, with everything recorded beside."""

import dataclasses
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Int

from ..data.campaign import load_settings
from ..data.formats import Layout
from ..data.model_columns import check_model_columns
from ..data.recording import Campaign, Recording
from .events import Event, problem_event
from .itinerary import Itinerary
from .recorder import Recorder
from .row_sources import follow, Piece
from .session import HOLD, Session
from .stamp_order import Place, StampOrder
from .target import parse_target, Target, usual_target
from .text_rows import Chunk, TextRows


WATCHED = 0.1  # s, between two looks at the device now


@dataclasses.dataclass(frozen=True, eq=False)
class Plan:
    """What is followed and what is asked for, checked before the first row."""

    campaign: Campaign
    rows: TextRows
    log: Path | None  # `None`: standard input
    target: Target
    itinerary: Itinerary | None = None  # steps that are followed instead


def plan(campaign: Path, log: Path | None, *, piped: bool, target: str | None) -> Plan:
    """What to follow: `log`, standard input where `piped`, or the one file that the campaign names.

    Raises `ValueError` in one line for a target that is not understood and for campaigns that no single growing text
    can be.
    """
    settings, table = load_settings(campaign)
    file = settings.path
    assert file is not None
    asked = usual_target(settings.grade) if target is None else parse_target(target)
    said = table.recordings
    if said.gyro_files is not None:
        raise ValueError(
            f"{file}: [recordings] gyro_files logs the triads apart; `live` follows one log that holds both."
        )
    if said.table_files is not None:
        raise ValueError(
            f"{file}: [recordings] table_files is a log of the table's own; `live` follows one log that holds its "
            "angles, too."
        )
    if said.temperature_files is not None:
        raise ValueError(
            f"{file}: [recordings] temperature_files logs the temperature apart; `live` follows one log that holds it, "
            "too."
        )
    by_table = table.columns.table_angles is not None or table.columns.table_rates is not None
    if table.table.delay and not by_table:
        raise ValueError(
            f"{file}: [table] delay moves references to other rows, which `live` cannot wait for; leave it out, or run "
            "`inertiax calibrate` of the whole log."
        )
    if said.format not in (None, "csv"):
        raise ValueError(
            f"{file}: [recordings] format = '{said.format}'; `live` follows delimited text (csv)."
        )
    if not piped and log is None:
        log = _named(file, said.files)
    name = "standard input" if log is None else log.name
    layout = Layout(
        names=said.names,
        start_row=said.start_row,
        header_line=said.header_line,
        gravity=table.site.gravity,
        latitude=settings.site.latitude,
        turntable=table.table,
    )
    return Plan(settings, TextRows(table.columns, layout, name), log, asked)


def _named(file: Path, patterns: tuple[str, ...]) -> Path:
    if len(patterns) == 1 and not any(c in patterns[0] for c in "*?["):
        return file.parent / patterns[0]
    raise ValueError(
        f"{file}: [recordings] files names no single log to follow; give it with --follow LOG, or - for standard "
        "input."
    )


def events(
    made: Plan,
    recorder: Recorder,
    *,
    idle: float,
    hold: float = HOLD,
    stopped: Callable[[], bool] = lambda: False,
    watch: Callable[[Event], None] | None = None,
) -> Iterator[Event]:
    """Events of a log until the target is reached, nothing gains, or the input ends.

    **Arguments:** `idle` is how long nothing may come before the input counts as ended, s; `hold` how long a rest lasts
    before the next position is told, s; `stopped` is asked at every piece whether the user wants to end; `watch` is
    given the `state` of the device, at most every `WATCHED` seconds.
    """
    session = Session(made.campaign, made.target, hold, made.itinerary)
    follower = _Follower(session, made, recorder)
    yield session.start_event()
    yield from session.first_step()
    watched = -np.inf
    for piece in follow(made.log, idle=idle):
        yield from follower.take(piece)
        if watch is not None:
            watched = _watched(session, watch, watched)
        if session.finished or stopped():
            break
    if not session.finished:
        yield from follower.last()
    yield from session.end()


def _watched(session: Session, watch: Callable[[Event], None], last: float) -> float:
    """Gives the state to `watch` where it is due; when it was given last, s of the machine's clock."""
    now = time.monotonic()
    if now - last < WATCHED:
        return last
    state = session.state()
    if state is not None:
        watch(state)
    return now


class _Follower:
    """Rows of each piece to the recorder and to the session."""

    def __init__(self, session: Session, made: Plan, recorder: Recorder):
        self._session, self._text, self._recorder = session, made.rows, recorder
        self._made = made
        self._order = StampOrder()
        self._waiting: Chunk | None = None  # rows whose place the next ones tell
        self._held = 0.0  # s, of the counter each time that it was full in this recording
        self._told: set[str] = set()  # what was said of lines that are put aside

    def take(self, piece: Piece) -> Iterator[Event]:
        """One piece of the log."""
        if piece.half:
            self._recorder.aside([piece.half])
        if piece.restarted:
            yield from self._rest_of_the_log()
            self._text, self._order, self._held = self._text.afresh(), StampOrder(), 0.0
            yield from self._session.leap(
                "the log was replaced or emptied; what comes now is another recording."
            )
        if piece.lines:
            yield from self._chunk(self._text.read(piece.lines))

    def last(self) -> Iterator[Event]:
        """The input ended: what still waits."""
        yield from self._chunk(self._text.read([], last=True))
        yield from self._rest_of_the_log()

    def _rest_of_the_log(self) -> Iterator[Event]:
        if self._waiting is not None:
            chunk, self._waiting = self._waiting, None
            yield from self._rows(chunk, end=True)

    def _chunk(self, chunk: Chunk | None) -> Iterator[Event]:
        if chunk is None:
            return
        header = self._text.take_header()
        if header is not None:
            self._recorder.begin(header)
            check_model_columns(self._made.campaign.model, (chunk.rows,))
        self._recorder.aside(chunk.skipped)
        yield from self._aside(
            "garbled",
            f"{len(chunk.garbled)} lines are no rows of this log; they are kept in left-out.txt.",
            chunk.garbled,
        )
        if chunk.lines:
            if self._waiting is not None:
                chunk, self._waiting = _joined(self._waiting, chunk), None
            yield from self._rows(chunk)

    def _rows(self, chunk: Chunk, *, end: bool = False) -> Iterator[Event]:
        """Runs of rows whose stamps go on."""
        before = self._order.last
        places = self._order.places(chunk.time, end=end)
        if len(places) < len(chunk.lines):
            self._waiting = _selected(chunk, np.arange(len(places), len(chunk.lines)))
        anew = [k for k, place in enumerate(places) if place in (Place.BEGINS, Place.FULL)]
        for a, b in zip([0, *anew], [*anew, len(places)]):
            if a == b:
                continue
            rows = {p: [k for k in range(a, b) if places[k] is p] for p in Place}
            if rows[Place.BEGINS]:
                assert before is not None
                self._held = 0.0
                yield from self._leap(before, float(chunk.time[a]))
            elif rows[Place.FULL]:
                self._held += self._order.counter
                self._recorder.mend()
            for place, said in _SAID.items():
                yield from self._aside("clock", said, [chunk.lines[k] for k in rows[place]])
            first = rows[Place.BEGINS] + rows[Place.FULL]
            kept = _selected(chunk, np.array(first + rows[Place.GOES_ON], int))
            if kept.lines:
                before = float(kept.time[-1])
                self._recorder.rows(kept.lines)
                yield from self._session.feed(kept.rows, kept.time + self._held)

    def _aside(self, kind: str, said: str, lines: list[bytes]) -> Iterator[Event]:
        """Lines that are put aside; of each sort it is said once."""
        self._recorder.aside(lines)
        sort = kind if kind == "garbled" else said
        if lines and sort not in self._told:
            self._told.add(sort)
            yield problem_event(kind, "warning", said)

    def _leap(self, before: float, after: float) -> Iterator[Event]:
        self._recorder.again()
        back = "back" if after < before else "forward"
        yield from self._session.leap(
            f"the clock went {back} from {before:.3f} s to {after:.3f} s; what comes now is another recording."
        )


_SAID = {
    Place.AGAIN: "a stamp stands twice; rows that repeat one are kept in left-out.txt.",
    Place.ASIDE: "a row is out of order: it came late, or its stamp is far from those of the rows beside it; such rows "
    "are kept in left-out.txt.",
}
_COLUMNS = (
    *("accel", "gyro", "temperature", "experiment", "position"),
    *("reference_accel", "reference_gyro"),
)


def _selected(chunk: Chunk, kept: Int[np.ndarray, " row"]) -> Chunk:
    """Some rows alone, without what was no row."""
    if not len(kept):
        return Chunk([], chunk.rows, np.zeros(0), [], [])
    rows = _recording(chunk.rows.name, lambda key: _picked(getattr(chunk.rows, key), kept))
    return Chunk([chunk.lines[k] for k in kept], rows, chunk.time[kept], [], [])


def _picked(value: np.ndarray | None, kept: Int[np.ndarray, " row"]) -> np.ndarray | None:
    return None if value is None else value[kept]


def _joined(first: Chunk, second: Chunk) -> Chunk:
    """Rows of two chunks, one behind the other."""

    def both(key: str) -> np.ndarray | None:
        a, b = getattr(first.rows, key), getattr(second.rows, key)
        return None if a is None or b is None else np.concatenate([a, b])

    rows = _recording(first.rows.name, both)
    time = np.append(first.time, second.time)
    return Chunk(first.lines + second.lines, rows, time, [], [])


def _recording(name: str, column: Callable[[str], np.ndarray | None]) -> Recording:
    made: dict[str, Any] = {key: column(key) for key in _COLUMNS}
    triad = next(x for x in (made["accel"], made["gyro"]) if x is not None)
    return Recording(np.arange(float(len(triad))), **made, name=name)
