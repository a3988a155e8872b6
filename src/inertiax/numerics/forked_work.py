"""Work that a twin of this process does while it goes on.

NumPy's many small products keep the interpreter's lock, so that threads gain nothing there. A twin (`fork`) has all
that this process has, functions that no pickle takes among it, and needs not start. What comes back is pickled; what
both had before is named by its number instead.
"""

import ctypes
import io
import os
import pickle
import select
import signal
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterable
from contextlib import suppress
from typing import Any, Generic, TypeVar


_T = TypeVar("_T")
Say = Callable[[str], None]
PATIENCE = 20.0  # times as long as this process has worked, after which a silent twin is given up
LEAST = 60.0  # s of patience, at least
_SIGNAL_AT_PARENTS_END = 1  # PR_SET_PDEATHSIG of prctl(2), of Linux
_LENGTH = 8  # bytes that say how long a message is


def can_fork() -> bool:
    """Whether a twin is safe and gains something: on Linux with a processor for it, where JAX, whose threads a twin
    lacks, is not loaded."""
    return (
        sys.platform == "linux"
        and len(os.sched_getaffinity(0)) > 1
        and "jax" not in sys.modules
        and threading.current_thread() is threading.main_thread()
    )


class ForkedWork(Generic[_T]):
    """`work(say)`, begun in a twin of this process.

    **Arguments:** `work` gets a function for its messages; `known` are objects that the answer may hold as they are.

    ```python
    aside = ForkedWork(lambda say: slow(second, say), known=[second])
    a, b = slow(first, print), aside.result(print)
    ```
    """

    def __init__(self, work: Callable[[Say], _T], known: Iterable[Any] = ()):
        self._work, self._known = work, list(known)
        self._began = time.monotonic()
        self._pipe, write = os.pipe()
        with warnings.catch_warnings():
            # Python warns of threads. Those here are of libraries that the work does not use.
            warnings.simplefilter("ignore", DeprecationWarning)
            self._child = os.fork()
        if self._child == 0:
            os.close(self._pipe)
            _serve(work, self._known, write)
        os.close(write)

    def result(self, say: Say) -> _T:
        """What the twin found, or, where it died or its answer cannot be sent, what this process finds itself.

        **Arguments:** `say` is told the twin's messages. Raises what `work` raises.
        """
        try:
            answer = self._read(say)
        finally:
            self.end()
        return self._work(say) if answer is None else answer[0]

    def end(self) -> None:
        """End the twin, whether its answer was read or not; again without effect."""
        if not self._child:
            return
        with suppress(OSError):
            os.kill(self._child, 9)
        with suppress(OSError):
            os.waitpid(self._child, 0)
        self._child = 0
        os.close(self._pipe)

    def _read(self, say: Say) -> tuple[_T] | None:
        """The answer; nothing where there is none."""
        patience = max(LEAST, PATIENCE * (time.monotonic() - self._began))
        while True:
            head = self._bytes(_LENGTH, patience)
            message = head and self._bytes(int.from_bytes(head, "big"), patience)
            if not message:
                return None
            kind, value = _Reader(io.BytesIO(message), self._known).load()
            if kind == "answer":
                return (value,)
            say(value)

    def _bytes(self, number: int, patience: float) -> bytes | None:
        """That many of them from the twin; nothing where it has ended or says nothing."""
        made = bytearray()
        while len(made) < number:
            ready, _, _ = select.select([self._pipe], [], [], patience)
            piece = os.read(self._pipe, min(number - len(made), 1 << 20)) if ready else b""
            if not piece:
                return None
            made += piece
        return bytes(made)


def _serve(work: Callable[[Say], Any], known: list[Any], pipe: int) -> None:
    """What the twin does: the work, whose answer it sends. An error is left to the other one, which meets it too."""
    for one in (signal.SIGINT, signal.SIGTERM):  # whose handlers are the affair of the other one
        signal.signal(one, signal.SIG_DFL)
    with suppress(
        OSError, AttributeError
    ):  # nobody would hear it after the other one's end, however that came
        ctypes.CDLL(None).prctl(_SIGNAL_AT_PARENTS_END, signal.SIGKILL)
    with suppress(BaseException):
        answer = work(lambda text: _send(pipe, ("say", text), known))
        _send(pipe, ("answer", answer), known)
    os._exit(0)  # nothing that this process would do at its end


def _send(pipe: int, message: tuple[str, Any], known: list[Any]) -> None:
    buffer = io.BytesIO()
    _Writer(buffer, known).dump(message)
    sent = memoryview(len(buffer.getbuffer()).to_bytes(_LENGTH, "big") + buffer.getvalue())
    while sent:
        sent = sent[os.write(pipe, sent) :]


class _Writer(pickle.Pickler):
    """Names what both processes know by its place."""

    def __init__(self, file: io.BytesIO, known: list[Any]):
        super().__init__(file, pickle.HIGHEST_PROTOCOL)
        self._places = {id(one): place for place, one in enumerate(known)}

    def persistent_id(self, obj: Any) -> int | None:
        return self._places.get(id(obj))


class _Reader(pickle.Unpickler):
    """Finds what both processes know by its place."""

    def __init__(self, file: io.BytesIO, known: list[Any]):
        super().__init__(file)
        self._known = known

    def persistent_load(self, pid: int) -> Any:
        return self._known[pid]
