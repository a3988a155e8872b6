"""How a fleet's recordings are split into tasks: each holds whole devices, and every device is in one.

A device may lie in several stretches of rows and in several files; only the serial numbers are read to
find out.
"""

import itertools
import math
import os
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import msgspec
import polars as pl

from ...data.formats import ColumnMap
from .locations import is_address, scan
from .serial_numbers import runs_of


ROWS = 2_000_000  # of a task, at least: about 200 MB; fewer cost a tenth more time
_SMALL_TASKS = 256  # at most: each is a file of the results
_STRETCHES = 64  # of one device; more means a file in which the devices alternate row by row


class Stretch(msgspec.Struct, frozen=True):
    """Consecutive rows of one file."""

    file: str
    start: int
    rows: int


class Task(msgspec.Struct, frozen=True):
    """Devices, each with its stretches in order; done and stored together."""

    number: int
    devices: tuple[tuple[str, tuple[Stretch, ...]], ...]

    @property
    def rows(self) -> int:
        """Samples to read."""
        return sum(s.rows for _, stretches in self.devices for s in stretches)


def split(files: Sequence[Path | str], columns: ColumnMap, *, rows: int = ROWS) -> tuple[Task, ...]:
    """Tasks of at least `rows` samples (the last may have fewer), devices in order of appearance.

    A file without a column for the device, and no `device=…` among its folders, is one device named after
    the file. Raises `ValueError` for a file in which devices alternate, naming it.
    """
    stretches: dict[str, list[Stretch]] = {}
    if columns.table_angles is not None:
        raise ValueError(
            "[columns] table_angles: devices in common files need columns reference_accel_x/y/z; angles are for a "
            "campaign.toml of each device."
        )
    for file, found in zip(files, _found(files, columns), strict=True):
        for device, stretch in found:
            stretches.setdefault(device, []).append(stretch)
        worst = max(stretches.values(), key=len, default=[])
        if len(worst) > _STRETCHES * len(files):
            raise ValueError(
                f"{file}: the rows of one device lie in {len(worst)} separate places; sort the file by "
                "device and time, so that each device's rows follow one another."
            )
    return tuple(_gather(stretches.items(), rows))


def _found(files: Sequence[Path | str], columns: ColumnMap) -> Iterator[list[tuple[str, Stretch]]]:
    """The stretches of each file, several files side by side: serial numbers are decoded by one core each."""
    with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
        try:
            yield from pool.map(lambda file: list(_stretches(file, columns)), files)
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def _gather(devices: Iterable[tuple[str, list[Stretch]]], rows: int) -> Iterable[Task]:
    numbers = itertools.count()
    waiting: list[tuple[str, tuple[Stretch, ...]]] = []
    filled = 0
    for name, stretches in devices:
        waiting.append((name, tuple(stretches)))
        filled += sum(s.rows for s in stretches)
        if filled >= rows:
            yield Task(next(numbers), tuple(waiting))
            waiting, filled = [], 0
    if waiting:
        yield Task(next(numbers), tuple(waiting))


def wherever_read(tasks: Iterable[Task]) -> tuple[Task, ...]:
    """The same with paths from the root: workers, and who goes on with a run, may be in another folder."""
    place = lambda file: file if is_address(file) else os.path.abspath(file)
    return tuple(
        Task(t.number, tuple((name, tuple(msgspec.structs.replace(s, file=place(s.file)) for s in mine))
                             for name, mine in t.devices))
        for t in tasks
    )  # fmt: skip


def apart(tasks: Iterable[Task]) -> tuple[Task, ...]:
    """The same devices in tasks of one each, of more where that would be too many: of devices that take a second."""
    devices = [d for t in tasks for d in t.devices]
    size = math.ceil(len(devices) / _SMALL_TASKS)
    starts = range(0, len(devices), max(size, 1))
    return tuple(Task(k, tuple(devices[s : s + size])) for k, s in enumerate(starts))


def device_of_folder(file: Path) -> str | None:
    """The serial number in a folder name such as `device=A100-7` (hive partitioning)."""
    return next((p[7:] for p in reversed(file.parts[:-1]) if p.startswith("device=")), None)


def _stretches(file: Path | str, columns: ColumnMap) -> Iterable[tuple[str, Stretch]]:
    rows = scan(str(file))
    names = rows.collect_schema().names()
    height = int(rows.select(pl.len()).collect().item())
    column = columns.label("device") or "device"
    if column not in names:
        if columns.label("device") is not None:
            raise ValueError(f"{file}: column '{column}' is missing; the file has {names}.")
        path = Path(file)
        yield device_of_folder(path) or path.stem, Stretch(str(file), 0, height)
        return
    for device, first, count in runs_of(str(file), column, height):
        device = device and device.strip()
        if not device:
            raise ValueError(
                f"{file}: column '{column}' is empty in row {first}; every row needs the serial number "
                "of its device."
            )
        yield device, Stretch(str(file), first, count)
