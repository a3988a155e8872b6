"""A task's dwells to the rows of the results' table."""

from collections.abc import Callable, Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import polars as pl

from ..choose import build_estimators, ChosenModel
from ..dwells import Dwells
from ..estimators import AbstractEstimator
from ..model import compensate_accel
from ..temperature import AbstractBasis, Curve
from .batch import fit_fleet, FleetFit, shared_length, stack_dwells
from .informed import fit_informed, judge_informed
from .judge import judge
from .mismatch import FleetScores, score
from .population import TriadPopulation
from .reduce import Reduced
from .store import Manifest
from .triad_model import basis_of, TriadModel


Observer = Callable[[str, FleetScores], None]  # triad, scores


def calibrate_reduced(
    reduced: Sequence[Reduced], manifest: Manifest, *, observe: Observer | None = None
) -> pl.DataFrame:
    """The rows of the results' table, in the order of the devices; `observe` is shown the scores, if any."""
    rows: dict[int, dict] = {}
    groups: dict[tuple[int, object], list[int]] = {}
    for k, r in enumerate(reduced):
        reason = r.reason if r.dwells is None else _lacking(r.dwells, manifest)
        if r.dwells is None or reason:
            rows[k] = {"device": r.device, "reason": reason}
        else:
            # Only devices with the same columns can be stacked.
            shape = (shared_length(r.dwells.num_dwells), jax.tree.structure(r.dwells))
            groups.setdefault(shape, []).append(k)
    for (length, _), members in groups.items():
        dwells = [d for k in members if (d := reduced[k].dwells) is not None]
        names = [reduced[k].device for k in members]
        found = _group(names, dwells, manifest, length, observe)
        rows.update(zip(members, found, strict=True))
    return _table([rows[k] for k in sorted(rows)], manifest)


def _lacking(dwells: Dwells, manifest: Manifest) -> str:
    """In words, a column that the run's model needs and this device has not; else empty."""
    for triad in ("accel", "gyro"):
        model: TriadModel | None = getattr(manifest, triad)
        if model is None:
            continue
        needed = (triad, f"reference_{triad}") if model.estimator == "reference" else (triad,)
        for column in needed:
            if getattr(dwells, column) is None:
                return f"{triad}: no column {column}_x, which the fleet's model needs"
    return ""


def _group(
    names: Sequence[str],
    devices: Sequence[Dwells],
    manifest: Manifest,
    length: int,
    observe: Observer | None,
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
        mine = _rows_for(model, together)
        fit, reasons = _solved(estimator, basis, mine, manifest)
        scores = _scored(estimator, basis, mine, fit, manifest)
        if observe is not None and scores is not None:
            observe(estimator.triad, scores)
        for row, reason in zip(rows, reasons, strict=True):
            row["reason"] = row["reason"] or reason or ""
        for k, row in enumerate(rows):
            row.update(_entries(estimator.triad, fit, k))
            if scores is not None:
                row[f"{estimator.triad}_amplitudes"] = scores.amplitude[k]
                row[f"{estimator.triad}_amplitude_sigmas"] = scores.sigma[k]
        if estimator.triad == "accel" and manifest.g_sensitivity:
            together = _with_force(estimator, basis, fit, together)
    return rows


def _rows_for(model: TriadModel, dwells: Dwells) -> Dwells:
    """Only rests where the estimator has no reference for the motion."""
    if model.estimator == "reference":
        return dwells
    rests = np.asarray(dwells.valid) & (np.asarray(dwells.position) >= 0)
    return eqx.tree_at(lambda d: d.valid, dwells, rests)


def _solved(
    estimator: AbstractEstimator, basis: AbstractBasis, dwells: Dwells, manifest: Manifest
) -> tuple[FleetFit, tuple[str | None, ...]]:
    """Estimates, and for each device `None` or why it is set aside."""
    prior: TriadPopulation | None = (
        None if manifest.prior is None else getattr(manifest.prior, estimator.triad)
    )
    if prior is None:
        fit = fit_fleet(estimator, basis, dwells)
        return fit, judge(estimator, basis, fit)
    found = fit_informed(estimator, basis, dwells, prior)
    reasons = zip(
        judge(estimator, basis, found.fit, alone=False),
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
    chosen = ChosenModel(accel, gyro, manifest.g_sensitivity, None, ())
    built = build_estimators(chosen, manifest.gravity, dwells, robust=None)
    pairs = zip(built, (manifest.accel, manifest.gyro), strict=True)
    return [(e, m) for e, m in pairs if e is not None and m is not None]


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
        if (manifest.forms or {}).get(triad):
            scored = (f"{triad}_amplitudes", f"{triad}_amplitude_sigmas")
            schema |= {k: pl.List(pl.Float64) for k in scored}
    listed = [
        {k: v.tolist() if isinstance(v, np.ndarray) else v for k, v in row.items()} for row in rows
    ]
    return pl.DataFrame(listed, schema=schema)
