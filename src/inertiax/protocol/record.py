"""`record.json`: what a calibration was made of, beside its `calibration.json`, to write a protocol from.

It holds the hashes of all inputs, the conditions and choices as they were, and for each triad the covariance that
each source of uncertainty gives to the coefficients.
"""

import hashlib
from pathlib import Path

import msgspec

from ..data.compensated import WRONG_PARAMETERS
from ..data.inputs import InputFile
from ..data.json_documents import decode, encode
from ..storage.whole_files import write_atomically


SCHEMA = "inertiax.record/1"
FILE = "record.json"


class _Strict(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A document's part; other keys are errors."""


class SourceRecord(_Strict, frozen=True):
    """One source of uncertainty."""

    source: str  # its name, such as "dwell noise"
    degrees_of_freedom: float | None  # None: known
    covariance: tuple[float, ...]  # of the coefficients, row-major; lower triangle by rows


class TriadRecord(_Strict, frozen=True):
    """What one triad's estimate rests on."""

    dwells: int  # that have a misfit
    turns: int | None  # of them at constant rate
    rms: float  # of the misfit, in `unit`
    scatter: float  # between dwells, in `unit`
    unit: str  # of `rms` and `scatter`: m/s^2, rad/s or rad
    degrees_of_freedom: int  # of the residuals
    sources: tuple[SourceRecord, ...]  # none where the fit's covariance is not split
    undecidable: str | None = None  # in words why no requirement on the triad is decided
    hidden_by_steps: float = 0.0  # °C, 1 sigma: what the probe's steps hide of the temperature


class StationRecord(_Strict, frozen=True):
    """What the campaign states of its place and rig; uncertainties are 1 sigma, `None` where not stated."""

    gravity: float  # m/s²
    latitude: float | None  # rad
    position_uncertainty: float | None  # rad
    rate_uncertainty: float | None  # relative
    temperature_uncertainty: float | None  # °C
    level_uncertainty: float | None = None  # rad
    orthogonality_uncertainty: float | None = None  # rad
    unused: tuple[str, ...] = ()  # keys of these that no uncertainty could use


class ConditionsRecord(_Strict, frozen=True):
    """What was recorded."""

    recordings: int | None  # how many; None where not kept
    samples: int | None  # of all recordings together; None where not kept
    seconds: float | None  # of all recordings together; None where not kept
    experiments: int | None  # runs of the programme; None where not kept
    temperature_range: tuple[float, float] | None  # °C
    begin: str | None = None  # UTC, ISO 8601, of the first row; None: the clock does not say
    end: str | None = None  # UTC, ISO 8601, of the last row
    sample_rate: float | None = None  # Hz; None where recordings differ
    topic: str | None = None  # of the IMU, in ROS bags
    sensor_ids: dict[str, int] = {}  # PX4's numbers of the sensors, in ULogs


class EffectRecord(_Strict, frozen=True):
    """One number of a named effect, as the diagnosis states it."""

    name: str  # of the catalogue
    channels: tuple[str, ...]  # such as gyro_y
    parameter: str  # coefficient, amplitude, or a setting such as time_constant
    value: float  # in `unit`
    std: float | None  # in `unit`; None: not determined
    unit: str  # SI


class Record(_Strict, frozen=True):
    """The document."""

    schema: str  # inertiax.record/1
    created: str  # UTC, ISO 8601
    command: str  # as it was typed
    software: dict[str, str]  # versions by name
    calibration_sha256: str  # of the `calibration.json` beside it
    inputs: tuple[InputFile, ...]  # `campaign.toml` first
    station: StationRecord  # as the campaign states it
    conditions: ConditionsRecord  # as recorded
    method: str  # of the estimation, such as gauss-newton
    verdict: str  # good | usable | doubtful, as the report says
    findings: tuple[str, ...]  # of the verdict, where something asks for attention
    choices: tuple[str, ...]  # what the program chose, and why
    warnings: tuple[str, ...]  # of data and estimation
    left_out: tuple[str, ...]  # of the rests, in words
    accel: TriadRecord | None  # None where not calibrated
    gyro: TriadRecord | None  # likewise
    mag: TriadRecord | None = None  # likewise
    effects: tuple[EffectRecord, ...] = ()  # that a diagnosis fitted beside the parameters


def write_record(record: Record, folder: Path) -> None:
    """Write `record.json`, whole or not at all."""
    path = folder / FILE
    write_atomically(path, encode(record, str(path), indent=1))


def read_record(folder: Path) -> Record:
    """The record of a results folder.

    Raises `ValueError`, one line that names the file, where there is none, it is damaged, or it belongs to another
    `calibration.json` than the one beside it.
    """
    path = folder / FILE
    if not path.is_file():
        raise ValueError(
            f"{folder}: holds no {FILE}, which says what the calibration was made of; write the results anew with "
            "`inertiax calibrate` or `inertiax diagnose`."
        )
    record = decode(path.read_bytes(), Record, str(path), "a calibration's record", SCHEMA)
    if record.calibration_sha256 != digest_of(folder / "calibration.json"):
        raise ValueError(
            f"{folder / 'calibration.json'}: is not the file that {FILE} belongs to; write the results anew."
        )
    return record


def doubt_about(calibration: Path) -> str | None:
    """That the record beside a `calibration.json` says not to use it yet, and why; `None` where it does not, or where
    there is none."""
    try:
        known = read_record(calibration.parent)
    except ValueError:
        return None
    if calibration.name != "calibration.json" or known.verdict != "doubtful":
        return None
    why = next(iter((*known.findings, *known.warnings)), "")
    return f"{calibration}: do not use it yet{': ' if why else ''}{why}"


def was_made_of(calibration: Path, file: Path) -> bool:
    """Whether the record beside a `calibration.json` lists a file, by its content, among those that it was made of."""
    try:
        known = read_record(calibration.parent)
    except ValueError:
        return False
    size = file.stat().st_size
    alike = {one.sha256 for one in known.inputs if one.bytes == size}
    return bool(alike) and digest_of(file) in alike


def wrong_parameters(calibration: Path) -> tuple[str, ...]:
    """What the record beside a `calibration.json` says of outputs that a flight controller had corrected."""
    try:
        known = read_record(calibration.parent)
    except ValueError:
        return ()
    if calibration.name != "calibration.json":
        return ()
    return tuple(w for w in known.warnings if WRONG_PARAMETERS in w)


def digest_of(file: Path) -> str:
    """SHA-256 of a file's content, in hexadecimal digits."""
    return hashlib.sha256(file.read_bytes()).hexdigest()
