"""A calibration applied to a recording file: the same table with compensated columns."""

import tomllib
from pathlib import Path
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import msgspec
import numpy as np
import polars as pl
from jaxtyping import Array, Bool, Float

from .calibration import Calibration, TriadCalibration
from .formats import ColumnMap, csv, detect, Layout, parquet, table as tables
from .formats.columns import AXES
from .recordings import Recording
from .temperature import Constant


_CHUNK = 65536  # samples compensated at a time: one compilation, little memory


class Compensated(NamedTuple):
    """A compensated table and what to know about it."""

    table: pl.DataFrame
    num_extrapolated: int
    notes: tuple[str, ...]


def compensate_file(
    calibration: Calibration,
    path: Path,
    *,
    campaign: Path | None = None,
    any_device: bool = False,
) -> Compensated:
    """The table of a CSV or Parquet recording with its outputs compensated, equation (3), named effects included.

    Columns accel_x/y/z (m/s²) and gyro_x/y/z (rad/s) hold the result, and `extrapolated` says
    where the temperature is outside `calibration.temperature_range`; all others are kept as they are.
    `campaign` is a `campaign.toml` (or its folder) whose `[columns]` name the columns and units.

    Raises `ValueError` where a column that the calibration needs is missing, or where the recording
    says that it is of another device.
    """
    columns, layout = _mapping(campaign)
    table = _read(path, layout)
    recording = _one_recording(table, columns, layout, path.name)
    _check_device(calibration, recording, path.name, any_device)
    _check_columns(calibration, recording, path.name)
    force, rate, outside, left_out = _compensate(calibration, recording)
    notes = _notes(calibration, recording, outside, path.name)
    notes += tuple(f"{path.name}: {line}" for line in left_out)
    new = {"extrapolated": outside}
    for name, triad in (("accel", force), ("gyro", rate)):
        if triad is not None:
            new |= {f"{name}_{axis}": triad[:, k] for k, axis in enumerate(AXES)}
    kept = table.slice(layout.start_row)
    return Compensated(kept.with_columns(**new), int(outside.sum()), notes)


def compensate_recording(
    calibration: Calibration, recording: Recording
) -> tuple[
    Float[np.ndarray, "time 3"] | None,
    Float[np.ndarray, "time 3"] | None,
    Bool[np.ndarray, " time"],
]:
    """Specific force (m/s²), rate (rad/s), and where the temperature is outside the calibration's.

    A triad that was not recorded is `None`; one that was not calibrated is returned as it is. Named
    effects of the calibration are taken away too, where the recording lets compute them.
    """
    return _compensate(calibration, recording)[:3]


def _compensate(
    calibration: Calibration, recording: Recording
) -> tuple[np.ndarray | None, np.ndarray | None, np.ndarray, tuple[str, ...]]:
    """`compensate_recording` and a line for each effect that is not taken away."""
    force, rate, outside = _by_parameters(calibration, recording)
    notes: tuple[str, ...] = ()
    if calibration.effects:
        from .diagnose import augmented  # only here: it loads the whole diagnosis

        made = augmented.compensate(calibration, recording)
        force, rate, notes = made.accel, made.gyro, made.notes
    return force, rate, outside, notes


def _by_parameters(
    calibration: Calibration, recording: Recording
) -> tuple[np.ndarray | None, np.ndarray | None, np.ndarray]:
    """Sample by sample, in chunks."""
    count = recording.num_samples
    zeros = np.zeros((count, 3))
    accel = zeros if recording.accel is None else recording.accel
    gyro = zeros if recording.gyro is None else recording.gyro
    temperature = np.zeros(count) if recording.temperature is None else recording.temperature[:, 0]
    parts = []
    for start in range(0, count, _CHUNK):
        rows = slice(start, start + _CHUNK)
        length = len(accel[rows])
        # The last chunk is padded, so that it needs no compilation of its own.
        size = _CHUNK if count > _CHUNK else count
        pad = ((0, size - length), (0, 0))
        out = _compensate_chunk(
            calibration,
            np.pad(accel[rows], pad),
            np.pad(gyro[rows], pad),
            np.pad(temperature[rows], pad[0]),
        )
        parts.append([np.asarray(x)[:length] for x in out])
    force, rate, outside = (np.concatenate(x) for x in zip(*parts, strict=True))
    if recording.temperature is None:
        outside = np.zeros(count, bool)
    return (
        None if recording.accel is None else force,
        None if recording.gyro is None else rate,
        outside,
    )


@eqx.filter_jit
def _compensate_chunk(
    calibration: Calibration,
    accel: Float[np.ndarray | Array, "time 3"],
    gyro: Float[np.ndarray | Array, "time 3"],
    temperature: Float[np.ndarray | Array, " time"],
) -> tuple[Array, Array, Array]:
    force, rate = jax.vmap(calibration)(
        jnp.asarray(accel), jnp.asarray(gyro), jnp.asarray(temperature)
    )
    return force, rate, jax.vmap(calibration.extrapolates)(jnp.asarray(temperature))


def _mapping(campaign: Path | None) -> tuple[ColumnMap, Layout]:
    """`[columns]` and the layout under `[recordings]` of a campaign."""
    if campaign is None:
        return ColumnMap(), Layout()
    file = campaign / "campaign.toml" if campaign.is_dir() else campaign
    try:
        raw = tomllib.loads(file.read_text("utf-8-sig"))
        columns = msgspec.convert(raw.get("columns", {}), ColumnMap)
        said = raw.get("recordings", {})
        layout = msgspec.convert({k: said[k] for k in ("names", "start_row") if k in said}, Layout)
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ValueError(f"{file}: not valid TOML: {error}.") from None
    except msgspec.ValidationError as error:
        raise ValueError(f"{file}: [columns] or [recordings]: {error}.") from None
    return columns, layout


def _read(path: Path, layout: Layout) -> pl.DataFrame:
    chosen = detect.detect(path)
    if chosen is parquet:
        try:
            return pl.read_parquet(path, hive_partitioning=False, glob=False)
        except (pl.exceptions.PolarsError, OSError) as error:
            reason = str(error).splitlines()[0]
            raise ValueError(f"{path.name}: the Parquet file is damaged: {reason}.") from None
    if chosen is not csv:
        raise ValueError(f"{path.name}: a CSV or Parquet recording is needed.")
    return _typed(csv.read_table(path, layout.names))


def _typed(table: pl.DataFrame) -> pl.DataFrame:
    """Columns of text as whole numbers or numbers where every field is one."""
    columns = []
    for column in table.get_columns():
        for kind in (pl.Int64, pl.Float64):
            number = column.str.strip_chars().cast(kind, strict=False)
            if number.null_count() == column.null_count() and not column.is_null().all():
                column = number
                break
        columns.append(column)
    return pl.DataFrame(columns)


def _one_recording(table: pl.DataFrame, columns: ColumnMap, layout: Layout, name: str) -> Recording:
    recordings = tables.to_recordings(table, columns, layout, name=name)
    if len(recordings) > 1:
        shown = ", ".join([r.device for r in recordings[:5]] + ["…"] * (len(recordings) > 5))
        raise ValueError(
            f"{name}: holds {len(recordings)} devices ({shown}), but a "
            f"calibration is of one; write each device's rows to a file of its own."
        )
    return next(iter(recordings))


def _check_device(
    calibration: Calibration, recording: Recording, name: str, any_device: bool
) -> None:
    ours, theirs = calibration.device, recording.device
    if ours and theirs and ours != theirs and not any_device:
        raise ValueError(
            f"{name}: recorded by device '{theirs}', but the calibration is of '{ours}'; give the "
            f"calibration of '{theirs}', or --any-device to apply it all the same."
        )


def _check_columns(calibration: Calibration, recording: Recording, name: str) -> None:
    triads = [t for t in (calibration.accel, calibration.gyro) if t is not None]
    by_temperature = any(not isinstance(t.curve.basis, Constant) for t in triads)
    if by_temperature and recording.temperature is None:
        raise ValueError(
            f"{name}: no temperature column, but the calibration depends on temperature; record it, "
            f"or map it with --campaign."
        )
    gyro = calibration.gyro
    by_force = gyro is not None and any("g_sensitivity" in n for n in gyro.names)
    if by_force and recording.gyro is not None and recording.accel is None:
        raise ValueError(
            f"{name}: no accelerometer columns, but the gyros' g-sensitivity was calibrated and needs "
            f"them to be compensated."
        )
    usable = (calibration.accel, recording.accel), (calibration.gyro, recording.gyro)
    if not any(c is not None and r is not None for c, r in usable):
        raise ValueError(
            f"{name}: the calibration is of the {_named(calibration.accel)}, which it does not hold."
        )


def _named(accel: TriadCalibration | None) -> str:
    return "gyros" if accel is None else "accelerometers"


def _notes(
    calibration: Calibration, recording: Recording, outside: np.ndarray, name: str
) -> tuple[str, ...]:
    notes = []
    for triad, label in (("accel", "accelerometers"), ("gyro", "gyros")):
        if getattr(recording, triad) is not None and getattr(calibration, triad) is None:
            notes.append(f"{name}: the {label} were not calibrated and are left as recorded")
    if outside.any() and calibration.temperature_range is not None:
        low, high = calibration.temperature_range
        assert recording.temperature is not None
        probe = recording.temperature[:, 0]
        notes.append(
            f"{name}: {int(outside.sum())} of {len(outside)} rows at {probe.min():.1f}…"
            f"{probe.max():.1f} °C are outside the calibrated {low:.1f}…{high:.1f} °C; see the column "
            f"'extrapolated'"
        )
    return tuple(notes)
