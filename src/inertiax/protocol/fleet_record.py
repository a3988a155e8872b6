"""One device of a fleet's results: its calibration, and a record of what it was made of.

A fleet's table keeps covariances whole, so the fit is one source here, beside the probe. The run keeps no hashes of its
files either; they are taken when the record is asked for, and a file that was written to since is named.
"""

import datetime
from pathlib import Path

import polars as pl

from ..calibration.calibration import Calibration
from ..fleet.reduce.tasks import Stretch
from ..fleet.results import fleet_calibration
from ..fleet.store import Manifest, read_manifest, read_parts
from .inputs import hashed, InputFile
from .make_record import software, time_text
from .record import ConditionsRecord, Record, SCHEMA, StationRecord, TriadRecord


_HASHED_LATE = "The hashes of the inputs were taken when the protocol was written, not when the fleet was calibrated."


def fleet_measurement(folder: Path, device: str | None) -> tuple[Calibration, Record]:
    """One device's calibration and record.

    Raises `ValueError` where no device is named, the run has no such device, or it was set aside.
    """
    manifest = read_manifest(folder)
    if manifest is None or device is None:
        raise ValueError(f"{folder}: holds a fleet; name one device with --device SERIAL.")
    calibration = fleet_calibration(folder, device)
    row = read_parts(folder).filter(pl.col("device") == device).collect().row(0, named=True)
    position, rate, temperature = (x or None for x in manifest.rig)
    begun = (folder / "manifest.json").stat().st_mtime
    inputs, left_out = _inputs(manifest, device, begun)
    known = calibration.temperature_range
    return calibration, Record(
        schema=SCHEMA,
        created=time_text(datetime.datetime.fromtimestamp(begun, datetime.UTC)),
        command="inertiax fleet",
        software=software(),
        calibration_sha256="",
        inputs=inputs,
        station=StationRecord(manifest.gravity, None, position, rate, temperature),
        conditions=ConditionsRecord(
            recordings=len(inputs),
            samples=_rows(manifest, device),
            seconds=None,
            experiments=None,
            temperature_range=None if known is None else (float(known[0]), float(known[1])),
        ),
        method="batched least squares",
        verdict="good",  # of what a fleet does not set aside
        findings=(),
        choices=manifest.reasons,
        warnings=(),
        left_out=left_out,
        accel=_triad(row, calibration, "accel"),
        gyro=_triad(row, calibration, "gyro"),
    )


def _stretches(manifest: Manifest, device: str) -> list[Stretch]:
    return [s for t in manifest.tasks for d, all_of in t.devices if d == device for s in all_of]


def _rows(manifest: Manifest, device: str) -> int:
    return sum(s.rows for s in _stretches(manifest, device))


def _inputs(
    manifest: Manifest, device: str, begun: float
) -> tuple[tuple[InputFile, ...], tuple[str, ...]]:
    """The files that hold the device's rows, and what cannot be said of them."""
    named = dict.fromkeys(s.file for s in _stretches(manifest, device))
    here = [Path(f) for f in named if Path(f).is_file()]
    gone = [f for f in named if not Path(f).is_file()]
    newer = [f.name for f in here if f.stat().st_mtime > begun]
    said = [_HASHED_LATE]
    said += [f"Not hashed, for it is not on this machine: {f}." for f in gone]
    said += [f"Written to after the fleet was calibrated: {f}." for f in newer]
    home = here[0].parent if here else Path()
    return hashed(here, home), tuple(said)


def _triad(row: dict, calibration: Calibration, name: str) -> TriadRecord | None:
    triad = getattr(calibration, name)
    if triad is None:
        return None
    rows = row["dwells"] * (1 if triad.estimator == "invariant" else 3)
    unknowns = triad.curve.basis.size * len(triad.names)
    return TriadRecord(
        dwells=row["dwells"],
        turns=None,
        rms=row[f"{name}_rms"],
        scatter=row[f"{name}_scatter"],
        unit="m/s^2" if name == "accel" else "rad/s",
        degrees_of_freedom=max(rows - unknowns, 1),
        sources=(),
    )
