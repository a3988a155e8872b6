"""A task's dwells to the rows of the results' table."""

from collections.abc import Callable, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import polars as pl
from jaxtyping import Float

from ..calibrate.data_coverage import gap_finding
from ..calibrate.fit_quality import TRIAD_NAMES
from ..calibrate.goodness_of_fit import LIMITS
from ..calibration.probe_error import probe_covariance
from ..data.recorded import Recorded
from ..data.recording import Recording
from ..estimators import AbstractEstimator, Invariant
from ..model_selection.select_model import build_estimators, ChosenModel
from ..physics.error_model import compensate_accel
from ..physics.temperature import AbstractBasis, Curve
from ..reduction.dwells import Dwells
from ..reduction.rig_errors import with_rig_errors
from .copies import MARK, marks_of
from .covariance_by_source import source_columns, SUFFIXES, with_slow_noise
from .effects.score_statistics import FleetScores, score
from .lever_arms import COLUMNS
from .population.empirical_bayes import fit_informed, judge_informed
from .population.population import TriadPopulation
from .reduce.many_dwells import Reduction, Stack
from .solve.batch import fit_fleet, FleetFit
from .solve.quarantine import judge, rms_misfit
from .solve.triad_model import basis_of, TriadModel
from .store import Manifest


Observer = Callable[[str, FleetScores], None]  # triad, scores
Columns = dict[str, Any]  # of the results' table: arrays and lists
HIDDEN = "hidden_by_steps"  # °C, 1 sigma: what the probe's steps hide


def calibrate_reduced(
    reduced: Reduction, manifest: Manifest, *, observe: Observer | None = None
) -> pl.DataFrame:
    """The rows of the results' table, in the order of the devices; `observe` is shown the scores, if any."""
    empty = empty_table(manifest)
    tables = [_without(reduced, empty)] if any(reduced.reasons) else []
    for stack in reduced.stacks:
        lacked = lacking(stack.dwells, manifest)
        columns: Columns = {"reason": [lacked] * len(stack.members)}
        if not lacked:
            columns = _columns(stack, manifest, observe)
        columns |= {"device": [reduced.devices[k] for k in stack.members], "number": stack.members}
        columns |= {MARK: marks_of(stack.dwells)}
        if manifest.documented:
            columns |= recorded_columns([reduced.recorded.get(int(k)) for k in stack.members])
        tables.append(table_of(columns, len(stack.members), empty))
    return pl.concat(tables).sort("number").drop("number")


def lacking(given: Dwells | Recording, manifest: Manifest) -> str:
    """In words, a column that the run's model needs and these devices have not; else empty."""
    for triad in ("accel", "gyro"):
        model: TriadModel | None = getattr(manifest, triad)
        if model is None:
            continue
        needed = (triad, f"reference_{triad}") if model.estimator == "reference" else (triad,)
        for column in needed:
            if getattr(given, column) is None:
                return f"{triad}: no column {column}_x, which the fleet's model needs"
    return ""


def _columns(stack: Stack, manifest: Manifest, observe: Observer | None) -> Columns:
    """What was found of the devices of a stack, by column of the results' table."""
    together = with_rig_errors(stack.dwells, manifest.station)
    temperature = np.asarray(together.temperature)
    columns: Columns = {
        "dwells": stack.counts,
        "temperature_low": temperature.min(axis=1),  # padding repeats a dwell
        "temperature_high": temperature.max(axis=1),
    }
    columns["reservation"] = _gaps(together, manifest)
    if manifest.documented:
        columns[HIDDEN] = _hidden(stack)
    reasons: list[str] = [""] * len(stack.members)
    for estimator, model in estimators_of(manifest, together):
        triad, basis = estimator.triad, basis_of(model)
        mine = estimator.usable(together)
        fit, found = _solved(estimator, basis, mine, manifest)
        scores = _scored(estimator, basis, mine, fit, manifest)
        if observe is not None and scores is not None:
            observe(triad, scores)
        reasons = [first or second or "" for first, second in zip(reasons, found, strict=True)]
        # A prior's share is no source of the device's own, and beyond some million rows it takes too long.
        by_source = manifest.documented and manifest.exact and manifest.prior is None
        if by_source:
            fit = with_slow_noise(estimator, basis, mine, fit, manifest.station)
        columns |= _entries(triad, _with_probe_error(fit, basis, _probe_sigma(stack, manifest)))
        columns[f"{triad}_noise"] = noise_at_rest(stack.dwells, triad)
        if by_source:
            parts = source_columns(estimator, basis, mine, fit, manifest.station)
            columns |= {f"{triad}_{suffix}": values for suffix, values in parts.items()}
        if scores is not None:
            columns[f"{triad}_amplitudes"] = scores.amplitude
            columns[f"{triad}_amplitude_sigmas"] = scores.sigma
        if triad == "accel" and manifest.g_sensitivity:
            together = with_force(estimator, basis, fit, together)
    return columns | {"reason": reasons}


def _gaps(dwells: Dwells, manifest: Manifest) -> list[str | None]:
    """For each device what its temperatures leave out, where a triad follows them, by the rule of `calibrate`."""
    moving = [t for t in ("accel", "gyro") if (m := getattr(manifest, t)) and m.degree > 0]
    temperature = np.sort(np.asarray(dwells.temperature), axis=1)  # padding repeats a dwell
    found: list[str | None] = [None] * len(temperature)
    if not moving or temperature.shape[1] < 2:
        return found
    span = temperature[:, -1] - temperature[:, 0]
    wide = np.diff(temperature, axis=1).max(axis=1) > LIMITS.temperature_gap * span
    for k in np.flatnonzero(wide):
        found[k] = gap_finding(TRIAD_NAMES[moving[0]], temperature[k]).text
    return found


def _probe_sigma(stack: Stack, manifest: Manifest) -> Float[np.ndarray, " devices"]:
    """1 sigma of each device's temperatures, °C, as `reduction.rounded_temperature.probe_sigma`."""
    return np.hypot(_hidden(stack), manifest.rig[2])


def _hidden(stack: Stack) -> Float[np.ndarray, " devices"]:
    """What the probes' steps hide, °C, 1 sigma."""
    hidden = stack.dwells.hidden_by_steps
    return np.zeros(len(stack.counts)) if hidden is None else np.asarray(hidden)[:, 0]


def _with_probe_error(
    fit: FleetFit, basis: AbstractBasis, sigma: Float[np.ndarray, " devices"]
) -> FleetFit:
    """The fit with the error of each device's temperatures in its covariance."""
    if not sigma.any():
        return fit
    coefficients = fit.parameters.reshape(len(fit.parameters), basis.size, -1)
    wider = fit.covariance + probe_covariance(coefficients, basis, sigma)
    return eqx.tree_at(lambda f: f.covariance, fit, wider)


def _solved(
    estimator: AbstractEstimator, basis: AbstractBasis, dwells: Dwells, manifest: Manifest
) -> tuple[FleetFit, tuple[str | None, ...]]:
    """Estimates, and for each device `None` or why it is set aside."""
    prior: TriadPopulation | None = (
        None if manifest.prior is None else getattr(manifest.prior, estimator.triad)
    )
    if prior is None:
        single = isinstance(estimator, Invariant) and manifest.precision == "float32"
        fit = fit_fleet(
            estimator,
            basis,
            dwells,
            precision="float32" if single else "float64",
            refined=manifest.exact,
        )
        return fit, judge(estimator, basis, fit, dwells.temperature)
    found = fit_informed(estimator, basis, dwells, prior)
    reasons = zip(
        judge(estimator, basis, found.fit, dwells.temperature, alone=False),
        judge_informed(estimator.triad, found, prior),
        strict=True,
    )
    return found.fit, tuple(first or second for first, second in reasons)


def _scored(
    estimator: AbstractEstimator,
    basis: AbstractBasis,
    dwells: Dwells,
    fit: FleetFit,
    manifest: Manifest,
) -> FleetScores | None:
    """How large the catalogue's effects would be in every device, where the run was asked to tell."""
    forms = (manifest.forms or {}).get(estimator.triad)
    return score(estimator, basis, dwells, fit, forms=forms) if forms else None


def estimators_of(manifest: Manifest, dwells: Dwells) -> list[tuple[AbstractEstimator, TriadModel]]:
    """The run's estimators with what the manifest says of each."""
    accel = manifest.accel.estimator if manifest.accel else None
    gyro = manifest.gyro.estimator if manifest.gyro else None
    chosen = ChosenModel(accel, gyro, manifest.g_sensitivity, (None, None), ())
    built = build_estimators(chosen, manifest.gravity, dwells, robust=None)
    pairs = zip(built, (manifest.accel, manifest.gyro), strict=True)
    return [(e, m) for e, m in pairs if e is not None and m is not None]


def with_force(
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


def _entries(triad: str, fit: FleetFit) -> Columns:
    i, j = np.tril_indices(fit.covariance.shape[1])
    return {
        f"{triad}_parameters": fit.parameters,
        f"{triad}_sigma": np.sqrt(np.diagonal(fit.covariance, axis1=1, axis2=2)),
        f"{triad}_covariance": fit.covariance[:, i, j],
        f"{triad}_rms": rms_misfit(fit),
        f"{triad}_scatter": fit.scatter,
        f"{triad}_chi2_per_dof": fit.chi2_per_dof,
    }


def recorded_columns(found: Sequence[Recorded | None]) -> Columns:
    """What was recorded, by column of the results' table."""
    return {
        name: [None if r is None else getattr(r, name) for r in found] for name in Recorded._fields
    }


def noise_at_rest(dwells: Dwells, triad: str) -> Float[np.ndarray, "devices 3"]:
    """Each channel's noise within rests, as the standard deviation of a mean over one second: the median over the
    device's rests, in m/s² √s or rad/s √s; no number where nothing tells it."""
    covariance = getattr(dwells, f"{triad}_covariance")
    rest = np.asarray(dwells.valid) & (np.asarray(dwells.position) >= 0)
    if covariance is None or not rest.any(axis=1).all():
        return np.full((len(rest), 3), np.nan)
    variance = np.diagonal(np.asarray(covariance), axis1=-2, axis2=-1)
    density = np.sqrt(np.maximum(variance, 0.0) * np.asarray(dwells.duration)[..., None])
    return np.nanmedian(np.where(rest[..., None], density, np.nan), axis=1)


# --- the table -----------------------------------------------------------------------------------


def empty_table(manifest: Manifest) -> pl.DataFrame:
    """The results' table without rows; `number` orders the devices while it is made."""
    many = pl.List(pl.Float64)
    schema = {
        "number": pl.Int64(),
        "device": pl.String(),
        "reason": pl.String(),  # empty where the calibration can be used
        "dwells": pl.Int64(),
        "temperature_low": pl.Float64(),
        "temperature_high": pl.Float64(),
        "reservation": pl.String(),  # what else asks for attention, in words; null where nothing
        MARK: pl.String(),
    }
    if manifest.documented:
        schema |= {"recordings": pl.Int64(), "samples": pl.Int64(), "seconds": pl.Float64()}
        schema |= {"experiments": pl.Int64(), "warnings": pl.List(pl.String)}
        schema |= {k: pl.Float64() for k in ("begin", "end", "sample_rate", HIDDEN)}
    if manifest.own_words:
        schema |= {k: pl.List(pl.String) for k in ("choices", "reservations")}
    if manifest.model is not None and manifest.model.lever_arms:
        schema |= COLUMNS
    for triad in ("accel", "gyro"):
        if getattr(manifest, triad) is not None:
            schema |= {f"{triad}_{k}": many for k in ("parameters", "sigma", "covariance", "noise")}
            schema |= {f"{triad}_{k}": pl.Float64() for k in ("rms", "scatter", "chi2_per_dof")}
            if manifest.documented:
                kinds = (*[pl.Int64()] * 3, pl.List(pl.String), many, many)
                schema |= {f"{triad}_{k}": kind for k, kind in zip(SUFFIXES, kinds, strict=True)}
        if (manifest.forms or {}).get(triad):
            schema |= {f"{triad}_{k}": many for k in ("amplitudes", "amplitude_sigmas")}
    return pl.DataFrame(schema=schema)


def _without(reduced: Reduction, empty: pl.DataFrame) -> pl.DataFrame:
    """Rows of the devices without dwells."""
    numbers = [k for k, reason in enumerate(reduced.reasons) if reason]
    columns: Columns = {
        "number": np.array(numbers, int),
        "device": [reduced.devices[k] for k in numbers],
        "reason": [reduced.reasons[k] for k in numbers],
    }
    return table_of(columns, len(numbers), empty)


def table_of(columns: Columns, height: int, empty: pl.DataFrame) -> pl.DataFrame:
    """Columns by name as so many rows of the results' table; the others are empty."""
    given = [pl.Series(k, v, strict=False).cast(empty.schema[k]) for k, v in columns.items()]
    absent = empty.drop(columns.keys()).clear(height)
    return (
        absent.with_columns(given).select(empty.columns)
        if absent.width
        else pl.DataFrame(given).select(empty.columns)
    )
