"""Recordings and campaigns: what was measured, in SI units, checked when built.

Host data (NumPy), large and never traced; dwell means made from it go to JAX.
"""

from pathlib import Path

import equinox as eqx
import numpy as np
from jaxtyping import Float, Int


class Recording(eqx.Module):
    """One continuous log of one device.

    Columns are those of the campaign format; a column that was not recorded is `None`.
    Raises `ValueError` where a column has the wrong length, is not finite, or where time does not
    increase strictly; the message names recording, column and first bad row.
    """

    time: Float[np.ndarray, " time"]  # s
    accel: Float[np.ndarray, "time 3"] | None = None  # m/s²
    gyro: Float[np.ndarray, "time 3"] | None = None  # rad/s
    temperature: Float[np.ndarray, "time probes"] | None = (
        None  # °C, column 0 is the device's probe
    )
    experiment: Int[np.ndarray, " time"] | None = None  # run of the programme (chamber setting)
    position: Int[np.ndarray, " time"] | None = None  # at rest; -1 while the table turns
    reference_accel: Float[np.ndarray, "time 3"] | None = None  # m/s², an ideal triad's reading
    reference_gyro: Float[np.ndarray, "time 3"] | None = None  # rad/s, Earth rate included
    supply: Float[np.ndarray, " time"] | None = None  # V
    device: str = eqx.field(static=True, default="")  # serial number
    name: str = eqx.field(static=True, default="")  # where it came from, for messages

    def __check_init__(self):
        where = f"recording '{self.name}'" if self.name else "`Recording(...)`"
        num = self.time.shape[0]
        if num == 0:
            raise ValueError(f"{where}: no rows; at least one sample is needed.")
        if self.accel is None and self.gyro is None:
            raise ValueError(
                f"{where}: neither accelerometer nor gyro columns; at least one triad is needed."
            )
        for label in _COLUMNS:
            values = getattr(self, label)
            if values is None:
                continue
            if values.shape[0] != num:
                raise ValueError(
                    f"{where}: '{label}' has {values.shape[0]} rows but 'time' has {num}."
                )
            if values.dtype.kind == "f" and not np.isfinite(values).all():
                row = int(np.argmax(~np.isfinite(values).reshape(num, -1).all(axis=1)))
                raise ValueError(
                    f"{where}: '{label}' is not a finite number in row {row} (time "
                    f"{self.time[row]:g} s); every sample must be a number, so drop or repair it."
                )
        steps = np.diff(self.time)
        if np.any(steps <= 0):
            row = int(np.argmax(steps <= 0)) + 1
            raise ValueError(
                f"{where}: 'time' must increase strictly, but row {row} ({self.time[row]:.6f} s) "
                f"does not come after row {row - 1} ({self.time[row - 1]:.6f} s)."
            )

    @property
    def num_samples(self) -> int:
        """Number of rows."""
        return int(self.time.shape[0])

    def __getitem__(self, rows: slice | np.ndarray) -> "Recording":
        """The same recording, only those rows."""
        columns = {k: v[rows] for k in _COLUMNS if (v := getattr(self, k)) is not None}
        return Recording(**columns, device=self.device, name=self.name)


_COLUMNS = (
    "time",
    "accel",
    "gyro",
    "temperature",
    "experiment",
    "position",
    "reference_accel",
    "reference_gyro",
    "supply",
)


class Site(eqx.Module):
    """The test place."""

    gravity: float = eqx.field(static=True, default=9.80665)  # m/s²
    latitude: float | None = eqx.field(static=True, default=None)  # rad


class Rig(eqx.Module):
    """What the station promises, 1 sigma. `None` where it says nothing."""

    position_uncertainty: float | None = eqx.field(
        static=True, default=None
    )  # rad, each positioning
    rate_uncertainty: float | None = eqx.field(static=True, default=None)  # relative to the rate
    temperature_uncertainty: float | None = eqx.field(static=True, default=None)  # °C


class ModelChoice(eqx.Module):
    """The model that the user means to fit; `None` lets the tool choose and say so."""

    accel_estimator: str | None = eqx.field(static=True, default=None)
    gyro_estimator: str | None = eqx.field(static=True, default=None)
    g_sensitivity: bool | None = eqx.field(static=True, default=None)
    temperature_degree: int | None = eqx.field(static=True, default=None)
    together: bool | None = eqx.field(static=True, default=None)  # both triads in one least squares
    lever_arms: bool | None = eqx.field(static=True, default=None)  # of the accelerometers
    misalignment: bool | None = eqx.field(static=True, default=None)  # of the gyros to them


class Campaign(eqx.Module):
    """Recordings of one or many devices, with the place, the rig and the model to fit."""

    recordings: tuple[Recording, ...]
    site: Site = Site()
    rig: Rig = Rig()
    model: ModelChoice = ModelChoice()
    grade: str | None = eqx.field(static=True, default=None)  # navigation | tactical | consumer
    path: Path | None = eqx.field(static=True, default=None)  # campaign.toml, if read from one
    notes: tuple[str, ...] = eqx.field(static=True, default=())  # what a reader should know

    @property
    def devices(self) -> tuple[str, ...]:
        """Serial numbers, in order of first appearance."""
        return tuple(dict.fromkeys(r.device for r in self.recordings))

    def of_device(self, device: str) -> "Campaign":
        """The same campaign with one device's recordings only."""
        chosen = tuple(r for r in self.recordings if r.device == device)
        if not chosen:
            raise ValueError(
                f"`Campaign.of_device({device!r})`: no such device; found {list(self.devices)}."
            )
        return Campaign(chosen, self.site, self.rig, self.model, self.grade, self.path, self.notes)
