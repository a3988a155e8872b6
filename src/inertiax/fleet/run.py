"""A fleet from its recordings to a table of calibrations, task by task, resumable."""

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import as_completed, ThreadPoolExecutor
from pathlib import Path

import equinox as eqx
import jax
import msgspec

from ..calibration import write_atomically
from ..campaign import load_settings
from ..formats import ColumnMap
from ..recordings import Campaign
from .choice import choose_line_model, Reader
from .explain import choose_line_forms, write_line
from .folders import common_settings, find_campaigns, read_campaigns, split_campaigns
from .locations import find_sources, local_state
from .populate import population_of
from .population import as_prior, Population, write_population
from .reduce import read
from .results import FleetSummary, summarise
from .rows import calibrate_reduced
from .store import (
    fingerprint,
    is_done,
    Manifest,
    read_manifest,
    SCHEMA,
    write_manifest,
    write_part,
)
from .tasks import split, Task


Report = Callable[[int, int], None]  # tasks done, tasks in all


def run_fleet(
    campaign: Path | str,
    folder: Path | str,
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    prior: Population | None = None,
    explain: bool = False,
    progress: Report | None = None,
) -> FleetSummary:
    """Calibrate every device of a line, or go on with a run that was broken off.

    **Arguments:** `campaign` is a folder with a `campaign.toml` over Parquet files, or that file, or a folder
    with a sub-folder for each campaign, in any format; `folder` takes the results;
    `workers` tasks run side by side (default: one for each core); `scheduler` is the address of a running
    Dask scheduler ("tcp://…"), or "local" to start Dask workers here; `prior` is what is known of the line
    before its devices are measured (see `read_population`), and gives the model; with `explain` every device
    is also scored for the catalogue's effects, and `line.json` tells those of the line from those of
    single devices; `progress` is called with the number of tasks done and of all.

    A device that cannot be calibrated gets a row with the reason. Raises `ValueError` for what is wrong
    with the campaign, or where `folder` holds a run over other files or with another prior.
    """
    folder = Path(folder)
    prior = None if prior is None else as_prior(prior)
    manifest, columns = _plan(Path(campaign), folder, prior, explain=explain)
    left = [t for t in manifest.tasks if not is_done(folder, t.number)]
    before, total = len(manifest.tasks) - len(left), len(manifest.tasks)
    tell = progress if progress is not None else lambda done, of: None
    tell(before, total)
    # Not all tasks go with each: of a large fleet they are megabytes.
    context = Context(msgspec.structs.replace(manifest, tasks=()), columns, str(folder))
    for number, _ in enumerate(_each(left, context, workers, scheduler)):
        tell(before + number + 1, total)
    summary = summarise(folder, before)
    write_atomically(folder / "summary.json", msgspec.json.encode(summary.as_dict()))
    _write_population(folder, manifest)
    if manifest.forms is not None:
        write_line(folder, manifest, _reader(manifest.campaigns, columns))
    return summary


def _reader(campaigns: bool, columns: ColumnMap) -> Reader:
    """What turns a task into dwells."""
    return read_campaigns if campaigns else lambda task: read(task, columns)


def _write_population(folder: Path, manifest: Manifest) -> None:
    # Estimates with a prior are drawn towards it: their spread is not the line's, and it stays as it was.
    found = manifest.prior if manifest.prior is not None else population_of(folder)
    if found is None:
        (folder / "population.json").unlink(missing_ok=True)
    else:
        write_population(found, folder / "population.json")


class Context(eqx.Module):
    """What every task needs beside its own rows."""

    manifest: Manifest = eqx.field(static=True)
    columns: ColumnMap = eqx.field(static=True)
    folder: str = eqx.field(static=True)


def run_task(task: Task, context: Context) -> int:
    """Read, reduce, solve and store one task; returns its number. Runs wherever a worker is."""
    # A worker process has JAX's defaults; the precision is local to this call.
    with jax.enable_x64(True):
        reduced = _reader(context.manifest.campaigns, context.columns)(task)
        write_part(Path(context.folder), task.number, calibrate_reduced(reduced, context.manifest))
    return task.number


def _each(
    tasks: Sequence[Task], context: Context, workers: int | None, scheduler: str | None
) -> Iterator[int]:
    if scheduler is not None:
        from .cluster import on_dask

        yield from on_dask(tasks, context, scheduler, workers)
        return
    with ThreadPoolExecutor(workers or os.cpu_count() or 1) as pool:
        futures = [pool.submit(run_task, t, context) for t in tasks]
        try:
            for future in as_completed(futures):
                yield future.result()
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise


# --- the plan ------------------------------------------------------------------------------------


def _plan(
    path: Path, folder: Path, prior: Population | None, *, explain: bool
) -> tuple[Manifest, ColumnMap]:
    if path.is_dir() and not (path / "campaign.toml").exists() and (files := find_campaigns(path)):
        return _plan_campaigns(path, files, folder, prior, explain=explain), ColumnMap()
    campaign, table = load_settings(path)
    file = campaign.path
    assert file is not None
    columns = table.columns
    try:
        sources = find_sources(file.parent, table.recordings.files)
        other = [s.address for s in sources if not s.address.lower().endswith((".parquet", ".pq"))]
        if other:
            raise ValueError(
                f"[recordings] files: '{Path(other[0]).name}' is no Parquet file; many devices are read from "
                "Parquet, or from a folder that has a sub-folder with campaign.toml for each."
            )
        mark = fingerprint([local_state(file), *(s.state for s in sources)])
        known = _known(folder, mark, prior, explain=explain)
        if known is not None:
            return known, columns
        tasks = split([s.address for s in sources], columns)
    except ValueError as error:
        raise ValueError(f"{file}: {error}") from None
    said = dict(campaigns=False, explain=explain)
    return _settled(campaign, tasks, _reader(False, columns), mark, folder, prior, **said), columns


def _plan_campaigns(
    path: Path, files: tuple[Path, ...], folder: Path, prior: Population | None, *, explain: bool
) -> Manifest:
    campaign, used = common_settings(path, files)
    mark = fingerprint([f"{f.parent.name}/{local_state(f)}" for f in used])
    known = _known(folder, mark, prior, explain=explain)
    if known is not None:
        return known
    tasks, said = split_campaigns(files), dict(campaigns=True, explain=explain)
    return _settled(campaign, tasks, read_campaigns, mark, folder, prior, **said)


def _settled(
    campaign: Campaign,
    tasks: tuple[Task, ...],
    reader: Reader,
    mark: str,
    folder: Path,
    prior: Population | None,
    *,
    campaigns: bool,
    explain: bool,
) -> Manifest:
    """The plan of a new run, stored."""
    model = choose_line_model(campaign, tasks, reader, prior)
    manifest = Manifest(
        SCHEMA, mark, campaign.site.gravity, model.accel, model.gyro, model.g_sensitivity,
        model.reasons, tasks, prior, campaigns,
    )  # fmt: skip
    if explain:
        forms = choose_line_forms(manifest, reader)
        manifest = msgspec.structs.replace(manifest, forms=forms)
    write_manifest(manifest, folder)
    return manifest


def _known(folder: Path, mark: str, prior: Population | None, *, explain: bool) -> Manifest | None:
    """The plan of the run that goes on in a folder."""
    known = read_manifest(folder)
    if known is None:
        return None
    if known.inputs != mark:
        raise ValueError(
            f"{folder} holds a run over other files or settings; choose another output folder."
        )
    if known.prior != prior:
        had = "without a prior" if known.prior is None else "with another prior"
        had = "with a prior" if prior is None else had
        raise ValueError(f"{folder} holds a run {had}; choose another output folder.")
    if explain and known.forms is None:
        raise ValueError(f"{folder} holds a run without --explain; choose another output folder.")
    return known
