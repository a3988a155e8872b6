"""From the bytes of a log to the events of a session, with everything recorded beside."""

import dataclasses
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from jaxtyping import Int

from ..data.campaign import load_settings
from ..data.formats import Layout
from ..data.model_columns import check_model_columns
from ..data.recording import Campaign, Recording
from .events import Event, problem_event
from .itinerary import Itinerary
from .recorder import LEAP, Recorder
from .row_sources import follow, Piece
from .session import HOLD, Session
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
        self._stamp: float | None = None  # of the last row, s
        self._garbled = self._repeated = 0

    def take(self, piece: Piece) -> Iterator[Event]:
        """One piece of the log."""
        if piece.half:
            self._recorder.aside([piece.half])
        if piece.restarted:
            self._text = self._text.afresh()
            self._stamp = None
            yield from self._session.leap(
                "the log was replaced or emptied; what comes now is another recording."
            )
        if piece.lines:
            yield from self._chunk(self._text.read(piece.lines))

    def last(self) -> Iterator[Event]:
        """The input ended: what still waits."""
        yield from self._chunk(self._text.read([], last=True))

    def _chunk(self, chunk: Chunk | None) -> Iterator[Event]:
        if chunk is None:
            return
        header = self._text.take_header()
        if header is not None:
            self._recorder.begin(header)
            check_model_columns(self._made.campaign.model, (chunk.rows,))
        self._recorder.aside(chunk.skipped)
        if chunk.garbled:
            self._recorder.aside(chunk.garbled)
            self._garbled += len(chunk.garbled)
            if self._garbled == len(chunk.garbled):
                yield problem_event(
                    "garbled",
                    "warning",
                    f"{len(chunk.garbled)} lines are no rows of this log; they are kept in left-out.txt.",
                )
        if chunk.lines:
            yield from self._rows(chunk)

    def _rows(self, chunk: Chunk) -> Iterator[Event]:
        """Runs of rows whose stamps go on."""
        time = chunk.time
        before = np.append(time[0] if self._stamp is None else self._stamp, time[:-1])
        steps = time - before
        again = steps == 0.0
        if self._stamp is None:
            again[0] = False
        leaps = np.flatnonzero((steps < 0.0) | (steps > LEAP))
        for a, b in zip([0, *leaps], [*leaps, len(time)]):
            if a == b:
                continue
            if a in leaps:
                yield from self._leap(float(before[a]), float(time[a]))
            kept = np.arange(a, b)[~again[a:b]]
            if len(kept) < b - a:
                yield from self._again([chunk.lines[k] for k in range(a, b) if again[k]])
            if len(kept):
                self._recorder.rows([chunk.lines[k] for k in kept])
                yield from self._session.feed(_selected(chunk.rows, kept), time[kept])
        self._stamp = float(time[-1])

    def _again(self, lines: list[bytes]) -> Iterator[Event]:
        """Rows that repeat the stamp before."""
        self._recorder.aside(lines)
        if not self._repeated:
            yield problem_event(
                "clock",
                "warning",
                "a stamp stands twice; rows that repeat one are kept in left-out.txt.",
            )
        self._repeated += len(lines)

    def _leap(self, before: float, after: float) -> Iterator[Event]:
        self._recorder.again()
        back = "back" if after < before else "forward"
        yield from self._session.leap(
            f"the clock went {back} from {before:.3f} s to {after:.3f} s; what comes now is another recording."
        )


_COLUMNS = (
    *("time", "accel", "gyro", "temperature", "experiment", "position"),
    *("reference_accel", "reference_gyro"),
)


def _selected(rows: Recording, kept: Int[np.ndarray, " row"]) -> Recording:
    made = {}
    for key in _COLUMNS:
        value = getattr(rows, key)
        made[key] = None if value is None else value[kept]
    return Recording(**made, name=rows.name)
