"""Devices whose model the batches have no program for, calibrated one by one as `inertiax calibrate` does it.

Gyros that turn gravity between rests need the motions, six faces tell no misalignments, one pose tells a bias alone,
and two triads may be asked for together. Such a line has the model, the estimates and the standard deviations that
each of its devices has alone, for a second a device where a batch takes a millisecond.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import jax
import numpy as np
import polars as pl
from msgspec import structs

from ..calibrate.fit_quality import judge
from ..calibrate.goodness_of_fit import ATTENTION, Finding, UNUSABLE
from ..calibrate.pipeline import calibrate_device
from ..calibrate.results import DeviceResult, TriadResult
from ..calibrate.split_covariance import fit_of, residual_degrees, split
from ..calibration.triad import TriadCalibration
from ..data.formats import ColumnMap
from ..data.recorded import recorded
from ..data.recording import Campaign
from ..model_selection.model_spec import ModelSpec, TriadSpec
from ..model_selection.poses import directions
from ..model_selection.select_model import choose_model, settle_accel
from ..physics.temperature import AbstractBasis
from ..reduction.dwells import Dwells
from ..reduction.rounded_temperature import with_rounding
from .copies import MARK, marks_of
from .covariance_by_source import row_of, SUFFIXES
from .lever_arms import lever_arm_columns
from .model_choice import columns_of, LineModel, TRIALS
from .reduce.campaign_folders import campaigns_of
from .reduce.raw_rows import recordings_of
from .reduce.tasks import Task
from .rows import Columns, empty_table, HIDDEN, lacking, recorded_columns, table_of
from .solve.triad_model import basis_of, TriadModel
from .store import Manifest


# A task's devices with the campaign of each, or in words why there is none.
Devices = Callable[[Task], Iterator[tuple[str, Campaign | str]]]

UNKNOWNS = 9  # of the invariant accelerometer problem that the batches solve


def beyond_batches(campaign: Campaign, trial: Sequence[Dwells]) -> bool:
    """Whether the model is one that only `calibrate` fits, as far as the columns and the first devices' rests say."""
    chosen = choose_model(campaign, [columns_of(trial[0])])
    if chosen.gyro_estimator == "gravity" or chosen.accel_estimator == "static":
        return True
    if chosen.accel_estimator != "invariant":
        return False
    told = [d for d in trial if d.accel is not None]
    settled = {settle_accel(campaign, chosen, d)[0].accel_estimator for d in told}
    return settled != {"invariant"} or max(map(directions, told)) < UNKNOWNS


def line_model(
    campaign: Campaign, tasks: Sequence[Task], devices: Devices, *, force: bool = False
) -> LineModel:
    """The model that most of the first devices have, with the highest degree over temperature among them.

    Devices whose calibration is not to be used, or lacks a triad that they recorded, choose nothing unless there is no
    other: a log too poor for all parameters has a model with fewer, in which the others would be worse than alone.

    Raises `ValueError` where none of the first devices can be calibrated.
    """
    found, poor, failed = [], [], []
    for name, one in (pair for task in tasks for pair in devices(task)):
        try:
            own = _given(one)
            result = calibrate_device(own, force=force)
        except ValueError as error:
            failed.append(f"device '{name}': {_line(error)}")
        else:
            (found if _is_whole(result, own) else poor).append(result)
        if len(found) == TRIALS or len(failed) + len(poor) == 4 * TRIALS:
            break
    which = " with a whole calibration" if poor else ""
    if not found:
        found, which = poor[:TRIALS], ", none with a whole calibration"
    if not found:
        raise ValueError(
            f"{campaign.path}: no device can be calibrated, the first because of this: {failed[0]}."
        )
    kinds = [_kind(r.model) for r in found]
    usual = max(dict.fromkeys(kinds), key=kinds.count)
    alike = [r for r, kind in zip(found, kinds, strict=True) if kind == usual]
    first = alike[0]
    accel = _triad_model([r.calibration.accel for r in alike], [r.accel for r in alike])
    gyro = _triad_model([r.calibration.gyro for r in alike], [r.gyro for r in alike])
    spec = structs.replace(
        first.model,
        accel=_of_degree(first.model.accel, accel),
        gyro=_of_degree(first.model.gyro, gyro),
    )
    said = f"devices one by one, by the model of {len(alike)} of the first {len(found)}{which}"
    by_force = bool(spec.gyro is not None and spec.gyro.g_sensitivity)
    # What was chosen of the first device alone, and what it was found to be, is not the line's.
    common = [c for c in first.choices if all(c in r.choices for r in alike)]
    return LineModel(accel, gyro, by_force, (*common, said), spec)


def calibrate_one_by_one(task: Task, devices: Devices, manifest: Manifest) -> pl.DataFrame:
    """The rows of the results' table of a task's devices; a device that fails or is not to be used has a reason."""
    empty = empty_table(manifest)
    rows = []
    for number, (name, one) in enumerate(devices(task)):
        try:
            own = _given(one)
            _require_columns(own, manifest)
            result = _by_the_lines_model(own, manifest)
            columns = _row(result, manifest)
            if manifest.documented:
                columns |= _documents(result, own, manifest)
        except ValueError as error:
            place = one.path if isinstance(one, Campaign) else None
            columns = {"reason": [_line(error).removeprefix(f"{place}: ")]}
        columns |= {"device": [name], "number": np.array([number])}
        rows.append(table_of(columns, 1, empty))
    return pl.concat([empty, *rows]).drop("number")


def _by_the_lines_model(own: Campaign, manifest: Manifest) -> DeviceResult:
    """A device's calibration by the line's model: its own where it is of that model, with all that choosing it showed.

    One that is fitted again asks nothing of its positions: that they do not tell the misalignments would go unsaid.
    """
    try:
        alone = calibrate_device(own, force=manifest.force)
    except ValueError:
        alone = None
    if alone is not None and _is_of_model(alone, manifest):
        return alone
    return calibrate_device(own, model=manifest.model, force=manifest.force)


def _is_of_model(result: DeviceResult, manifest: Manifest) -> bool:
    """Whether a device's own model is the line's, its degrees over temperature among it."""
    line, own = manifest.model, result.model
    if line is None or _options(own) != _options(line):
        return False
    for triad in ("accel", "gyro"):
        calibration: TriadCalibration | None = getattr(result.calibration, triad)
        model: TriadModel | None = getattr(manifest, triad)
        if (calibration is None) != (model is None):
            return False
        if calibration is None or model is None:
            continue
        of_line = model.estimator, model.names, model.degree + 1
        if (calibration.estimator, calibration.names, calibration.curve.basis.size) != of_line:
            return False
    return True


def devices_of(campaign: Campaign, columns: ColumnMap, *, folders: bool) -> Devices:
    """What gives a task's devices.

    **Arguments:** `folders` of campaigns, or else rows of tables, with the place and the rig of `campaign`.
    """
    if folders:
        return campaigns_of

    def from_rows(task: Task) -> Iterator[tuple[str, Campaign | str]]:
        for name, one in recordings_of(task, columns):
            whole = one if isinstance(one, str) else replace(campaign, recordings=(one,))
            yield name, whole

    return from_rows


def _given(one: Campaign | str) -> Campaign:
    if isinstance(one, str):
        raise ValueError(one)
    return one


def _require_columns(campaign: Campaign, manifest: Manifest) -> None:
    """Raise `ValueError` for a column that the line's model needs and a device has not."""
    for recording in campaign.recordings:
        lacked = lacking(recording, manifest)
        if lacked:
            raise ValueError(lacked)


def _line(error: ValueError) -> str:
    return " ".join(str(error).split()).rstrip(".")


def _is_whole(result: DeviceResult, campaign: Campaign) -> bool:
    """Whether a calibration can be used and has all triads that were recorded."""
    if _worst(judge(result).findings).grade == UNUSABLE:
        return False
    return all(
        getattr(result.calibration, triad) is not None
        for triad in ("accel", "gyro")
        if any(getattr(r, triad) is not None for r in campaign.recordings)
    )


def _worst(findings: Sequence[Finding]) -> Finding:
    return max(findings, key=lambda f: f.grade)


def _kind(spec: ModelSpec) -> tuple[object, ...]:
    """A model but for its degrees over temperature."""
    of = lambda t: None if t is None else (t.estimator, t.parameters)
    return of(spec.accel), of(spec.gyro), *_options(spec)


def _options(spec: ModelSpec) -> tuple[bool, bool, bool]:
    return spec.together, spec.lever_arms, spec.misalignment


def _triad_model(
    found: Sequence[TriadCalibration | None], results: Sequence[TriadResult | None]
) -> TriadModel | None:
    """One basis for all devices: the highest degree, over the temperatures of the first ones in whole degrees."""
    triads = [t for t in found if t is not None]
    if not triads:
        return None
    seen = np.concatenate([np.asarray(r.dwells.temperature) for r in results if r is not None])
    degree = max(t.curve.basis.size for t in triads) - 1
    low, high = float(np.floor(seen.min())), float(np.ceil(seen.max()))
    return TriadModel(triads[0].estimator, triads[0].names, degree, low, high)


def _of_degree(spec: TriadSpec | None, model: TriadModel | None) -> TriadSpec | None:
    return (
        None
        if spec is None or model is None
        else structs.replace(spec, temperature_degree=model.degree)
    )


def _row(result: DeviceResult, manifest: Manifest) -> Columns:
    """What a device's calibration is in the results' table."""
    findings = judge(result).findings
    worst = _worst(findings)
    asking = [f for f in findings if f.grade == ATTENTION and f.topic != "warning"]
    reserved = list(dict.fromkeys(f.text for f in asking))
    low, high = result.calibration.temperature_range or (0.0, 0.0)
    triads = [r for r in (result.accel, result.gyro) if r is not None]
    columns: Columns = {
        "reason": [worst.text.rstrip(".") if worst.grade == UNUSABLE else ""],
        "dwells": np.array([max(len(np.asarray(r.dwells.time)) for r in triads)]),
        "temperature_low": np.array([low]),
        "temperature_high": np.array([high]),
        "reservation": [reserved[0] if reserved else None],
        MARK: marks_of(jax.tree.map(lambda x: np.asarray(x)[None], triads[0].dwells)),
    }
    if manifest.own_words:
        own = [c for c in result.choices if c not in manifest.reasons]
        columns |= {"choices": [[*manifest.reasons, *own]], "reservations": [reserved]}
    columns |= lever_arm_columns(result.calibration)
    for triad in ("accel", "gyro"):
        model: TriadModel | None = getattr(manifest, triad)
        calibration: TriadCalibration | None = getattr(result.calibration, triad)
        found: TriadResult | None = getattr(result, triad)
        if model is None or calibration is None or found is None:
            continue
        values, covariance = on_basis(calibration, basis_of(model))
        i, j = np.tril_indices(len(covariance))
        columns |= {
            f"{triad}_parameters": values.reshape(1, -1),
            f"{triad}_sigma": np.sqrt(np.diagonal(covariance))[None],
            f"{triad}_covariance": covariance[i, j][None],
            f"{triad}_rms": np.array([found.rms]),
            f"{triad}_scatter": np.array([found.scatter]),
            f"{triad}_chi2_per_dof": np.array([found.chi2_per_dof]),
        }
    return columns


def _documents(result: DeviceResult, campaign: Campaign, manifest: Manifest) -> Columns:
    """What a protocol states beside the estimates, by column of the results' table."""
    columns = recorded_columns([recorded(campaign.recordings, result.warnings)])
    columns[HIDDEN] = [with_rounding(campaign.rig, campaign.recordings).hidden_by_steps]
    for triad in ("accel", "gyro"):
        model: TriadModel | None = getattr(manifest, triad)
        found: TriadResult | None = getattr(result, triad)
        if model is None or found is None:
            continue
        fit = fit_of(found)
        whole = _change(fit.curve.basis, basis_of(model), len(model.names))
        parts = [
            part._replace(covariance=whole @ part.covariance @ whole.T)
            for part in split(fit, campaign.rig)
        ]
        row = row_of(found.dwells, residual_degrees(fit), parts)
        columns |= {f"{triad}_{s}": [v] for s, v in zip(SUFFIXES, row, strict=True)}
    return columns


def on_basis(calibration: TriadCalibration, basis: AbstractBasis) -> tuple[np.ndarray, np.ndarray]:
    r"""The same curves by the coefficients of a basis that holds them, and their covariance.

    $\phi_1(T)^T c_1 = \phi_2(T)^T c_2$ at as many temperatures as the second has functions: $c_2 = B c_1$ with
    $B = \Phi_2^{-1} \Phi_1$, and the covariance is $(B \otimes E) C (B \otimes E)^T$.
    """
    curve, count = calibration.curve, len(calibration.names)
    whole = _change(curve.basis, basis, count)
    values = whole @ np.asarray(curve.coefficients).ravel()
    covariance = np.asarray(calibration.covariance)
    return values.reshape(-1, count), whole @ covariance @ whole.T


def _change(old: AbstractBasis, new: AbstractBasis, count: int) -> np.ndarray:
    """B ⊗ E of `on_basis`, for so many parameters."""
    nodes = np.asarray(new.nodes, float)
    return np.kron(np.linalg.solve(new.rows(nodes), old.rows(nodes)), np.eye(count))
