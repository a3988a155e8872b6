"""The page of one device of a fleet: its parameters beside its line's."""

import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import polars as pl

from ..calibrate.fit_quality import TRIAD_NAMES
from ..calibration.calibration import TriadCalibration
from ..calibration.quantities import customary_units, label, rms_text, with_sigma
from ..fleet.overview.view import reference_temperature, Unlike
from ..fleet.population.population import Population, TriadPopulation
from ..fleet.results import calibration_of
from ..fleet.solve.triad_model import basis_of, curve_covariance, TriadModel
from ..fleet.store import Manifest, read_parts
from ..fleet.verdicts import device_findings, device_verdict
from ..physics.temperature import Curve
from ..plots import fleet as plots
from ..plots.style import drawing
from ..storage.wrong_value import WrongValue
from .fleet_lever_arms import device_lever_arms
from .page import Key, Picture, picture, Section, Table, Verdict, write_page


NOTABLE = 4.0  # sigmas of the fleet
_UNITS = {"accel": "m/s^2", "gyro": "rad/s"}


def report_device(
    folder: Path,
    device: str,
    name: str,
    manifest: Manifest,
    population: Population | None,
    unlike: dict[str, tuple[Unlike, ...]],
    command: str,
    units: Mapping[str, plots.Units],
    *,
    figures: bool = True,
) -> Path:
    """Write `devices/NAME.html` of one device of a run, and return its path.

    **Arguments:** `name` is a harmless file name for the device; `unlike` are the run's devices unlike the
    others; `units` are the fleet's by triad; `figures` draws its curves over the line's.

    Raises `ValueError` for a device that the run does not hold.
    """
    found = read_parts(folder).filter(pl.col("device") == device).collect()
    if not found.height:
        raise WrongValue(f"{folder}: no device '{device}' in this run.")
    row = found.row(0, named=True)
    home, solved = folder / "devices", _solved(row, manifest)
    sections, notable = [], _words(device, unlike)
    for triad, calibration in solved.items():
        line = None if population is None else getattr(population, triad)
        informed = manifest.prior is not None and getattr(manifest.prior, triad) is not None
        model: TriadModel = getattr(manifest, triad)
        # A run that set all devices aside has no units of the line.
        shown_in = units.get(triad) or customary_units(calibration)
        table, far = _table(calibration, line, model, shown_in, informed=informed)
        notable += far
        pictures = _pictures(triad, calibration, line, shown_in, home, name) if figures else ()
        sections.append(Section(TRIAD_NAMES[triad], tables=(table,), figures=pictures))
    sections += device_lever_arms(row) if solved else []
    file = home / f"{name}.html"
    write_page(
        file,
        title=f"Device {device}",
        under="One device of a fleet run, beside its line.",
        verdict=_verdict(row, manifest, notable, bool(solved), population is not None),
        keys=_keys(row, solved),
        sections=sections,
        command=command,
    )
    return file


def _words(device: str, unlike: dict[str, tuple[Unlike, ...]]) -> list[str]:
    """What the run found unlike the others in a device."""
    return [
        f"{label(u.parameter)} at {u.temperature:.0f} °C by {signed(u.sigmas)} sigma"
        for found in unlike.values()
        for u in found
        if u.device == device
    ]


def signed(sigmas: float) -> str:
    """A deviation with its sign and one decimal."""
    return f"{round(sigmas, 1) + 0.0:+.1f}"


def _solved(row: dict, manifest: Manifest) -> dict[str, TriadCalibration]:
    """Triads with numbers to show; a device in quarantine may have none."""
    numbers = {
        t: row.get(f"{t}_parameters") for t in ("accel", "gyro") if getattr(manifest, t) is not None
    }
    if any(v is None or not np.all(np.isfinite(v)) for v in numbers.values()):
        return {}
    calibration = calibration_of(row, manifest)
    both = {"accel": calibration.accel, "gyro": calibration.gyro}
    return {k: v for k, v in both.items() if v is not None}


def _verdict(
    row: dict, manifest: Manifest, notable: list[str], solved: bool, beside_line: bool
) -> Verdict:
    if row["reason"]:
        lines = (f"{row['reason']}.",)
        shown = ("What was estimated is shown all the same; do not use it.",) if solved else ()
        return Verdict("bad", "Set aside.", lines + shown)
    fit = device_verdict(row, manifest)
    lines = tuple(f.text for f in device_findings(row, manifest))
    lines += tuple(f"Warning: {w}." for w in row.get("warnings") or ())
    tone = {"good": "good", "usable": "attention", "doubtful": "bad"}[fit]
    if notable:
        far = f"Farthest from the line's mean: {'; '.join(notable[:5])}."
        tone = "bad" if tone == "bad" else "attention"
        return Verdict(tone, "Calibrated, but unlike its line.", (far, *lines))
    like = ", and like its line" if beside_line else ""
    reserved = {"good": "", "usable": ", with a reservation", "doubtful": ", but do not use it yet"}
    return Verdict(tone, f"Calibrated{reserved[fit]}{like}.", lines)


def _keys(row: dict, solved: dict[str, TriadCalibration]) -> list[Key]:
    keys = []
    if row.get("dwells") is not None:
        low, high = row["temperature_low"], row["temperature_high"]
        keys.append(Key("Dwells", str(row["dwells"]), f"{low:.1f} to {high:.1f} °C"))
    for triad in solved:
        chi2 = row[f"{triad}_chi2_per_dof"]
        known = chi2 is not None and math.isfinite(chi2)
        detail = (
            f"χ² per degree of freedom {chi2:.2f}"
            if known
            else "no χ²: noise unknown or too few dwells"
        )
        rms = rms_text(_UNITS[triad], row[f"{triad}_rms"])
        keys.append(Key(f"{TRIAD_NAMES[triad]}: rms misfit", rms, detail))
    return keys


def line_units(model: TriadModel, values: np.ndarray) -> plots.Units:
    """Factor from SI and customary unit of every parameter, from values at one temperature."""
    basis = basis_of(model)
    coefficients = np.zeros((basis.size, len(model.names)))
    coefficients[0] = values
    none = np.zeros((coefficients.size, coefficients.size))
    return customary_units(
        TriadCalibration(Curve(basis, coefficients), none, model.names, model.estimator)
    )


def _table(
    calibration: TriadCalibration,
    line: TriadPopulation | None,
    model: TriadModel,
    units: plots.Units,
    *,
    informed: bool,
) -> tuple[Table, list[str]]:
    """Parameters at the reference temperature, and in words those that are far out, the farthest first."""
    at = reference_temperature(model)
    values = np.asarray(calibration.curve(at))
    sigmas = np.asarray(calibration.standard_deviations(at))
    grid = np.array([at])
    mean = None if line is None else line.mean_curves(grid)[0]
    prior = None if line is None else curve_covariance(model, line.prior_covariance, grid)[0]
    rows, far = [], []
    for k, (name, (factor, unit)) in enumerate(zip(model.names, units, strict=True)):
        shown = with_sigma(float(factor * values[k]), float(factor * sigmas[k]))
        cells = ["", "", ""]
        if mean is not None and prior is not None and math.isfinite(sigmas[k]):
            own = float(np.square(sigmas[k]))
            variance = max(prior[k] - own, 1e-3 * prior[k]) if informed else prior[k] + own
            away = float((values[k] - mean[k]) / math.sqrt(variance))
            cells = [
                *with_sigma(float(factor * mean[k]), float(factor * math.sqrt(prior[k]))),
                signed(away),
            ]
            if abs(away) > NOTABLE:
                far.append((abs(away), f"{label(name)} by {signed(away)} sigma"))
        rows.append((label(name), unit, *shown, *cells))
    where = f" at {at:.0f} °C" if model.degree else ""
    head = (
        "parameter",
        "unit",
        "value",
        "± 1 sigma",
        "line's mean",
        "spread",
        "sigmas of the fleet",
    )
    table = Table(head, tuple(rows), numeric=(2, 3, 4, 5, 6), caption=f"Parameters{where}.")
    return table, [words for _, words in sorted(far, reverse=True)]


def _pictures(
    triad: str,
    calibration: TriadCalibration,
    line: TriadPopulation | None,
    units: plots.Units,
    folder: Path,
    name: str,
) -> tuple[Picture, ...]:
    if line is None or not line.model.degree:
        return ()
    caption = "This device (orange) over its line: mean, one and two standard deviations between devices (blue)."
    with drawing():
        figure = plots.line_curves(line, units, calibration)
        return (picture(figure, folder, f"{name}-{triad}", caption, caption),)
