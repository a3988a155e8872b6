"""A fleet from its recordings to a table of calibrations, task by task, resumable."""

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import as_completed, ThreadPoolExecutor
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import msgspec
import numpy as np
import polars as pl

from ..calibration import Calibration, TriadCalibration, write_atomically
from ..campaign import find_files, load_settings
from ..choose import build_estimators, choose_degree, choose_model, ChosenModel
from ..dwells import Dwells
from ..estimators import AbstractEstimator
from ..formats import ColumnMap
from ..model import compensate_accel
from ..recordings import Campaign, Recording
from ..temperature import AbstractBasis, Constant, Curve, Polynomial
from .batch import fit_fleet, FleetFit, shared_length, stack_dwells
from .judge import judge
from .reduce import read, Reduced
from .store import (
    fingerprint,
    is_done,
    Manifest,
    read_manifest,
    read_parts,
    SCHEMA,
    TriadModel,
    write_manifest,
    write_part,
    write_table,
)
from .tasks import split, Task


TRIALS = 5  # devices that choose the temperature model

Report = Callable[[int, int], None]  # tasks done, tasks in all


class FleetSummary(eqx.Module):
    """How a run ended."""

    devices: int = eqx.field(static=True)
    calibrated: int = eqx.field(static=True)
    set_aside: int = eqx.field(static=True)
    reasons: tuple[tuple[str, int], ...] = eqx.field(static=True)  # in words, most frequent first
    tasks_before: int = eqx.field(static=True)  # done by an earlier run

    def as_dict(self) -> dict[str, object]:
        """For summary.json and `--json`."""
        return {
            "schema": "inertiax.fleet-summary/1",
            "devices": self.devices,
            "calibrated": self.calibrated,
            "set_aside": self.set_aside,
            "reasons": [{"reason": r, "devices": n} for r, n in self.reasons],
        }


def run_fleet(
    campaign: Path | str,
    folder: Path | str,
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    progress: Report | None = None,
) -> FleetSummary:
    """Calibrate every device of a campaign of Parquet files, or go on with a run that was broken off.

    **Arguments:** `campaign` is a folder with `campaign.toml` or that file; `folder` takes the results;
    `workers` tasks run side by side (default: one for each core); `scheduler` is the address of a running
    Dask scheduler ("tcp://…"), or "local" to start Dask workers here; `progress` is called with the number
    of tasks done and of all.

    A device that cannot be calibrated gets a row with the reason. Raises `ValueError` for what is wrong
    with the campaign, or where `folder` holds a run over other files.
    """
    folder = Path(folder)
    manifest, columns = _plan(Path(campaign), folder)
    left = [t for t in manifest.tasks if not is_done(folder, t.number)]
    before, total = len(manifest.tasks) - len(left), len(manifest.tasks)
    tell = progress if progress is not None else lambda done, of: None
    tell(before, total)
    context = Context(manifest, columns, str(folder))
    for number, _ in enumerate(_each(left, context, workers, scheduler)):
        tell(before + number + 1, total)
    summary = _summary(folder, before)
    write_atomically(folder / "summary.json", msgspec.json.encode(summary.as_dict()))
    return summary


class Context(eqx.Module):
    """What every task needs beside its own rows."""

    manifest: Manifest = eqx.field(static=True)
    columns: ColumnMap = eqx.field(static=True)
    folder: str = eqx.field(static=True)


def run_task(task: Task, context: Context) -> int:
    """Read, reduce, solve and store one task; returns its number. Runs wherever a worker is."""
    # A worker process has JAX's defaults; the precision is local to this call.
    with jax.enable_x64(True):
        reduced = read(task, context.columns)
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


def _plan(path: Path, folder: Path) -> tuple[Manifest, ColumnMap]:
    campaign, table = load_settings(path)
    file = campaign.path
    assert file is not None
    columns = table.columns
    try:
        files = find_files(file.parent, table.recordings.files)
        other = [f for f in files if f.suffix.lower() not in (".parquet", ".pq")]
        if other:
            raise ValueError(
                f"[recordings] files: '{other[0].name}' is no Parquet file; a fleet is read from Parquet. "
                "`inertiax calibrate` takes the others, one campaign at a time."
            )
        mark = fingerprint((file, *files))
        known = read_manifest(folder)
        if known is not None:
            if known.inputs != mark:
                raise ValueError(
                    f"{folder} holds a run over other files or settings; choose another output folder."
                )
            return known, columns
        tasks = split(files, columns)
    except ValueError as error:
        raise ValueError(f"{file}: {error}") from None
    manifest = _choose(campaign, tasks, columns, mark)
    write_manifest(manifest, folder)
    return manifest, columns


def _choose(campaign: Campaign, tasks: Sequence[Task], columns: ColumnMap, mark: str) -> Manifest:
    """One model for all devices, from the columns and the first devices that can be read."""
    trial: list[Dwells] = []
    reasons: list[str] = []
    failed: list[str] = []
    for task in tasks:
        some = Task(task.number, task.devices[: 4 * TRIALS])
        with jax.enable_x64(True):
            tried = read(some, columns)
        trial.extend(r.dwells for r in tried if r.dwells is not None)
        failed.extend(f"device '{r.device}': {r.reason}" for r in tried if r.dwells is None)
        if len(trial) >= TRIALS:
            break
    trial = trial[:TRIALS]
    if not trial:
        raise ValueError(
            f"{campaign.path}: no device can be used, the first because of this: {failed[0]}."
        )
    chosen = choose_model(campaign, [_columns_of(trial[0])])
    reasons.extend(chosen.reasons)
    temperatures = np.concatenate([np.asarray(d.temperature) for d in trial])
    low, high = float(np.floor(temperatures.min())), float(np.ceil(temperatures.max()))
    models: dict[str, TriadModel | None] = {"accel": None, "gyro": None}
    with jax.enable_x64(True):
        for estimator in _estimators(chosen, campaign.site.gravity, trial[0]):
            degree = chosen.degree
            if degree is None:
                picked = [choose_degree(estimator, _for(estimator, chosen, d))[0] for d in trial]
                degree = max(picked)
                reasons.append(
                    f"{estimator.triad}: temperature degree {degree}, the highest that BIC chose for "
                    f"{len(trial)} devices"
                )
            name = getattr(chosen, f"{estimator.triad}_estimator")
            models[estimator.triad] = TriadModel(name, estimator.names, degree, low, high)
    return Manifest(
        SCHEMA, mark, campaign.site.gravity, models["accel"], models["gyro"], chosen.g_sensitivity,
        tuple(reasons), tuple(tasks),
    )  # fmt: skip


def _columns_of(dwells: Dwells) -> Recording:
    """A recording with the columns that these dwells have, for `choose_model`."""

    def column(name: str) -> np.ndarray | None:
        values = getattr(dwells, name)
        return None if values is None else np.asarray(values)

    temperature = np.asarray(dwells.temperature)
    return Recording(
        time=np.asarray(dwells.time),
        accel=column("accel"),
        gyro=column("gyro"),
        temperature=temperature[:, None] if np.any(temperature != 0.0) else None,
        position=np.asarray(dwells.position),
        reference_accel=column("reference_accel"),
        reference_gyro=column("reference_gyro"),
    )


def _estimators(chosen: ChosenModel, gravity: float, dwells: Dwells) -> list[AbstractEstimator]:
    for triad, name in (("accel", chosen.accel_estimator), ("gyro", chosen.gyro_estimator)):
        if name == "gravity":
            raise ValueError(
                "[model] gyro_estimator: 'gravity' needs the motion between rests, which a fleet's dwell "
                "means do not hold; use 'reference' or 'static', or calibrate the devices one by one."
            )
        if triad == "accel" and name == "static":
            raise ValueError("[model] accel_estimator: 'static' is for one device at a time.")
    return [e for e in build_estimators(chosen, gravity, dwells, robust=None) if e is not None]


def _for(estimator: AbstractEstimator, chosen: ChosenModel, dwells: Dwells) -> Dwells:
    """The columns that an estimator of dwells at rest uses."""
    if chosen.g_sensitivity and estimator.triad == "gyro" and dwells.accel is None:
        return eqx.tree_at(
            lambda d: (d.accel, d.accel_covariance),
            dwells,
            (dwells.reference_accel, np.zeros((dwells.num_dwells, 3, 3))),
            is_leaf=lambda x: x is None,
        )
    return dwells


# --- one task ------------------------------------------------------------------------------------


def calibrate_reduced(reduced: Sequence[Reduced], manifest: Manifest) -> pl.DataFrame:
    """The rows of the results' table, in the order of the devices."""
    rows: dict[int, dict] = {
        k: {"device": r.device, "reason": r.reason}
        for k, r in enumerate(reduced)
        if r.dwells is None
    }
    groups: dict[int, list[int]] = {}
    for k, r in enumerate(reduced):
        if r.dwells is not None:
            groups.setdefault(shared_length(r.dwells.num_dwells), []).append(k)
    for length, members in groups.items():
        dwells = [d for k in members if (d := reduced[k].dwells) is not None]
        found = _group([reduced[k].device for k in members], dwells, manifest, length)
        rows.update(zip(members, found, strict=True))
    return _table([rows[k] for k in sorted(rows)], manifest)


def _group(
    names: Sequence[str], devices: Sequence[Dwells], manifest: Manifest, length: int
) -> list[dict]:
    together = stack_dwells(devices, length)
    rows: list[dict] = [
        {
            "device": name,
            "reason": "",
            "dwells": int(d.num_dwells),
            "temperature_low": float(np.min(d.temperature)),
            "temperature_high": float(np.max(d.temperature)),
        }
        for name, d in zip(names, devices, strict=True)
    ]
    for estimator, model in estimators_of(manifest, together):
        basis = basis_of(model)
        fit = fit_fleet(estimator, basis, together)
        for row, reason in zip(rows, judge(estimator, basis, fit), strict=True):
            row["reason"] = row["reason"] or reason or ""
        for k, row in enumerate(rows):
            row.update(_entries(estimator.triad, fit, k))
        if estimator.triad == "accel" and manifest.g_sensitivity:
            together = _with_force(estimator, basis, fit, together)
    return rows


def estimators_of(manifest: Manifest, dwells: Dwells) -> list[tuple[AbstractEstimator, TriadModel]]:
    """The run's estimators with what the manifest says of each."""
    accel = manifest.accel.estimator if manifest.accel else None
    gyro = manifest.gyro.estimator if manifest.gyro else None
    chosen = ChosenModel(accel, gyro, manifest.g_sensitivity, None, ())
    built = build_estimators(chosen, manifest.gravity, dwells, robust=None)
    pairs = zip(built, (manifest.accel, manifest.gyro), strict=True)
    return [(e, m) for e, m in pairs if e is not None and m is not None]


def basis_of(model: TriadModel) -> AbstractBasis:
    """The temperature basis of a triad's model."""
    return Constant() if model.degree == 0 else Polynomial(model.degree, model.low, model.high)


def _with_force(
    estimator: AbstractEstimator, basis: AbstractBasis, fit: FleetFit, dwells: Dwells
) -> Dwells:
    """Dwells with compensated accelerometer outputs, for the gyros' D term."""
    coefficients = fit.parameters.reshape(len(fit.parameters), basis.size, -1)
    force = _compensated(estimator, basis, coefficients, dwells.temperature, dwells.accel)
    return eqx.tree_at(lambda d: d.accel, dwells, np.asarray(force))


@eqx.filter_jit
def _compensated(estimator, basis, coefficients, temperature, accel):
    def one(c, t, a):
        return compensate_accel(estimator.unpack(Curve(basis, c)(t)), a)

    return jax.vmap(jax.vmap(one, in_axes=(None, 0, 0)))(
        coefficients, temperature, jnp.asarray(accel)
    )


def _entries(triad: str, fit: FleetFit, k: int) -> dict:
    i, j = np.tril_indices(fit.covariance.shape[1])
    misfit = fit.misfit[k][fit.valid[k]]
    return {
        f"{triad}_parameters": fit.parameters[k],
        f"{triad}_sigma": np.sqrt(np.diagonal(fit.covariance[k])),
        f"{triad}_covariance": fit.covariance[k][i, j],
        f"{triad}_rms": float(np.sqrt(np.square(misfit).mean())),
        f"{triad}_scatter": float(fit.scatter[k]),
        f"{triad}_chi2_per_dof": float(fit.chi2_per_dof[k]),
    }


def _table(rows: list[dict], manifest: Manifest) -> pl.DataFrame:
    schema: dict[str, pl.DataType | type[pl.DataType]] = {
        "device": pl.String,
        "reason": pl.String,  # empty where the calibration can be used
        "dwells": pl.Int64,
        "temperature_low": pl.Float64,
        "temperature_high": pl.Float64,
    }
    for triad in ("accel", "gyro"):
        if getattr(manifest, triad) is not None:
            schema |= {
                f"{triad}_{k}": pl.List(pl.Float64) for k in ("parameters", "sigma", "covariance")
            }
            schema |= {f"{triad}_{k}": pl.Float64 for k in ("rms", "scatter", "chi2_per_dof")}
    listed = [
        {k: v.tolist() if isinstance(v, np.ndarray) else v for k, v in row.items()} for row in rows
    ]
    return pl.DataFrame(listed, schema=schema)


# --- results -------------------------------------------------------------------------------------


def _summary(folder: Path, before: int) -> FleetSummary:
    table = read_parts(folder).select("device", "reason").collect()
    aside = table.filter(pl.col("reason") != "")
    write_table(aside, folder / "quarantine.parquet")
    kinds = aside.with_columns(kind=pl.col("reason").str.replace_all(r"[-+]?\d[\d.e+-]*", "…"))
    counted = kinds.group_by("kind").len().sort("len", "kind", descending=[True, False])
    return FleetSummary(
        devices=table.height,
        calibrated=table.height - aside.height,
        set_aside=aside.height,
        reasons=tuple((k, int(n)) for k, n in counted.iter_rows()),
        tasks_before=before,
    )


def fleet_calibration(folder: Path | str, device: str) -> Calibration:
    """One device's calibration from a run's output folder.

    Raises `ValueError` for a device that the run does not hold or has set aside, with the reason.
    """
    folder = Path(folder)
    manifest = read_manifest(folder)
    found = read_parts(folder).filter(pl.col("device") == device).collect()
    if manifest is None or not found.height:
        raise ValueError(f"{folder}: no device '{device}' in this run.")
    row = found.row(0, named=True)
    if row["reason"]:
        raise ValueError(f"{folder}: device '{device}' was set aside: {row['reason']}.")
    return Calibration(
        gravity=manifest.gravity,
        accel=_triad(manifest.accel, row, "accel"),
        gyro=_triad(manifest.gyro, row, "gyro"),
        device=device,
        temperature_range=(row["temperature_low"], row["temperature_high"]),
        notes=manifest.reasons,
    )


def _triad(model: TriadModel | None, row: dict, triad: str) -> TriadCalibration | None:
    if model is None:
        return None
    basis = basis_of(model)
    values = np.array(row[f"{triad}_parameters"]).reshape(basis.size, -1)
    n = values.size
    covariance = np.zeros((n, n))
    i, j = np.tril_indices(n)
    covariance[i, j] = covariance[j, i] = row[f"{triad}_covariance"]
    return TriadCalibration(Curve(basis, values), covariance, model.names, model.estimator)
