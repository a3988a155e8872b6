"""Progress on standard error: a live line on a terminal, plain lines elsewhere where asked for."""

import os
import sys
import threading
import time
from typing import TYPE_CHECKING

from ..report.terminal import Terminal
from ..storage.harmless_text import harmless, one_line


if TYPE_CHECKING:
    from rich.progress import Progress


_LONG = 2.0  # s; a stage shorter than this is not worth a line


def _unwatched(console: Terminal) -> bool:
    """Whether nobody waits for progress: it goes to a file or a pipe, and was not asked for."""
    return not console.is_terminal and not os.environ.get("INERTIAX_PROGRESS")


class Stages:
    """Called with a line of text where a stage begins; says how long the stages took.

    On a terminal the stage in progress is shown live with its elapsed time. Elsewhere nothing is said,
    or with INERTIAX_PROGRESS=1 a stage is told when it has lasted two seconds, and its time when it ends.
    `quiet` shows nothing.
    """

    def __init__(self, *, quiet: bool = False):
        self._console = Terminal(stderr=True, soft_wrap=True)
        self._quiet = quiet or _unwatched(self._console)
        self._live = None if quiet or not self._console.is_terminal else _live(self._console)
        self._timer: threading.Timer | None = None
        self._text: str | None = None
        self._start = 0.0

    def __enter__(self) -> "Stages":
        if self._live is not None:
            self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._end()
        if self._live is not None:
            self._live.stop()

    def __call__(self, text: str) -> None:
        self._end()
        text = one_line(text)  # may name a device
        self._text, self._start = text, time.monotonic()
        if self._quiet:
            return
        if self._live is not None:
            self._live.add_task(text, total=None)
            return
        self._timer = threading.Timer(_LONG, self.note, [f"{text} ..."])
        self._timer.daemon = True
        self._timer.start()

    def note(self, text: str) -> None:
        """A line that stays; nothing when quiet."""
        if not self._quiet:
            self._console.print(text)

    def _end(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
        if self._live is not None:
            for task in self._live.task_ids:
                self._live.remove_task(task)
        elapsed = time.monotonic() - self._start
        if self._text is not None and elapsed >= _LONG:
            self.note(f"{self._text}: {elapsed:.1f} s")
        self._text = None


def _live(console: Terminal) -> "Progress":
    from rich.progress import (
        Progress,
        SpinnerColumn,
        TextColumn,
        TimeElapsedColumn,
    )  # for terminals alone

    columns = (SpinnerColumn(), TextColumn("{task.description}", markup=False), TimeElapsedColumn())
    return Progress(*columns, console=console, transient=True)


class Counter:
    """Called with how much is done of how much: a bar with the time left on a terminal, else lines."""

    def __init__(self, what: str, *, quiet: bool = False):
        self._what = what
        self._console = Terminal(stderr=True, soft_wrap=True)
        self._quiet = quiet or _unwatched(self._console)
        self._bar = None if quiet or not self._console.is_terminal else _bar(self._console)
        self._told = time.monotonic()

    def __enter__(self) -> "Counter":
        if self._bar is not None:
            self._bar.start()
            self._bar.add_task(self._what, total=None)
        return self

    def __exit__(self, *_: object) -> None:
        if self._bar is not None:
            self._bar.stop()

    def __call__(self, done: int, total: int) -> None:
        if self._bar is not None:
            self._bar.update(self._bar.task_ids[0], completed=done, total=total)
        elif not self._quiet and time.monotonic() - self._told >= _LONG:
            self._told = time.monotonic()
            self._console.print(f"{self._what}: {done} of {total}")


def _bar(console: Terminal) -> "Progress":
    from rich.progress import (  # for terminals alone
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeRemainingColumn,
    )

    text = TextColumn("{task.description}", markup=False)
    count, left = MofNCompleteColumn(), TimeRemainingColumn(elapsed_when_finished=True)
    return Progress(text, BarColumn(), count, left, console=console, transient=True)


def say(text: str, *, aside: bool = False) -> None:
    """Lines on standard output, or with `aside` on standard error; what files say in them is made harmless."""
    print(harmless(text), file=sys.stderr if aside else sys.stdout)


def warn(text: str) -> None:
    """A line on standard error that is told even when quiet."""
    print(f"inertiax: {one_line(text)}", file=sys.stderr)
