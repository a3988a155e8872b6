"""One owner of a results folder or file: the second of two runs is refused in a line, and does not wait.

The owner holds the system's lock on a small file beside its results, `.inertiax-NAME.lock`. Such a lock ends with
the process, however it ends, so one that was killed shuts nobody out. Folders themselves are never locked: whoever
started us may hold the lock of one (`flock DIR inertiax …`).

Windows has locks of another kind, which do the same here; there a file that is open cannot be removed, so the lock's
file goes when it is closed. Some network file systems have no locks: there nobody is refused.
"""

import os
import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager, ExitStack, suppress
from pathlib import Path

from .whole_files import MARK, sweep, unfinished_name


PATIENCE = 2.0  # s; what a process that was just ended takes to be gone
_LOOK = 0.05  # s between attempts

_held: set[Path] = set()  # locks of this process


@contextmanager
def owned(results: Path) -> Iterator[None]:
    """Own a results folder or file while the block lasts, and sweep first what a killed run left there.

    Folders above it are made; those that stay empty are removed again. A block inside another of the same
    results is part of it. Raises `ValueError` where another run owns them.
    """
    results = Path(os.path.realpath(results))
    lock = _lock_of(results)
    if lock in _held:
        yield
        return
    with ExitStack() as stack:
        stack.enter_context(_folders_above(results))
        stack.enter_context(_locked(lock, results))
        sweep(results.parent, unfinished_name(results))
        _sweep_inside(results)
        _sweep_locks(results.parent)
        yield


def _sweep_inside(results: Path) -> None:
    if results.is_dir():
        for folder in (results, *(p for p in results.iterdir() if p.is_dir())):
            sweep(folder)


def _sweep_locks(folder: Path) -> None:
    """Remove locks that nobody holds: of runs that were killed and whose results have another name than ours."""
    with suppress(OSError):
        for lock in folder.glob(f"{MARK}*.lock"):
            if lock in _held or (handle := _attempt(lock)) is None:
                continue
            # Whoever has opened it meanwhile sees that it is gone, and makes another one (`_attempt`).
            try:
                lock.unlink(missing_ok=True)
            finally:
                os.close(handle)


def release_all() -> None:
    """Remove the files of all locks that are held; for a process that is about to end."""
    for lock in tuple(_held):
        with suppress(OSError):
            lock.unlink()


def _lock_of(results: Path) -> Path:
    """Beside the results, where that can be written, else inside them; always the same for the same results."""
    if results.is_dir() and not os.access(results.parent, os.W_OK | os.X_OK):
        return results / f"{MARK}{results.name[-100:]}.lock"
    return results.with_name(f"{MARK}{results.name[-100:]}.lock")


@contextmanager
def _folders_above(results: Path) -> Iterator[None]:
    missing = [p for p in results.parents if not p.exists()]
    results.parent.mkdir(parents=True, exist_ok=True)
    try:
        yield
    finally:
        for folder in missing:  # the innermost first
            with suppress(OSError):
                folder.rmdir()


@contextmanager
def _locked(lock: Path, results: Path) -> Iterator[None]:
    end = time.monotonic() + PATIENCE
    while (handle := _attempt(lock)) is None:
        if time.monotonic() > end:
            raise ValueError(
                f"{results}: another run{_owner(lock)} writes there; let it end, or choose another place with -o."
            )
        time.sleep(_LOOK)
    _held.add(lock)
    try:
        os.ftruncate(handle, 0)
        os.write(handle, f"{os.getpid()} {socket.gethostname()}\n".encode())
        yield
    finally:
        with suppress(OSError):
            lock.unlink()
        os.close(handle)
        with suppress(OSError):
            if os.name == "nt":
                lock.unlink()
        _held.discard(lock)


def _attempt(lock: Path) -> int | None:
    """The open file of the lock, or `None` where another process has it."""
    handle = os.open(lock, os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0), 0o644)
    try:
        if not _lock(handle):
            os.close(handle)
            return None
        # The owner before us may have removed the file between our opening and our locking it.
        if os.path.samestat(os.stat(lock), os.fstat(handle)):
            return handle
    except OSError:
        pass
    os.close(handle)
    return None


def _lock(handle: int) -> bool:
    """Whether the lock is ours now; also where the file system has none."""
    try:
        import fcntl
    except ImportError:
        return _lock_on_windows(handle)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:  # ENOLCK, ENOTSUP: no locks here
        return True
    return True


def _lock_on_windows(handle: int) -> bool:
    import msvcrt

    # A byte far beyond the text, which others may read.
    os.lseek(handle, 4096, os.SEEK_SET)
    try:
        msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)  # pyright: ignore[reportAttributeAccessIssue]
    except OSError:
        return False
    finally:
        os.lseek(handle, 0, os.SEEK_SET)
    return True


def _owner(lock: Path) -> str:
    """In words, who holds a lock, as far as it says so."""
    with suppress(OSError, ValueError):
        process, host = lock.read_text("utf-8")[:200].split()
        return f" (process {int(process)} on {host if host.isprintable() else '?'})"
    return ""
