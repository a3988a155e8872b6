"""What a run has found: its summary, one device's calibration."""

from pathlib import Path

import equinox as eqx
import numpy as np
import polars as pl

from ..calibration.calibration import Calibration, TriadCalibration
from ..model_selection.model_spec import ModelSpec
from ..physics.temperature import Curve
from ..storage.wrong_value import WrongValue
from .lever_arms import lever_arms_of
from .solve.triad_model import basis_of, TriadModel
from .store import Manifest, read_manifest, read_parts, write_table


class FleetSummary(eqx.Module):
    """How a run ended."""

    devices: int = eqx.field(static=True)
    calibrated: int = eqx.field(static=True)
    set_aside: int = eqx.field(static=True)
    reasons: tuple[tuple[str, int], ...] = eqx.field(static=True)  # in words, most frequent first
    tasks_before: int = eqx.field(static=True)  # done by an earlier run
    model: ModelSpec | None = eqx.field(static=True, default=None)
    # Whose files and settings are those of an earlier run, so that its results are kept.
    devices_before: int = eqx.field(static=True, default=0)
    # Devices by the verdict on their fit: good, usable, doubtful.
    fits: tuple[tuple[str, int], ...] = eqx.field(static=True, default=())

    def as_dict(self) -> dict[str, object]:
        """For summary.json and `--json`."""
        return {
            "schema": "inertiax.fleet-summary/1",
            "devices": self.devices,
            "calibrated": self.calibrated,
            "set_aside": self.set_aside,
            "kept": self.devices_before,
            "fits": dict(self.fits),
            "model": None if self.model is None else self.model.document(),
            "reasons": [{"reason": r, "devices": n} for r, n in self.reasons],
        }


NUMBERS = r"[-+]?\d[\d.e+-]*"  # in a sentence


def summarise(folder: Path, before: int) -> FleetSummary:
    """Count a run's devices and write its quarantine table; `before` tasks were done by an earlier run."""
    table, manifest = read_parts(folder).select("device", "reason").collect(), read_manifest(folder)
    aside = table.filter(pl.col("reason") != "")
    write_table(aside, folder / "quarantine.parquet")
    return FleetSummary(
        devices=table.height,
        calibrated=table.height - aside.height,
        set_aside=aside.height,
        reasons=kinds_of_reasons(aside.get_column("reason")),
        tasks_before=before,
        model=None if manifest is None else manifest.model,
    )


def kinds_of_reasons(reasons: pl.Series) -> tuple[tuple[str, int], ...]:
    """Reasons that differ only in their numbers as one, with how often, most frequent first."""
    kinds = reasons.str.replace_all(NUMBERS, "…").alias("kind").to_frame()
    counted = kinds.group_by("kind").len().sort("len", "kind", descending=[True, False])
    return tuple((kind, int(times)) for kind, times in counted.iter_rows())


def fleet_calibration(folder: Path | str, device: str) -> Calibration:
    """One device's calibration from a run's output folder.

    Raises `ValueError` for a device that the run does not hold or has set aside, with the reason.
    """
    folder = Path(folder)
    manifest = read_manifest(folder)
    found = read_parts(folder).filter(pl.col("device") == device).collect()
    if manifest is None or not found.height:
        raise WrongValue(f"{folder}: no device '{device}' in this run.")
    row = found.row(0, named=True)
    if row["reason"]:
        raise ValueError(f"{folder}: device '{device}' was set aside: {row['reason']}.")
    return calibration_of(row, manifest)


def calibration_of(row: dict, manifest: Manifest) -> Calibration:
    """The calibration that a row of the results' table holds."""
    return Calibration(
        gravity=manifest.gravity,
        accel=_triad(manifest.accel, row, "accel"),
        gyro=_triad(manifest.gyro, row, "gyro"),
        device=row["device"],
        temperature_range=(row["temperature_low"], row["temperature_high"]),
        notes=tuple(row.get("choices") or manifest.reasons),
        effects=lever_arms_of(row, manifest),
        model=manifest.model,
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
