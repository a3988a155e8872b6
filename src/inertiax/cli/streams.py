"""Standard output and standard error that take any text: no encoding stops a run, no file's text steers a terminal."""

import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any


# What `rich` writes: colours, the cursor up, a line cleared. Other sequences set titles and clipboards.
_OURS = re.compile(r"\x1b\[[0-9;?]*[A-Za-z]")


class AnyText:
    """A stream of text that lacks no character: those that its encoding has not are written as \\uXXXX.

    Characters that do not print become �. On a terminal colours and moves of the cursor pass; `Terminal` and
    `console.say` keep files' text free of them.
    """

    def __init__(self, stream: Any):  # what stands for a stream of text, in tests and notebooks too
        self._stream = stream
        self._terminal = stream.isatty()

    def write(self, text: str) -> int:
        """Write text, however it is encoded."""
        if not isinstance(text, str):  # how others ask whether a stream is one of text
            raise TypeError(f"a stream of text takes `str`; got {type(text).__name__}.")
        shown = _with_ours(text) if self._terminal else _printable(text)
        encoding = self._stream.encoding or "utf-8"
        self._stream.write(shown.encode(encoding, "backslashreplace").decode(encoding))
        return len(text)

    def __getattr__(self, name: str):
        return getattr(self._stream, name)


def _with_ours(text: str) -> str:
    pieces = _OURS.split(text)
    return "".join(
        _printable(p) + o for p, o in zip(pieces, [*_OURS.findall(text), ""], strict=True)
    )


def _printable(text: str) -> str:
    return "".join(c if c.isprintable() or c in "\n\t\r" else "�" for c in text)


@contextmanager
def any_text() -> Iterator[None]:
    """Standard output and standard error take any text while the block lasts."""
    before = sys.stdout, sys.stderr
    sys.stdout, sys.stderr = (AnyText(s) if s is not None else s for s in before)
    try:
        yield
    finally:
        sys.stdout, sys.stderr = before


def speaks_unicode(encoding: str | None) -> bool:
    """Whether an encoding has every character."""
    return (encoding or "").lower().replace("-", "").startswith(("utf8", "utf16", "utf32"))
