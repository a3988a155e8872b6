"""Files that are there whole or not at all: written beside their place and renamed.

What is not finished has a name that begins with `.inertiax-`, so that the next run can sweep what one that was
killed left behind.
"""

import itertools
import os
import shutil
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path


MARK = ".inertiax-"
_LONGEST = 100  # characters of a file's name inside that of the unfinished one; file systems take 255 bytes

_SCRATCH = f"{MARK}scratch~"

_unfinished: set[Path] = set()
_numbers = itertools.count()


def unfinished_name(path: Path) -> str:
    """How the names of unfinished forms of a file or folder begin."""
    return f"{MARK}{path.name[-_LONGEST:]}~"


@contextmanager
def written_beside(path: Path, *, durable: bool = True) -> Iterator[Path]:
    """A place beside `path` for a file that takes its name when the block ends without error.

    The place's name is of this process and call alone. The file gets the permissions of the user's other files and,
    if it is to be `durable`, is on the disk before it is renamed.
    """
    beside = _register(path)
    try:
        yield beside
        beside.chmod(file_mode())
        if durable:
            with beside.open("rb+") as stream:
                os.fsync(stream.fileno())
        os.replace(beside, path)
    finally:
        beside.unlink(missing_ok=True)
        _unfinished.discard(beside)


def write_atomically(path: Path, content: bytes, *, durable: bool = True) -> None:
    """Write a file, and the folders above it: whole or not at all. One that is not `durable`, since it can be made
    again, may be lost where the power fails a moment later."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    with written_beside(path, durable=durable) as beside:
        beside.write_bytes(content)


@contextmanager
def unfinished_folder(home: Path, name: str) -> Iterator[Path]:
    """A new folder in `home` that is gone when the block ends, unless it was renamed."""
    place = _register(home / name)
    try:
        place.mkdir()
        yield place
    finally:
        shutil.rmtree(place, ignore_errors=True)
        _unfinished.discard(place)


@contextmanager
def scratch_folder() -> Iterator[Path]:
    """A new folder among the system's temporary files, for this user only, that is gone when the block ends.

    A signal's handler removes it with what else is unfinished; those of processes that were killed are swept here.
    """
    _sweep_scratch()
    place = Path(tempfile.mkdtemp(prefix=f"{_SCRATCH}{os.getpid()}-"))
    _unfinished.add(place)
    try:
        yield place
    finally:
        shutil.rmtree(place, ignore_errors=True)
        _unfinished.discard(place)


def _sweep_scratch() -> None:
    if os.name != "posix":  # elsewhere there is no harmless question whether a process lives
        return
    for left in Path(tempfile.gettempdir()).glob(f"{_SCRATCH}*"):
        process = left.name.removeprefix(_SCRATCH).partition("-")[0]
        with suppress(OSError, ValueError):
            if left.lstat().st_uid == os.getuid() and not _lives(int(process)):
                _remove(left)


def _lives(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        pass
    return True


def _register(path: Path) -> Path:
    mine = f"{os.getpid()}-{threading.get_ident()}-{next(_numbers)}"
    place = path.with_name(f"{unfinished_name(path)}{mine}")
    _unfinished.add(place)
    return place


def file_mode() -> int:
    """Permissions of a new file, by the user's own rules."""
    return 0o666 & ~umask()


def umask() -> int:
    """What the user's rules take away from permissions."""
    current = os.umask(0)
    os.umask(current)
    return current


def sweep_own() -> None:
    """Remove what this process has not finished; for a process that is about to end."""
    for place in tuple(_unfinished):
        _remove(place)


def sweep(home: Path, begin: str = MARK) -> None:
    """Remove unfinished files and folders whose names begin so.

    Only for who owns the results there (see `owned`): what another run is writing would go, too.
    """
    assert begin.startswith(MARK)
    with suppress(OSError):  # a folder that cannot be listed holds nothing of ours
        for entry in os.scandir(home):
            if entry.name.startswith(begin) and not entry.name.endswith(".lock"):
                _remove(home / entry.name)


def _remove(place: Path) -> None:
    with suppress(OSError):
        if place.is_dir() and not place.is_symlink():
            shutil.rmtree(place, ignore_errors=True)
        else:
            place.unlink(missing_ok=True)
