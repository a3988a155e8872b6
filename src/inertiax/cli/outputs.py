"""Result folders and files: owned by one run, written beside their place and renamed: nothing is half there.

A folder that exists stays: files that inertiax writes are replaced, others are left alone. A run that
fails leaves the folder as it was.
"""

import json
import os
import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager, ExitStack
from pathlib import Path

import msgspec
import typer

from ..storage.ownership import owned
from ..storage.whole_files import unfinished_folder, write_atomically
from .interrupts import held_back
from .streams import speaks_unicode


def require_folder(path: Path) -> Path:
    """Check that results can be written to a folder, before the work is done.

    Raises `typer.BadParameter` (status 2) where it is a file or cannot be written.
    """
    if path.exists() and not path.is_dir():
        raise typer.BadParameter(f"'{path}' is a file; a folder is needed.", param_hint="'-o'")
    _require_writable(path)
    return path


def require_file(path: Path) -> Path:
    """Check that a result file can be written, before the work is done; status 2 if not."""
    if path.is_dir():
        raise typer.BadParameter(f"'{path}' is a folder; a file is needed.", param_hint="'-o'")
    _require_writable(path.parent)
    return path


def _require_writable(folder: Path) -> None:
    nearest = next(p for p in (folder.absolute(), *folder.absolute().parents) if p.exists())
    if not nearest.is_dir() or not os.access(nearest, os.W_OK | os.X_OK):
        raise typer.BadParameter(
            f"'{nearest}' is not a folder that can be written to.", param_hint="'-o'"
        )


@contextmanager
def staged_folder(folder: Path, *, replaces: tuple[str, ...] = ()) -> Iterator[Path]:
    """A temporary folder whose content becomes that of `folder` when the block ends without error.

    **Arguments:** `replaces` are files of an earlier run to remove where this one did not write
    them again, so that no stale figure stands beside a new report.
    """
    folder = Path(os.path.realpath(folder))
    with ExitStack() as stack:
        stack.enter_context(owned_results(folder))
        home = folder if folder.exists() else folder.parent
        try:
            staging = stack.enter_context(unfinished_folder(home, folder.name))
        except OSError as error:
            raise _cannot_be_written(folder, error) from None
        yield staging
        with held_back():
            _move(staging, folder, replaces)


@contextmanager
def owned_results(path: Path) -> Iterator[None]:
    """No other run writes to a folder or file meanwhile; what a killed one left there is swept first.

    Raises `ValueError` where another run writes there now, and `typer.BadParameter` where nobody can.
    """
    with ExitStack() as stack:
        try:
            stack.enter_context(owned(path))
        except OSError as error:
            raise _cannot_be_written(path, error) from None
        yield


def _cannot_be_written(path: Path, error: OSError) -> typer.BadParameter:
    return typer.BadParameter(f"'{path}' cannot be written ({error.strerror}).", param_hint="'-o'")


def _move(staging: Path, folder: Path, replaces: tuple[str, ...]) -> None:
    if not folder.exists():
        staging.rename(folder)
        return
    written = sorted(p.relative_to(staging) for p in staging.rglob("*") if p.is_file())
    for name in written:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        os.replace(staging / name, folder / name)
    for name in replaces:
        if Path(name) not in written:
            (folder / name).unlink(missing_ok=True)


def folder_names(devices: tuple[str, ...]) -> dict[str, str]:
    """A folder name for each device: its serial number with only harmless characters, all different.

    Serial numbers are text from files, so nothing in them may lead out of the result folder.
    """
    names: dict[str, str] = {}
    taken: set[str] = set()
    for number, device in enumerate(devices, start=1):
        plain = re.sub(r"[^A-Za-z0-9._-]+", "_", device).strip("._-")[:60] or f"device-{number}"
        name = plain
        # Case does not tell names apart on every file system.
        while name.casefold() in taken:
            name = f"{plain}-{number}"
            plain = name
        taken.add(name.casefold())
        names[device] = name
    return names


def require_campaign(path: Path) -> Path:
    """A campaign is a folder with `campaign.toml` or that file; status 2 for anything else."""
    if path.is_dir() and not (path / "campaign.toml").is_file():
        raise typer.BadParameter(f"'{path}' holds no campaign.toml.", param_hint="'CAMPAIGN'")
    return path


def write_json(path: Path, content: object) -> None:
    """Write a document that people may read, too."""
    write_atomically(path, msgspec.json.format(msgspec.json.encode(content), indent=1) + b"\n")


def print_json(content: object) -> None:
    """One JSON document on standard output; numbers that are not finite become null."""
    print_document(msgspec.json.format(msgspec.json.encode(content), indent=1).decode())


def print_document(text: str) -> None:
    """JSON as it stands in a file; in ASCII where standard output has not every character."""
    if not speaks_unicode(sys.stdout.encoding):
        text = "".join(c if c.isascii() else json.dumps(c)[1:-1] for c in text)
    print(text.removesuffix("\n"))
