"""Tasks of a fleet run, done side by side, and the programs that they need, compiled ahead."""

import functools
import os
from collections.abc import Iterator, Sequence
from concurrent.futures import as_completed, ThreadPoolExecutor
from pathlib import Path

import equinox as eqx
import jax
import msgspec

from ..data.formats import ColumnMap
from ..data.recording import Campaign, Site
from .cluster import on_dask, on_processes
from .line_plausibility import with_causes
from .model_choice import Reader
from .one_by_one import calibrate_one_by_one, Devices, devices_of
from .reduce.campaign_folders import read_campaigns
from .reduce.raw_rows import read
from .reduce.tasks import Task
from .rows import calibrate_reduced
from .store import Manifest, write_part


# Devices that compile ahead: as many as fill the smallest shape of the programs over temperature.
AHEAD = 16


def reader_of(campaigns: bool, columns: ColumnMap, exact: bool, force: bool = False) -> Reader:
    """What turns a task into dwells; with `force` those of data that cannot be right too."""
    if campaigns:
        return functools.partial(read_campaigns, force=force)
    return functools.partial(read, columns=columns, exact=exact, force=force)


class Context(eqx.Module):
    """What every task needs beside its own rows."""

    manifest: Manifest = eqx.field(static=True)
    columns: ColumnMap = eqx.field(static=True)
    folder: str = eqx.field(static=True)


def _reader_of(context: Context) -> Reader:
    manifest = context.manifest
    return reader_of(manifest.campaigns, context.columns, manifest.exact, manifest.force)


def _devices_of(context: Context) -> Devices:
    manifest = context.manifest
    station = Campaign((), Site(manifest.gravity, manifest.latitude), manifest.station)
    return devices_of(station, context.columns, folders=manifest.campaigns)


def run_task(task: Task, context: Context) -> int:
    """Read, reduce, solve and store one task; returns its number. Runs wherever a worker is."""
    # A worker process has JAX's defaults; the precision is local to this call.
    with jax.enable_x64(True):
        if context.manifest.one_by_one:
            rows = calibrate_one_by_one(task, _devices_of(context), context.manifest)
        else:
            reduced = _reader_of(context)(task)
            rows = calibrate_reduced(reduced, context.manifest)
            if not (context.manifest.campaigns or context.manifest.force):
                told = zip(reduced.devices, reduced.reasons, strict=True)
                some = {name for name, why in told if not why}
                rows = with_causes(rows, task, _devices_of(context), some)
        write_part(Path(context.folder), task.number, rows)
    return task.number


def _compile(tasks: Sequence[Task], context: Context) -> None:
    """Calibrate some devices of the first task for nothing, which compiles the programs. What goes wrong here goes
    wrong in the task, too, which tells."""
    task = msgspec.structs.replace(tasks[0], devices=tasks[0].devices[:AHEAD])
    with jax.enable_x64(True):
        calibrate_reduced(_reader_of(context)(task), context.manifest)


class Ahead:
    """Compiles programs while files are hashed and the first tasks are read, once, where it is `asked` to."""

    def __init__(self, asked: bool) -> None:
        self._left = asked
        self._pool = ThreadPoolExecutor(1)

    def __enter__(self) -> "Ahead":
        return self

    def __exit__(self, *_: object) -> None:
        self._pool.shutdown(cancel_futures=True)

    def begin(self, tasks: Sequence[Task], context: Context) -> None:
        """Begin with the first devices of some tasks, unless it has begun; campaigns take longer to be read twice."""
        manifest = context.manifest
        if not (self._left and tasks) or manifest.campaigns or manifest.one_by_one:
            return
        self._left = False
        self._pool.submit(_compile, tasks, context)


def each_done(
    tasks: Sequence[Task], context: Context, workers: int | None, scheduler: str | None
) -> Iterator[int]:
    """Numbers of tasks as they are done: side by side in threads, in processes here ("local"), or by Dask."""
    if scheduler is not None:
        one = functools.partial(run_task, context=context)
        yield from (
            on_processes(one, tasks, workers)
            if scheduler == "local"
            else on_dask(one, tasks, scheduler)
        )
        return
    with ThreadPoolExecutor(workers or os.cpu_count() or 1) as pool:
        futures = [pool.submit(run_task, t, context) for t in tasks]
        try:
            for future in as_completed(futures):
                yield future.result()
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise
