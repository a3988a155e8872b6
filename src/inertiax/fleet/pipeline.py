"""A fleet from its recordings to a table of calibrations, task by task, resumable."""

from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import msgspec

from ..data.campaign import load_settings
from ..data.formats import ColumnMap
from ..data.recording import Campaign, Rig
from ..model_selection.select_model import asks_together
from ..storage.ownership import owned
from ..storage.whole_files import write_atomically
from . import magnetometers
from .copies import set_copies_aside
from .input_hashes import changes_since, hashes_of, same_files, write_inputs
from .line_plausibility import require_plausible_line
from .model_choice import choose_line_model, first_dwells, Reader
from .one_by_one import beyond_batches, devices_of, line_model
from .overview.explain import choose_line_forms, write_line
from .overview.populate import population_of
from .population.population import as_prior, Population, write_population
from .reduce.campaign_folders import (
    common_settings,
    find_campaigns,
    split_campaigns,
)
from .reduce.locations import find_sources, is_address, local_state
from .reduce.tasks import apart, split, Task, wherever_read
from .results import FleetSummary, summarise
from .reuse import kept_results, take_away_parts
from .solve.batch import Precision
from .solve.triad_model import TriadModel
from .store import fingerprint, is_done, Manifest, read_manifest, SCHEMA, write_manifest, write_part
from .task_runs import Ahead, Context, each_done, reader_of
from .verdicts import count_verdicts


# Rows of a run up to which every device is reduced as `calibrate` does, and has its very weights, for some ten
# milliseconds a device. Beyond, the covariance of a mean comes from sums over blocks, and estimates move by some
# hundredths of a sigma.
EXACT_ROWS = 4_000_000
_NAMED = 5  # changed files in an error

Report = Callable[[int, int], None]  # tasks done, tasks in all


def run_fleet(
    campaign: Path | str,
    folder: Path | str,
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    prior: Population | None = None,
    explain: bool = False,
    precision: Precision = "float64",
    force: bool = False,
    progress: Report | None = None,
) -> FleetSummary:
    """Calibrate every device of a line, or go on with a run that was broken off.

    **Arguments:** `campaign` is a folder with a `campaign.toml` over Parquet files, or that file, or a folder
    with a sub-folder for each campaign, in any format; `folder` takes the results; `workers` tasks run side by
    side (default: one for each core); `scheduler` is the address of a running Dask scheduler ("tls://…",
    "tcp://…"), or "local" for worker processes here, without a port; `prior` is what is known of the line before its
    devices are measured (see `read_population`), and gives the model; with `explain` every device is also
    scored for the catalogue's effects, and `line.json` tells those of the line from those of single devices;
    `precision` "float32" solves the invariant accelerometer problem in single precision, see `fit_fleet`;
    `force` goes on with data that cannot be right; `progress` is called with the number of tasks done and of all.

    A device that cannot be calibrated gets a row with the reason. Raises `ValueError` for what is wrong
    with the campaign or, without `force`, with the data of its first devices alike, where another run writes to
    `folder`, where it holds a run over other files, with another prior or in another precision, or where "float32" is
    asked of a line without that problem.
    """
    asked = _Asked(None if prior is None else as_prior(prior), explain, precision, force)
    folder = Path(folder)
    # Other processes have programs of their own.
    with owned(folder), Ahead(scheduler is None) as ahead:
        manifest, columns = _plan(Path(campaign), folder, asked, ahead)
        left = [t for t in manifest.tasks if not is_done(folder, t.number)]
        before, total = len(manifest.tasks) - len(left), len(manifest.tasks)
        tell = progress if progress is not None else lambda done, of: None
        tell(before, total)
        # Not all tasks go with each: of a large fleet they are megabytes.
        context = Context(
            msgspec.structs.replace(manifest, tasks=()), columns, str(folder.absolute())
        )
        ahead.begin(left, context)
        for number, _ in enumerate(each_done(left, context, workers, scheduler)):
            tell(before + number + 1, total)
        return _gather(folder, manifest, columns, before)


def _gather(folder: Path, manifest: Manifest, columns: ColumnMap, before: int) -> FleetSummary:
    """What the parts say together, when all are done: copies, summary, population, effects of the line."""
    set_copies_aside(folder)
    summary = summarise(folder, before)
    with ThreadPoolExecutor(1) as beside:
        verdicts = beside.submit(count_verdicts, folder, manifest)
        _write_population(folder, manifest)
        fits = tuple(verdicts.result().items())
    summary = replace(summary, fits=fits, devices_before=manifest.kept)
    write_atomically(folder / "summary.json", msgspec.json.encode(summary.as_dict()))
    if manifest.forms is not None:
        reader = reader_of(manifest.campaigns, columns, manifest.exact, manifest.force)
        write_line(folder, manifest, reader)
    return summary


def _write_population(folder: Path, manifest: Manifest) -> None:
    # Estimates with a prior are drawn towards it: their spread is not the line's, and it stays as it was.
    found = manifest.prior if manifest.prior is not None else population_of(folder)
    if found is None:
        (folder / "population.json").unlink(missing_ok=True)
    else:
        write_population(found, folder / "population.json")


# --- the plan ------------------------------------------------------------------------------------


class _Asked(msgspec.Struct, frozen=True):
    """What the caller wants of a run beside the calibrations; a run goes on only with the same."""

    prior: Population | None
    explain: bool
    precision: Precision
    force: bool = False


def _plan(path: Path, folder: Path, asked: _Asked, ahead: Ahead) -> tuple[Manifest, ColumnMap]:
    if path.is_dir() and not (path / "campaign.toml").exists() and (files := find_campaigns(path)):
        return _plan_campaigns(path, files, folder, asked, ahead), ColumnMap()
    campaign, table = load_settings(path)
    file = campaign.path
    assert file is not None
    columns = table.columns
    try:
        if table.recordings.temperature_files is not None:
            raise ValueError(
                "[recordings] temperature_files: the files of many devices hold the temperature as a column; a device "
                "whose temperature is logged apart needs a sub-folder with a campaign.toml of its own."
            )
        if table.table.delay:
            raise ValueError(
                "[table] delay: the files of many devices are read with their references as they stand; a device whose "
                "references are late needs a sub-folder with a campaign.toml of its own."
            )
        sources = find_sources(file.parent, table.recordings.files)
        other = [s.address for s in sources if not s.address.lower().endswith((".parquet", ".pq"))]
        if other:
            raise ValueError(
                f"[recordings] files: '{Path(other[0]).name}' is no Parquet file; many devices are read from "
                "Parquet, or from a folder that has a sub-folder with campaign.toml for each."
            )
        mark = fingerprint([local_state(file), *(s.state for s in sources)])
        local = [Path(s.address) for s in sources if not is_address(s.address)]
        known = _known(folder, mark, asked, {file: local}, whole=len(local) == len(sources))
        if known is not None:
            return known, columns
        tasks = wherever_read(split([s.address for s in sources], columns))
    except ValueError as error:
        raise ValueError(f"{file}: {error}") from None
    exact = sum(t.rows for t in tasks) <= EXACT_ROWS
    reader = reader_of(False, columns, exact, asked.force)
    found = _settled(
        campaign,
        tasks,
        reader,
        columns,
        mark,
        folder,
        asked,
        {file: local},
        ahead,
        campaigns=False,
        exact=exact,
    )
    return found, columns


def _plan_campaigns(
    path: Path, files: tuple[Path, ...], folder: Path, asked: _Asked, ahead: Ahead
) -> Manifest:
    campaign, used = common_settings(path, files)
    mark = fingerprint(
        [f"{f.parent.name}/{local_state(f)}" for c, own in used.items() for f in (c, *own)]
    )
    known = _known(folder, mark, asked, used, whole=True)
    if known is not None:
        return known
    tasks = wherever_read(split_campaigns(files))
    return _settled(
        campaign,
        tasks,
        reader_of(True, ColumnMap(), True, asked.force),
        ColumnMap(),
        mark,
        folder,
        asked,
        used,
        ahead,
        campaigns=True,
        exact=True,
    )


def _settled(
    campaign: Campaign,
    tasks: tuple[Task, ...],
    reader: Reader,
    columns: ColumnMap,
    mark: str,
    folder: Path,
    asked: _Asked,
    files: Mapping[Path, Iterable[Path]],
    ahead: Ahead,
    *,
    campaigns: bool,
    exact: bool,
) -> Manifest:
    """The plan of a new run over `files` by campaign.toml, stored with their hashes."""
    plain = asked == _Asked(None, explain=False, precision="float64", force=asked.force)
    # Asked for, whatever it takes; what the data alone would choose so, a large run has in a form that is quick.
    one_by_one = plain and bool(asks_together(campaign.model))
    by_table = lambda: magnetometers.in_tables(campaign, tasks, columns)
    mag = magnetometers.in_campaigns(tasks) if campaigns else by_table()
    devices = devices_of(campaign, columns, folders=campaigns)
    warned: tuple[str, ...] = ()
    if not campaigns:  # whose readers check each
        warned = require_plausible_line(campaign, tasks, devices, force=asked.force)
    trial = [] if one_by_one else first_dwells(campaign, tasks, reader)
    if one_by_one or (plain and exact and beyond_batches(campaign, trial)):
        one_by_one, tasks = True, apart(tasks)
        model = line_model(campaign, tasks, devices, force=asked.force)
    else:
        model = choose_line_model(campaign, trial, asked.prior)
    if asked.precision == "float32":
        _require_single(model.accel, asked.prior)
    manifest = Manifest(
        SCHEMA, mark, campaign.site.gravity, model.accel, model.gyro, model.g_sensitivity,
        (*model.reasons, *warned), tasks, asked.prior, campaigns, precision=asked.precision, model=model.spec,
        rig=_promised(campaign.rig), axes=campaign.rig.axes, outer_part=campaign.rig.outer_part,
        exact=exact or one_by_one, one_by_one=one_by_one,
        documented=True, own_words=one_by_one, latitude=campaign.site.latitude,
        magnetometers=mag, force=asked.force,
    )  # fmt: skip
    if asked.explain:
        forms = choose_line_forms(manifest, reader)
        manifest = msgspec.structs.replace(manifest, forms=forms)
    light = msgspec.structs.replace(manifest, tasks=())
    ahead.begin(tasks, Context(light, columns, str(folder.absolute())))
    return _begun(manifest, files, folder)


def _begun(manifest: Manifest, files: Mapping[Path, Iterable[Path]], folder: Path) -> Manifest:
    """The plan, stored with the files' hashes; with the results of an earlier run that still hold as its first task."""
    before, hashes = read_manifest(folder), hashes_of(files)
    kept = None if before is None else kept_results(before, manifest, hashes, folder)
    if before is not None and kept is None:
        raise ValueError(_other_files(folder, changes_since(hashes, folder)))
    if kept is not None:
        take_away_parts(folder)
    manifest = manifest if kept is None else kept.manifest
    write_inputs(hashes, folder)
    write_manifest(manifest, folder)
    if kept is not None:  # broken off before, the task is done again
        write_part(folder, 0, kept.rows)
    return manifest


def _promised(rig: Rig) -> tuple[float, float, float, float, float]:
    said = rig.position_uncertainty, rig.rate_uncertainty, rig.temperature_uncertainty
    angle, rate, temperature = (value or 0.0 for value in said)
    return (
        angle,
        rate,
        temperature,
        rig.level_uncertainty or 0.0,
        rig.orthogonality_uncertainty or 0.0,
    )


def _require_single(accel: TriadModel | None, prior: Population | None) -> None:
    found = "none is calibrated" if accel is None else f"they are calibrated by '{accel.estimator}'"
    if accel is None or accel.estimator != "invariant":
        raise ValueError(
            f"precision 'float32' is for accelerometers calibrated by 'invariant'; here {found}. Leave it out."
        )
    if prior is not None:
        raise ValueError("precision 'float32' does not go with a prior; leave one of them out.")


def _other_files(folder: Path, changed: tuple[str, ...] | None) -> str:
    """Why a run cannot go on in a folder."""
    more = f" and {len(changed or ()) - _NAMED} more" if len(changed or ()) > _NAMED else ""
    which = f": {', '.join(changed[:_NAMED])}{more}" if changed else ""
    return (
        f"{folder} holds a run over other files or settings{which}; choose another output folder."
    )


def _known(
    folder: Path, mark: str, asked: _Asked, files: Mapping[Path, Iterable[Path]], *, whole: bool
) -> Manifest | None:
    """The plan of the run that goes on in a folder.

    **Arguments:** `files` by campaign.toml; `whole`: these are all that the run reads, none lies elsewhere.
    """
    known, prior = read_manifest(folder), asked.prior
    if known is None:
        return None
    if known.inputs != mark:
        hashes = hashes_of(files)
        changed = changes_since(hashes, folder)
        if changed:
            if not whole or not same_files(hashes, folder, campaigns=known.campaigns):
                raise ValueError(_other_files(folder, changed))
            return None  # `_begun` keeps what still holds
        if changed is None or not whole:
            raise ValueError(_other_files(folder, changed))
        # Written to without a change of content.
        known = msgspec.structs.replace(known, inputs=mark)
        write_manifest(known, folder)
    if known.prior != prior:
        had = "without a prior" if known.prior is None else "with another prior"
        had = "with a prior" if prior is None else had
        raise ValueError(f"{folder} holds a run {had}; choose another output folder.")
    if asked.explain and known.forms is None:
        raise ValueError(f"{folder} holds a run without --explain; choose another output folder.")
    if known.force != asked.force:
        had = "with --force" if known.force else "without --force"
        raise ValueError(f"{folder} holds a run {had}; choose another output folder.")
    if known.precision != asked.precision:
        raise ValueError(
            f"{folder} holds a run in {known.precision}; choose another output folder for {asked.precision}."
        )
    return known
