"""One model for all devices of a run, from the columns and the first devices that can be read."""

import dataclasses
from collections.abc import Callable, Sequence

import equinox as eqx
import jax
import numpy as np

from ..calibrate.between_dwell_variance import with_provisional_scatter
from ..calibrate.one_triad import estimate_triad, rows_for, with_refined_force
from ..calibrate.wanted_sensors import nothing_left
from ..data.recording import Campaign, Recording
from ..estimators import AbstractEstimator
from ..model_selection.model_spec import describe, ModelSpec, TriadSpec
from ..model_selection.select_model import (
    build_estimators,
    choose_model,
    ChosenModel,
)
from ..model_selection.temperature_degree import choose_degree
from ..reduction.dwells import Dwells
from ..reduction.rig_errors import table_words, with_rig_errors
from .population.population import Population, TriadPopulation
from .reduce.many_dwells import Reduction
from .reduce.tasks import Task
from .solve.triad_model import TriadModel


TRIALS = 5  # devices that choose the temperature model
NO_MOTIONS = "a run with a prior, with --explain or of more than 4 million rows keeps none"

Reader = Callable[[Task], Reduction]


class LineModel(eqx.Module):
    """What is estimated of every device, and why."""

    accel: TriadModel | None = eqx.field(static=True)
    gyro: TriadModel | None = eqx.field(static=True)
    g_sensitivity: bool = eqx.field(static=True)
    reasons: tuple[str, ...] = eqx.field(static=True)
    spec: ModelSpec = eqx.field(static=True)  # the same as other commands describe it


def choose_line_model(
    campaign: Campaign, trial: Sequence[Dwells], prior: Population | None = None
) -> LineModel:
    """One model for all devices, from the columns and the first devices that can be read.

    **Arguments:** `trial` are the dwells of these; where there is a `prior` its model is taken.

    Raises `ValueError` where the campaign asks for another model than the prior's, or leaves nothing to calibrate.
    """
    recording = columns_of(trial[0])
    asked = campaign if prior is None else _as_prior(campaign, prior, recording)
    chosen = _static_for_gravity(campaign, choose_model(asked, [recording]))
    if chosen.accel_estimator is None and chosen.gyro_estimator is None:
        raise nothing_left(campaign, "calibrate")
    reasons = list(chosen.reasons)
    temperatures = np.concatenate([np.asarray(d.temperature) for d in trial])
    low, high = float(np.floor(temperatures.min())), float(np.ceil(temperatures.max()))
    models: dict[str, TriadModel | None] = {"accel": None, "gyro": None}
    seen = [with_rig_errors(d, campaign.rig) for d in trial]
    with jax.enable_x64(True):
        for estimator in _estimators(chosen, campaign.site.gravity, trial[0]):
            known = None if prior is None else getattr(prior, estimator.triad)
            if known is not None:
                models[estimator.triad] = known.model
                reasons.append(f"{estimator.triad}: the model of the prior")
                continue
            degree = (
                chosen.degree(estimator.triad)
                if prior is None
                else campaign.model.temperature_degree
            )
            if degree is None:
                degree = max(_degree(estimator, chosen, d) for d in seen)
                reasons.append(
                    f"{estimator.triad}: temperature degree {degree}, the highest that BIC chose for "
                    f"{len(trial)} devices"
                )
            name = getattr(chosen, f"{estimator.triad}_estimator")
            models[estimator.triad] = TriadModel(name, estimator.names, degree, low, high)
            if chosen.g_sensitivity and estimator.triad == "accel":
                seen = [_with_force(estimator, chosen, d) for d in seen]
    estimators = (chosen.accel_estimator, chosen.gyro_estimator)
    reasons.extend(table_words(trial[0], campaign.rig, estimators))
    specs = [_spec(models[triad]) for triad in ("accel", "gyro")]
    spec = describe(campaign.model, *specs)
    return LineModel(models["accel"], models["gyro"], chosen.g_sensitivity, tuple(reasons), spec)


def _spec(model: TriadModel | None) -> TriadSpec | None:
    if model is None:
        return None
    by_force = any("g_sensitivity" in n for n in model.names)
    return TriadSpec(model.estimator, model.degree, model.names, by_force)


def first_dwells(campaign: Campaign, tasks: Sequence[Task], read: Reader) -> list[Dwells]:
    """Dwells of the first devices that can be read; `read` gives a task's. Raises `ValueError` where there is none."""
    trial: list[Dwells] = []
    failed: list[str] = []
    for task in tasks:
        with jax.enable_x64(True):
            tried = read(Task(task.number, task.devices[: 4 * TRIALS]))
        trial.extend(r.dwells for r in tried if r.dwells is not None)
        failed.extend(f"device '{r.device}': {r.reason}" for r in tried if r.dwells is None)
        if len(trial) >= TRIALS:
            break
    if not trial:
        first = failed[0].rstrip(".") if failed else "there is none"
        raise ValueError(
            f"{campaign.path}: no device can be used, the first because of this: {first}."
        )
    return trial[:TRIALS]


def _as_prior(campaign: Campaign, prior: Population, recording: Recording) -> Campaign:
    """The campaign asking for the prior's model of the triads that it recorded."""
    asked = campaign.model
    wanted: dict[str, str | int | bool] = {"g_sensitivity": prior.g_sensitivity}
    degrees = []
    for triad in ("accel", "gyro"):
        known: TriadPopulation | None = getattr(prior, triad)
        if known is not None and getattr(recording, triad) is not None:
            wanted[f"{triad}_estimator"] = known.model.estimator
            degrees.append(known.model.degree)
    if recording.gyro is None:
        del wanted["g_sensitivity"]
    if degrees:
        wanted["temperature_degree"] = max(degrees)
    for key, value in wanted.items():
        said = getattr(asked, key)
        if said is not None and said != value:
            raise ValueError(
                f"{campaign.path}: [model] {key} = {said!r}, but the prior's devices were calibrated with "
                f"{value!r}; leave it out, or use a prior of that model."
            )
    return dataclasses.replace(campaign, model=dataclasses.replace(asked, **wanted))


def _static_for_gravity(campaign: Campaign, chosen: ChosenModel) -> ChosenModel:
    """Gyros without a reference, where the campaign leaves the choice: their bias at rest."""
    if chosen.gyro_estimator != "gravity" or campaign.model.gyro_estimator is not None:
        return chosen
    reason = f"gyros: 'static' because there is no reference_gyro, and {NO_MOTIONS}"
    return dataclasses.replace(chosen, gyro_estimator="static", reasons=(*chosen.reasons, reason))


def columns_of(dwells: Dwells) -> Recording:
    """A recording with the columns that these dwells have, for `choose_model`."""

    def column(name: str) -> np.ndarray | None:
        values = getattr(dwells, name)
        return None if values is None else np.asarray(values)

    temperature = np.asarray(dwells.temperature)
    return Recording(
        # Numbers of the rows: clocks of several recordings may all begin at zero.
        time=np.arange(dwells.num_dwells, dtype=float),
        accel=column("accel"),
        gyro=column("gyro"),
        temperature=temperature[:, None] if np.any(temperature != 0.0) else None,
        position=np.asarray(dwells.position),
        reference_accel=column("reference_accel"),
        reference_gyro=column("reference_gyro"),
    )


def _estimators(chosen: ChosenModel, gravity: float, dwells: Dwells) -> list[AbstractEstimator]:
    if chosen.together:
        raise ValueError(
            "[model] together, lever_arms and misalignment = false go with no prior, no --explain and "
            "no --precision float32."
        )
    for triad, name in (("accel", chosen.accel_estimator), ("gyro", chosen.gyro_estimator)):
        if name == "gravity":
            raise ValueError(
                f"[model] gyro_estimator: 'gravity' needs the motion between rests; {NO_MOTIONS}. Use 'reference' or "
                "'static', or calibrate fewer devices at a time."
            )
        if triad == "accel" and name == "static":
            raise ValueError(
                "[model] accel_estimator: 'static' goes with no prior, no --explain and no more than 4 million rows."
            )
    return [e for e in build_estimators(chosen, gravity, dwells, robust=None) if e is not None]


def _degree(estimator: AbstractEstimator, chosen: ChosenModel, dwells: Dwells) -> int:
    """The degree over temperature that `calibrate` takes for this device: of the same rows with the same weights."""
    triad = estimator.triad
    if chosen.g_sensitivity and triad == "gyro" and dwells.accel is None:
        dwells = eqx.tree_at(
            lambda d: (d.accel, d.accel_covariance),
            dwells,
            (dwells.reference_accel, np.zeros((dwells.num_dwells, 3, 3))),
            is_leaf=lambda x: x is None,
        )
    used = rows_for(triad, chosen, dwells)
    return choose_degree(with_provisional_scatter(estimator, used), used)[0]


def _with_force(estimator: AbstractEstimator, chosen: ChosenModel, dwells: Dwells) -> Dwells:
    """Dwells with the outputs of calibrated accelerometers, for the gyros' D term; as they are where none converge."""
    used = rows_for("accel", chosen, dwells)
    try:
        found = estimate_triad(estimator, used, chosen, "gauss-newton", lambda _: None, [], [])
    except ValueError:
        return dwells
    return with_refined_force(found, dwells)
