"""One device of a fleet's results: its calibration, and a record of what it was made of.

The run keeps the hashes of its files and, by device, what was recorded and the covariance by source. Runs of versions
that kept neither are read all the same: the fit is one source then, and hashes are taken when the record is asked for;
a file that was written to since is named.
"""

import datetime
import math
from collections.abc import Iterator
from pathlib import Path

import msgspec
import polars as pl

from ..calibrate.goodness_of_fit import undecidable
from ..calibration.calibration import Calibration
from ..data.campaign import find_files
from ..data.inputs import hashed, InputFile
from ..data.settings import read_table
from ..fleet.covariance_by_source import parts_of
from ..fleet.input_hashes import FleetInputs, read_inputs
from ..fleet.reduce.tasks import Stretch
from ..fleet.results import calibration_of, fleet_calibration
from ..fleet.rows import HIDDEN
from ..fleet.store import Manifest, read_manifest, read_parts
from ..fleet.verdicts import device_findings, device_verdict
from ..storage.wrong_value import WrongValue
from .make_record import days_of, software, source_record, time_text
from .record import ConditionsRecord, Record, SCHEMA, StationRecord, TriadRecord


_HASHED_LATE = "The hashes of the inputs were taken when the protocol was written, not when the fleet was calibrated."


def fleet_measurement(folder: Path, device: str | None) -> tuple[Calibration, Record]:
    """One device's calibration and record.

    Raises `ValueError` where no device is named, the run has no such device, or it was set aside.
    """
    manifest = read_manifest(folder)
    if manifest is None or device is None:
        raise WrongValue(
            f"{folder}: holds a fleet; name one device with --device SERIAL, or decide on all of them with --all."
        )
    calibration = fleet_calibration(folder, device)
    row = read_parts(folder).filter(pl.col("device") == device).collect().row(0, named=True)
    begun = (folder / "manifest.json").stat().st_mtime
    hashes = read_inputs(folder)
    if hashes is None:
        inputs, left_out = _hashed_late(manifest, device, begun)
    else:
        inputs, left_out = _hashed(hashes, manifest, device)
    record = _record(row, manifest, calibration, begun)
    return calibration, msgspec.structs.replace(
        record,
        inputs=inputs,
        left_out=left_out,
        conditions=_conditions(row, manifest, calibration),
    )


def fleet_measurements(folder: Path) -> Iterator[tuple[str, tuple[Calibration, Record] | str]]:
    """Every device of a run, or in words why it was set aside; records without inputs and conditions.

    Raises `ValueError` where the folder holds no run.
    """
    manifest = read_manifest(folder)
    if manifest is None:
        raise ValueError(f"{folder}: holds no fleet.")
    begun = (folder / "manifest.json").stat().st_mtime
    for row in read_parts(folder).collect().iter_rows(named=True):
        if row["reason"]:
            yield row["device"], row["reason"]
        else:
            calibration = calibration_of(row, manifest)
            yield row["device"], (calibration, _record(row, manifest, calibration, begun))


def _record(row: dict, manifest: Manifest, calibration: Calibration, begun: float) -> Record:
    """What the run keeps of a device itself."""
    position, rate, temperature, level, orthogonality = (x or None for x in manifest.rig)
    return Record(
        schema=SCHEMA,
        created=time_text(datetime.datetime.fromtimestamp(begun, datetime.UTC)),
        command="inertiax fleet",
        software=software(),
        calibration_sha256="",
        inputs=(),
        station=StationRecord(
            manifest.gravity, manifest.latitude, position, rate, temperature, level, orthogonality
        ),
        conditions=ConditionsRecord(None, None, None, None, calibration.temperature_range),
        method="least squares device by device" if manifest.one_by_one else "batched least squares",
        verdict=device_verdict(row, manifest),
        findings=tuple(f.text for f in device_findings(row, manifest)),
        choices=calibration.notes,
        warnings=tuple(row.get("warnings") or ()),
        left_out=(),
        accel=_triad(row, calibration, "accel"),
        gyro=_triad(row, calibration, "gyro"),
    )


def _stretches(manifest: Manifest, device: str) -> list[Stretch]:
    """Where a device's rows lie; one of several in a campaign's folder is named `folder/serial`."""
    own = {device, device.partition("/")[0]} if manifest.campaigns else {device}
    return [s for t in manifest.tasks for d, all_of in t.devices if d in own for s in all_of]


def _conditions(row: dict, manifest: Manifest, calibration: Calibration) -> ConditionsRecord:
    """As the run kept them; else what the plan says of rows and files, which of campaigns is not known."""
    known = calibration.temperature_range
    stretches = _stretches(manifest, row["device"])
    planned = None if manifest.campaigns else len({s.file for s in stretches})
    samples = None if manifest.campaigns else sum(s.rows for s in stretches)
    begin, end = days_of(row.get("begin"), row.get("end"))
    return ConditionsRecord(
        # A line in Parquet files is read device by device, from as many files as hold its rows.
        recordings=row.get("recordings") if manifest.campaigns else planned,
        samples=row.get("samples") or samples,
        seconds=row.get("seconds"),
        experiments=row.get("experiments"),
        temperature_range=None if known is None else (float(known[0]), float(known[1])),
        begin=begin,
        end=end,
        sample_rate=row.get("sample_rate"),
    )


def _hashed(
    hashes: FleetInputs, manifest: Manifest, device: str
) -> tuple[tuple[InputFile, ...], tuple[str, ...]]:
    """The campaign.toml and the files that hold the device's rows, as hashed when the run began."""
    named = dict.fromkeys(s.file for s in _stretches(manifest, device))
    if manifest.campaigns:
        return tuple(f for name in named for f in hashes.campaigns.get(name, ())), ()
    found, missing = [], dict(named)
    for campaign, (settings, *files) in hashes.campaigns.items():
        home = Path(campaign).parent
        own = [f for f in files if str(home / f.file) in named]
        found += [settings, *own]
        missing = {n: None for n in missing if n not in {str(home / f.file) for f in own}}
    return tuple(found), tuple(f"Not hashed, for it is not on this machine: {f}." for f in missing)


def _hashed_late(
    manifest: Manifest, device: str, begun: float
) -> tuple[tuple[InputFile, ...], tuple[str, ...]]:
    """The files that hold the device's rows, and what cannot be said of them; of a run without hashes."""
    named = dict.fromkeys(s.file for s in _stretches(manifest, device))
    if manifest.campaigns:
        tables = [Path(f) for f in named if Path(f).is_file()]
        named |= dict.fromkeys(str(f) for t in tables for f in _recordings(t))
    here = [Path(f) for f in named if Path(f).is_file()]
    gone = [f for f in named if not Path(f).is_file()]
    newer = [f.name for f in here if f.stat().st_mtime > begun]
    said = [_HASHED_LATE]
    said += [f"Not hashed, for it is not on this machine: {f}." for f in gone]
    said += [f"Written to after the fleet was calibrated: {f}." for f in newer]
    home = here[0].parent if here else Path()
    return hashed(here, home), tuple(said)


def _recordings(campaign: Path) -> tuple[Path, ...]:
    try:
        return find_files(campaign.parent, read_table(campaign).recordings.files)
    except ValueError:
        return ()  # moved since; what is left is hashed


def _triad(row: dict, calibration: Calibration, name: str) -> TriadRecord | None:
    triad = getattr(calibration, name)
    if triad is None:
        return None
    dwells, degrees = row.get(f"{name}_dwells"), row.get(f"{name}_degrees")
    if not dwells:  # not kept, or too many rows to take the covariance apart
        dwells = row["dwells"]
        rows = dwells * (1 if triad.estimator == "invariant" else 3)
        degrees = rows - triad.curve.basis.size * len(triad.names)
    unit = "m/s^2" if name == "accel" else "rad/s"
    return TriadRecord(
        dwells=dwells,
        turns=row.get(f"{name}_turns"),
        rms=row[f"{name}_rms"],
        scatter=row[f"{name}_scatter"],
        unit=unit,
        degrees_of_freedom=max(degrees or 0, 1),
        sources=tuple(source_record(part) for part in parts_of(row, name)),
        undecidable=undecidable(unit, row[f"{name}_rms"], math.sqrt(row[f"{name}_chi2_per_dof"])),
        hidden_by_steps=row.get(HIDDEN) or 0.0,  # not kept by earlier runs
    )
