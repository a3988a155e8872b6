"""Ends by a signal: one line, the exit status that a shell expects, and nothing left behind.

The process ends inside the handler. An exception, thrown into the midst of a callback, of a thread pool or of C++
code, would arrive late, in other words or not at all. Whatever had its final name is whole, as after a kill.
"""

import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from types import FrameType

from ..storage.ownership import release_all
from ..storage.whole_files import sweep_own


# What a terminal, an operator or a service manager sends; those that the system lacks are left out.
WORDS = {"SIGINT": "interrupted", "SIGTERM": "terminated", "SIGHUP": "the terminal is gone"}
_SHOW_CURSOR = "\x1b[?25h"  # a live line hides it

_held_back: list[int] = []  # depth of `held_back`
_waiting: list[int] = []  # signals that came meanwhile


@contextmanager
def handled() -> Iterator[None]:
    """Signals end the process cleanly while the block lasts; those that are ignored (`nohup`) stay so."""
    before = {}
    if threading.current_thread() is threading.main_thread():
        for number in _numbers():
            if signal.getsignal(number) in (signal.SIG_DFL, signal.default_int_handler):
                before[number] = signal.signal(number, _arrived)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def held_back() -> Iterator[None]:
    """A signal waits until the block ends: for steps that belong together and take no time."""
    _held_back.append(1)
    try:
        yield
    finally:
        _held_back.pop()
        if _waiting and not _held_back:
            end(_waiting[0])


def _numbers() -> Iterator[int]:
    for name in WORDS:
        number = getattr(signal, name, None)
        if number is not None:
            yield number


def _arrived(number: int, frame: FrameType | None) -> None:
    del frame
    if _held_back:
        _waiting.append(number)
    else:
        end(number)


def end(number: int) -> None:
    """Sweep, say it in one line and leave; status 130 after Ctrl-C."""
    for child in multiprocessing.active_children():
        child.kill()
    sweep_own()
    release_all()
    cursor = _SHOW_CURSOR if sys.stderr.isatty() else ""
    words = WORDS.get(signal.Signals(number).name, "ended")
    with suppress(OSError, ValueError):
        os.write(2, f"{cursor}inertiax: {words}.\n".encode())
    os._exit(128 + number)
