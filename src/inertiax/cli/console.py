"""Progress on standard error: a live line on a terminal, plain lines elsewhere."""

import sys
import threading
import time
from types import TracebackType

from rich.console import Console
from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn


_LONG = 2.0  # s; a stage shorter than this is not worth a line


class Stages:
    """Called with a line of text where a stage begins; says how long the stages took.

    On a terminal the stage in progress is shown live with its elapsed time. Otherwise a stage is
    told when it has lasted two seconds, and its time when it ends. `quiet` shows nothing.
    """

    def __init__(self, *, quiet: bool = False):
        self._quiet = quiet
        self._console = Console(stderr=True, highlight=False, markup=False, soft_wrap=True)
        self._live = None if quiet or not self._console.is_terminal else _live(self._console)
        self._timer: threading.Timer | None = None
        self._text: str | None = None
        self._start = 0.0

    def __enter__(self) -> "Stages":
        if self._live is not None:
            self._live.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._end()
        if self._live is not None:
            self._live.stop()

    def __call__(self, text: str) -> None:
        self._end()
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


def _live(console: Console) -> Progress:
    columns = (SpinnerColumn(), TextColumn("{task.description}", markup=False), TimeElapsedColumn())
    return Progress(*columns, console=console, transient=True)


def warn(text: str) -> None:
    """A line on standard error that is told even when quiet."""
    print(f"inertiax: {text}", file=sys.stderr)
