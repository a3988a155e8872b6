"""How good the fit of each of a fleet's devices is, by the rule of `calibrate.goodness_of_fit`.

What a run keeps of a device decides: misfit, uncertainties over its own temperatures, warnings of the plausibility
checks, and a reservation: of a device that was calibrated for itself the first of `calibrate`, else a large part of its
temperatures without a dwell. Of others `calibrate` looks at single dwells and at what the positions cover beside that.
"""

import math
import re
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

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
from .results import calibration_of, NUMBERS
from .solve.triad_model import basis_of, TriadModel
from .store import each_part, Manifest, matrix_of


UNITS = {"accel": "m/s^2", "gyro": "rad/s"}


def count_verdicts(folder: Path, manifest: Manifest) -> dict[str, int]:
    """How many of the devices that were not set aside are "good", "usable" and "doubtful"."""
    return verdicts_of(graded_devices(folder, manifest))


def verdicts_of(graded: pl.DataFrame) -> dict[str, int]:
    """How many of `graded_devices` are "good", "usable" and "doubtful"."""
    counted = Counter(graded.get_column("verdict").to_list())
    return {verdict: counted.get(verdict, 0) for verdict in VERDICTS.values()}


def graded_devices(folder: Path, manifest: Manifest) -> pl.DataFrame:
    """`device`, `verdict` ("good", "usable" or "doubtful"), `kinds` and `ratio` of the devices that were not set aside.

    `kinds` are what asks for attention, in words without a device's numbers; `ratio` is how many times its noise the
    worse triad's misfit is.
    """
    columns = ["device", "temperature_low", "temperature_high", "reservation"]
    columns += ["warnings"] if manifest.documented else []
    columns += ["reservations"] if manifest.own_words else []
    for triad in UNITS:
        if getattr(manifest, triad) is not None:
            columns += [f"{triad}_{k}" for k in ("parameters", "covariance", "rms", "chi2_per_dof")]
    schema = {"device": pl.String, "verdict": pl.String, "kinds": pl.List(pl.String)}
    tables = [pl.DataFrame(schema=schema | {"ratio": pl.Float64})]
    for part in each_part(folder, columns):
        by_kind = _grades(part, manifest)
        worst = _worst(by_kind, part.height)
        ratio = [
            np.sqrt(_numbers(part, f"{t}_chi2_per_dof"))
            for t in UNITS
            if getattr(manifest, t) is not None
        ]
        made = {
            "device": part.get_column("device"),
            "verdict": [VERDICTS[int(g)] for g in worst],
            "kinds": _kinds(part, by_kind, worst),
            # Of one triad whose noise is not known the other tells it.
            "ratio": np.fmax.reduce(ratio) if ratio else np.full(part.height, math.nan),
        }
        tables.append(pl.DataFrame(made, schema=tables[0].schema))
    return pl.concat(tables)


class Reserved(NamedTuple):
    """What asks for attention of some devices, the one with the greatest misfit first."""

    words: str
    devices: tuple[str, ...]


def reserved_kinds(graded: pl.DataFrame) -> tuple[Reserved, ...]:
    """By kind, which of `graded_devices` it is so of; what the fewest devices have comes first."""
    each = graded.explode("kinds").drop_nulls("kinds").group_by("kinds", maintain_order=True)
    found = [Reserved(str(k), tuple(t.get_column("device").to_list())) for (k,), t in each]
    return tuple(sorted(found, key=lambda r: (len(r.devices), r.words)))


def _kinds(
    table: pl.DataFrame, by_kind: Mapping[str, Int[np.ndarray, " devices"]], worst: np.ndarray
) -> list[list[str]]:
    """Of each device what is not fine, without its numbers."""
    found: list[list[str]] = [[] for _ in worst]
    several = "reservations" in table.columns
    own = table.get_column("reservations").to_list() if several else [None] * table.height
    first = table.get_column("reservation").to_list()
    for k in map(int, np.flatnonzero(worst > FINE)):
        asked = [kind for kind, grades in by_kind.items() if grades[k] > FINE]
        words = [first[k] if kind == "reservation" else kind for kind in asked]
        # Of a device calibrated for itself all that `calibrate` found, and nothing else counts.
        found[k] = [re.sub(NUMBERS, "…", text) for text in own[k] or words]
    return found


def device_grades(table: pl.DataFrame, manifest: Manifest) -> Int[np.ndarray, " devices"]:
    """The worst grade of each device of rows of the results' table, none of which was set aside."""
    return _worst(_grades(table, manifest), table.height)


def _worst(by_kind: Mapping[str, Int[np.ndarray, " devices"]], count: int) -> np.ndarray:
    return np.max([np.full(count, FINE), *by_kind.values()], axis=0)


def _grades(table: pl.DataFrame, manifest: Manifest) -> dict[str, Int[np.ndarray, " devices"]]:
    """Grades of each device by what they are of, in words; "reservation" has words of its own in the table."""
    if not table.height:
        return {}
    grades: dict[str, Int[np.ndarray, " devices"]] = {}
    if manifest.documented:
        warned = table.get_column("warnings").list.len().fill_null(0).to_numpy() > 0
        grades["the plausibility checks warn"] = np.where(warned, ATTENTION, FINE)
    reserved = table.get_column("reservation").is_not_null().to_numpy()
    grades["reservation"] = np.where(reserved, ATTENTION, FINE)
    low, high = (_numbers(table, f"temperature_{end}") for end in ("low", "high"))
    grid = np.linspace(low, high, GRID, axis=1)
    for triad, unit in UNITS.items():
        model: TriadModel | None = getattr(manifest, triad)
        if model is None:
            continue
        name, rms = TRIAD_NAMES[triad], _numbers(table, f"{triad}_rms")
        ratio = np.sqrt(_numbers(table, f"{triad}_chi2_per_dof"))
        left = f"{name}: many times the noise is left, 'inertiax diagnose' looks for what the model leaves out"
        grades[left] = grade_misfit(unit, rms, ratio)
        grades[f"{name}: a parameter is uncertain"] = _of_parameters(table, triad, model, grid)
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
