"""How good the fit of each of a fleet's devices is, by the rule of `calibrate.goodness_of_fit`.

What a run keeps of a device decides: misfit, uncertainties over its own temperatures, warnings of the plausibility
checks, and a reservation: of a device that was calibrated for itself the first of `calibrate`, else a large part of its
temperatures without a dwell. Of others `calibrate` looks at single dwells and at what the positions cover beside that.
"""

import math
from collections import Counter
from pathlib import Path

import numpy as np
import polars as pl
from jaxtyping import Int

from ..calibrate.fit_quality import GRID, TRIAD_NAMES, unsure_finding, VERDICTS
from ..calibrate.goodness_of_fit import (
    ATTENTION,
    Finding,
    FINE,
    grade_misfit,
    grade_parameters,
    misfit_words,
)
from .overview.populate import full_covariances
from .results import calibration_of
from .solve.triad_model import basis_of, TriadModel
from .store import each_part, Manifest, matrix_of


UNITS = {"accel": "m/s^2", "gyro": "rad/s"}


def count_verdicts(folder: Path, manifest: Manifest) -> dict[str, int]:
    """How many of the devices that were not set aside are "good", "usable" and "doubtful"."""
    found = graded_devices(folder, manifest)
    counted = Counter(found.get_column("verdict").to_list())
    return {verdict: counted.get(verdict, 0) for verdict in VERDICTS.values()}


def graded_devices(folder: Path, manifest: Manifest) -> pl.DataFrame:
    """`device` and `verdict` ("good", "usable" or "doubtful") of the devices that were not set aside."""
    columns = ["device", "temperature_low", "temperature_high", "reservation"]
    columns += ["warnings"] if manifest.documented else []
    for triad in UNITS:
        if getattr(manifest, triad) is not None:
            columns += [f"{triad}_{k}" for k in ("parameters", "covariance", "rms", "chi2_per_dof")]
    tables = [
        part.select("device").with_columns(
            verdict=pl.Series(
                [VERDICTS[int(g)] for g in device_grades(part, manifest)], dtype=pl.String
            )
        )
        for part in each_part(folder, columns)
    ]
    return (
        pl.concat(tables)
        if tables
        else pl.DataFrame(schema={"device": pl.String, "verdict": pl.String})
    )


def device_grades(table: pl.DataFrame, manifest: Manifest) -> Int[np.ndarray, " devices"]:
    """The worst grade of each device of rows of the results' table, none of which was set aside."""
    grades = np.full(table.height, FINE)
    if not table.height:
        return grades
    if manifest.documented:
        warned = table.get_column("warnings").list.len().fill_null(0).to_numpy() > 0
        grades[warned] = ATTENTION
    grades[table.get_column("reservation").is_not_null().to_numpy()] = ATTENTION
    low, high = (_numbers(table, f"temperature_{end}") for end in ("low", "high"))
    grid = np.linspace(low, high, GRID, axis=1)
    for triad, unit in UNITS.items():
        model: TriadModel | None = getattr(manifest, triad)
        if model is None:
            continue
        ratio = np.sqrt(_numbers(table, f"{triad}_chi2_per_dof"))
        grades = np.maximum(grades, grade_misfit(unit, _numbers(table, f"{triad}_rms"), ratio))
        grades = np.maximum(grades, _of_parameters(table, triad, model, grid))
    return grades


def device_findings(row: dict, manifest: Manifest) -> tuple[Finding, ...]:
    """What of one device asks for attention, the worst first, in the words of `calibrate`; without its warnings."""
    if (
        row.get("reservations") is not None
    ):  # all that `calibrate` found, of a device that is to be used
        return tuple(Finding("reservation", ATTENTION, text) for text in row["reservations"])
    reserved = row.get("reservation")
    found = [Finding("reservation", ATTENTION, reserved)] if reserved else []
    calibration = calibration_of(row, manifest)
    for triad, unit in UNITS.items():
        own = getattr(calibration, triad)
        if own is None:
            continue
        name, rms = TRIAD_NAMES[triad], row[f"{triad}_rms"]
        ratio = math.sqrt(row[f"{triad}_chi2_per_dof"])
        words = misfit_words(unit, rms, ratio, row[f"{triad}_scatter"])
        found.append(Finding("misfit", int(grade_misfit(unit, rms, ratio)), f"{name}: {words}."))
        unsure = unsure_finding(name, own, calibration.temperature_range)
        found += [] if unsure is None else [unsure]
    asked = {f.text: f for f in reversed(found) if not f.fine}
    return tuple(sorted(reversed(asked.values()), key=lambda f: -f.grade))


def device_verdict(row: dict, manifest: Manifest) -> str:
    """ "good", "usable" or "doubtful", of a row of the results' table that was not set aside."""
    warned = [ATTENTION] if row.get("warnings") else []
    return VERDICTS[max([FINE, *warned, *(f.grade for f in device_findings(row, manifest))])]


def _numbers(table: pl.DataFrame, column: str) -> np.ndarray:
    return table.get_column(column).cast(pl.Float64).fill_null(math.nan).to_numpy()


def _of_parameters(
    table: pl.DataFrame, triad: str, model: TriadModel, grid: np.ndarray
) -> Int[np.ndarray, " devices"]:
    """Grades by the uncertainties, each device over its own temperatures."""
    # What does not follow temperature is the same at each.
    grid = grid if model.degree else grid[:, :1]
    count, size, parameters = len(grid), model.degree + 1, len(model.names)
    phi = basis_of(model).rows(grid.ravel()).reshape(*grid.shape, size)
    coefficients = matrix_of(table.get_column(f"{triad}_parameters"))
    values = phi @ coefficients.reshape(count, size, parameters)
    covariance = full_covariances(table.get_column(f"{triad}_covariance"))
    own = np.einsum("naibi->nabi", covariance.reshape(count, size, parameters, size, parameters))
    variance = np.einsum("nta,nabi,ntb->nti", phi, own, phi, optimize=True)
    sigmas = np.sqrt(np.maximum(variance, 0.0))
    return grade_parameters(model.names, values, sigmas).max(axis=(1, 2))
