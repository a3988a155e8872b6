"""Bytes of a log as they are written: of a file that grows, of standard input, of a serial line that is a file.

Each source gives whole lines; half a line at the end waits for the rest of it.
"""

import contextlib
import os
import select
import stat
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple


READ = 1 << 16  # bytes at once
WAIT = 0.05  # s, between two looks at a file that does not grow
GATHER = 0.1  # s of rows that are taken together: each piece costs some milliseconds, however short
_LONGEST_LINE = 1 << 20  # bytes; what has no line feed for so long is no delimited text


class Piece(NamedTuple):
    """What a look at a source gave."""

    lines: list[bytes]  # whole lines without line feeds
    restarted: bool = False  # the file was replaced or emptied: the next lines are of another log
    half: bytes = b""  # what never became a line, at the end of a log


class Lines:
    """Cuts bytes into lines; keeps the half line at the end."""

    def __init__(self) -> None:
        self.half = b""

    def of(self, data: bytes) -> list[bytes]:
        """Lines that the further bytes complete. Raises `ValueError` where no line ends."""
        whole, feed, rest = (self.half + data).rpartition(b"\n")
        self.half = rest
        if len(rest) > _LONGEST_LINE:
            raise ValueError(f"the log: no end of a line in {len(rest)} bytes; it is no text.")
        lines = whole.split(b"\n") if feed else []
        return [x.rstrip(b"\r").replace(b"\0", b"") for x in lines]


def follow(path: Path | None, *, idle: float) -> Iterator[Piece]:
    """Lines of a log until its input ends: none for `idle` seconds, or the other end is closed.

    **Arguments:** `path` is a file (waited for where it is not there yet), a serial line or a pipe; `None` is standard
    input. A piece without lines comes at least every `WAIT` seconds, so that whoever listens can look at the clock.

    Raises `ValueError` for what is no file on Windows, whose pipes cannot be waited for.
    """
    if path is not None and (not path.exists() or stat.S_ISREG(path.stat().st_mode)):
        yield from _file(path, idle)
        return
    if os.name == "nt":
        raise ValueError(
            "live: Windows cannot wait for a pipe or a serial line; have the rows written to a file, and follow that."
        )
    handle = 0 if path is None else os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_NOCTTY)
    try:
        # A file as standard input is always ready: its end is the end of the input.
        yield from _stream(handle, idle)
    finally:
        if path is not None:
            os.close(handle)


class _Silence:
    """How long nothing came; what the listener takes for its own work does not count."""

    def __init__(self, longest: float):
        self._longest, self._since = longest, None

    def heard(self) -> None:
        """Something came."""
        self._since = None

    def lasts(self) -> bool:
        """Nothing came; whether it is for longer than asked."""
        now = time.monotonic()
        self._since = now if self._since is None else self._since
        return now - self._since >= self._longest


def _stream(handle: int, idle: float) -> Iterator[Piece]:
    lines, silence = Lines(), _Silence(idle)
    while True:
        ready, _, _ = select.select([handle], [], [], WAIT)
        if not ready:
            if silence.lasts():
                break
            yield Piece([])
            continue
        try:
            data = os.read(handle, READ)
        except BlockingIOError:
            continue
        except OSError:  # a serial line that was unplugged
            break
        if not data:
            break
        silence.heard()
        yield Piece(lines.of(data))
        if len(data) < READ // 2:
            time.sleep(GATHER)
    yield Piece([], half=lines.half)


def _file(path: Path, idle: float) -> Iterator[Piece]:
    lines, silence, position = Lines(), _Silence(idle), 0
    handle = None
    try:
        while True:
            if handle is None:
                with contextlib.suppress(FileNotFoundError):
                    handle = path.open("rb", buffering=0)
            data = b"" if handle is None else handle.read(READ)
            if data:
                silence.heard()
                position += len(data)
                yield Piece(lines.of(data))
                if len(data) < READ // 2:
                    time.sleep(GATHER)
            elif handle is not None and _replaced(path, handle.fileno(), position):
                handle.close()
                half, handle, position, lines = lines.half, None, 0, Lines()
                yield Piece([], restarted=True, half=half)
            elif silence.lasts():
                break
            else:
                time.sleep(WAIT)
                yield Piece([])
        yield Piece([], half=lines.half)
    finally:
        if handle is not None:
            handle.close()


def _replaced(path: Path, handle: int, position: int) -> bool:
    """Whether the file at this path is another one than was opened, or shorter than what was read of it."""
    mine = os.fstat(handle)
    try:
        now = path.stat()
    except OSError:
        return False
    return (now.st_dev, now.st_ino) != (mine.st_dev, mine.st_ino) or now.st_size < position
