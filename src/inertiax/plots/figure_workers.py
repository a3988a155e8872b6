"""Figures as they are asked for, and who draws them: this process, or others while it goes on.

matplotlib takes half a second to import, and a figure a tenth or two as SVG and as PNG each, which is most of what a
report takes. A command that will draw has processes get ready meanwhile (`drawn_aside`), which know matplotlib and
nothing of calibrations; its own never imports matplotlib then.
"""

import importlib
import os
import pickle
import queue
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from typing import Any, Generic, IO, NamedTuple, TypeVar

from .style import drawing, Figure


Form = TypeVar("Form")
_SERVE = "import sys; sys.path[:] = {!r}; from {} import serve; serve({})"
_BACKENDS = ("matplotlib.backends.backend_svg", "matplotlib.backends.backend_agg")
_DEATHS = (OSError, EOFError, pickle.UnpicklingError)

_workers: "_Workers | None" = None


class Drawing(Generic[Form]):
    """A figure to be drawn and brought into a form, such as `style.both_forms`.

    **Arguments:** `draw(*given)` makes the figure. To be drawn by another process, `form` and `draw` are functions of
    modules that need nothing but this folder, and `given` are plain numbers and text.
    """

    def __init__(self, form: Callable[[Figure], Form], draw: Callable[..., Figure], *given: Any):
        self._task = (form, draw, given)

    def begin(self) -> Callable[[], Form]:
        """Have it drawn; what is returned gives the result, and waits for it."""
        if _workers is None:
            made = _draw(*self._task)
            return lambda: made
        return _workers.begin(self._task)

    def begin_ahead(self) -> None:
        """Have it drawn by another process, where there is one, before it is asked for: `begin` of a figure of the same
        numbers finds it."""
        if _workers is not None:
            _workers.begin(self._task)


def _draw(
    form: Callable[[Figure], Form], draw: Callable[..., Figure], given: Sequence[Any]
) -> Form:
    with drawing():
        return form(draw(*given))


@contextmanager
def drawn_aside(module: str, *, several: bool) -> Iterator[None]:
    """Have figures drawn by other processes while the block lasts, where there is a processor for them.

    **Arguments:** `module` is what draws; it is imported at once. `several` figures are drawn two at a time.
    """
    global _workers
    if (os.cpu_count() or 1) < 2 or not sys.executable or _workers is not None:
        yield
        return
    with suppress(OSError):  # no more processes: this one draws
        _workers = _Workers(module, several)
    try:
        yield
    finally:
        ended, _workers = _workers, None
        if ended is not None:
            ended.end()


class _Pipes(NamedTuple):
    """To a worker and back."""

    tasks: IO[Any]
    results: IO[Any]


class _Workers:
    """Processes that are spoken to through pipes. They end with this one, whose end closes the pipes."""

    def __init__(self, module: str, several: bool):
        self._process, self._pipes = _started(module, several)
        self._free: queue.SimpleQueue[_Pipes] = queue.SimpleQueue()
        for worker in self._pipes:
            self._free.put(worker)
        self._threads = ThreadPoolExecutor(len(self._pipes))
        self._begun: dict[bytes, Future[Any]] = {}

    def begin(self, task: tuple[Any, ...]) -> Callable[[], Any]:
        sent = pickle.dumps(task, pickle.HIGHEST_PROTOCOL)
        future = self._begun.get(sent)
        if future is None:
            future = self._begun[sent] = self._threads.submit(self._ask, sent)

        def result() -> Any:
            try:
                return future.result()
            except _DEATHS:  # of the worker: this process draws
                return _draw(*task)

        return result

    def _ask(self, sent: bytes) -> Any:
        worker = self._free.get()
        try:
            worker.tasks.write(sent)
            worker.tasks.flush()
            error, made = pickle.load(worker.results)
        finally:
            self._free.put(worker)
        if error is not None:
            raise error
        return made

    def end(self) -> None:
        self._process.kill()
        self._process.wait()
        self._threads.shutdown(wait=False, cancel_futures=True)
        for pipe in (pipe for worker in self._pipes for pipe in worker):
            with suppress(OSError):  # one that died no longer reads
                pipe.close()


def _started(module: str, several: bool) -> "tuple[subprocess.Popen[bytes], list[_Pipes]]":
    """A worker, and for `several` figures, where the system can fork, a twin of it, which need not import all again."""
    twin = [*os.pipe(), *os.pipe()] if several and hasattr(os, "fork") else []
    theirs, ours = tuple(twin[0::3]), tuple(twin[1:3])
    call = _SERVE.format(sys.path, __name__, ", ".join(map(str, theirs)))
    process = subprocess.Popen(
        [sys.executable, "-c", call],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,  # what went wrong is told by the process that asked
        pass_fds=theirs,
    )
    assert process.stdin is not None and process.stdout is not None
    pipes = [_Pipes(process.stdin, process.stdout)]
    for end in theirs:
        os.close(end)
    if ours:
        pipes.append(_Pipes(os.fdopen(ours[0], "wb"), os.fdopen(ours[1], "rb")))
    pickle.dump(module, process.stdin)
    process.stdin.flush()
    return process, pipes


def serve(*twin: int) -> None:
    """What a worker does until its input ends: tasks from standard input, results to standard output.

    **Arguments:** `twin` are the ends of the pipes through which a twin of it gets and gives them.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the affair of the process that asks
    tasks, results = sys.stdin.buffer, os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what a library prints is no result
    for module in (pickle.load(tasks), *_BACKENDS):
        importlib.import_module(module)
    # Each closes what is the other's, or the end of one would not be seen.
    if twin and os.fork() == 0:
        os.close(0)
        results.close()
        tasks, results = os.fdopen(twin[0], "rb"), os.fdopen(twin[1], "wb")
    else:
        for end in twin:
            os.close(end)
    while True:
        try:
            task = pickle.load(tasks)
        except EOFError:
            return
        try:
            answer = None, _draw(*task)
        except Exception as error:
            answer = error, None
        pickle.dump(answer, results, pickle.HIGHEST_PROTOCOL)
        results.flush()
