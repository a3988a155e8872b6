"""Recordings and campaigns: what was measured, in SI units, checked when built.

Host data (NumPy), large and never traced; dwell means made from it go to JAX.
"""

import copy
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from .._records import field, Module
from .._typing import Given
from ..physics.leaves import as_plain, is_traced, real_numbers
from .frames import columns_of, Names, TRIADS
from .plausible_units import (
    check_earth_field,
    check_field,
    check_force,
    check_from_zero,
    check_gravity,
    check_rate,
    check_stamps_differ,
    check_steps,
    check_temperature,
    whole_numbers,
)


HALF = 0.5  # of a positioning's variance: that both axes of a table err alike where nobody says (convention)


def _by_column(values: Any) -> Any:
    """An array whose columns lie in memory one after the other: sums, spreads and extremes along a log are found in
    them ten times as fast as where the axes of a sample stand side by side."""
    matrix = isinstance(values, np.ndarray) and values.ndim == 2
    return np.asfortranarray(values) if matrix else values


def _probes(values: Any) -> Any:
    """The temperature with a column for each probe; one probe's may be given as (time,)."""
    single = isinstance(values, np.ndarray) and values.ndim == 1
    return _by_column(values[:, None] if single else values)


def _together(recordings: Any) -> Any:
    """A tuple of recordings; one may be given alone."""
    return tuple(recordings) if isinstance(recordings, Iterable) else (recordings,)


def _matrix(**given: Any) -> Any:
    return field(converter=_by_column, **given)


class Recording(Module):
    """One continuous log of one device.

    Columns are those of the campaign format; a column that was not recorded is `None`.
    Raises `ValueError` where a column has the wrong length, is not finite, or where time does not
    increase strictly; the message names recording, column and first bad row.
    """

    time: Float[np.ndarray, " time"]  # s
    accel: Float[np.ndarray, "time 3"] | None = _matrix(default=None)  # m/s²
    gyro: Float[np.ndarray, "time 3"] | None = _matrix(default=None)  # rad/s
    temperature: Float[np.ndarray, "time probes"] | None = field(
        converter=_probes, default=None
    )  # °C, column 0 is the device's probe; (time,) is made (time, 1)
    experiment: Int[np.ndarray, " time"] | None = None  # run of the programme (chamber setting)
    position: Int[np.ndarray, " time"] | None = None  # at rest; -1 while the table turns
    # m/s², an ideal triad's reading
    reference_accel: Float[np.ndarray, "time 3"] | None = _matrix(default=None)
    # rad/s, Earth rate included
    reference_gyro: Float[np.ndarray, "time 3"] | None = _matrix(default=None)
    supply: Float[np.ndarray, " time"] | None = None  # V
    mag: Float[np.ndarray, "time 3"] | None = _matrix(default=None)  # T; NaN where it was not read
    current: Float[np.ndarray, " time"] | None = None  # A; NaN where it was not read
    pressure: Float[np.ndarray, " time"] | None = None  # Pa; NaN where it was not read
    device: str = field(static=True, default="")  # serial number
    name: str = field(static=True, default="")  # where it came from, for messages
    empty_rows: int = field(static=True, default=0)  # of its file without any value, left out
    repeated_rows: int = field(static=True, default=0)  # that say the row before again, left out
    temperature_step: float = field(static=True, default=0.0)  # s between its rows; 0: it is in all
    notes: tuple[str, ...] = field(static=True, default=())  # what its reader did to its values
    reservations: tuple[str, ...] = field(static=True, default=())  # and what it could not undo

    def __check_init__(self):
        where = f"recording '{self.name}'" if self.name else "`Recording(...)`"
        num = self.time.shape[0]
        if num == 0:
            raise ValueError(f"{where}: no rows; at least one sample is needed.")
        if self.accel is None and self.gyro is None and self.mag is None:
            lacking = "neither accelerometer nor gyro columns; at least one triad is needed."
            raise ValueError(f"{where}: {lacking}")
        for label in COLUMNS:
            values = getattr(self, label)
            if values is None:
                continue
            if is_traced(values):
                raise ValueError(f"{where}: a recording is of the host, not of traced code.")
            _check_shape(f"{where}: '{label}' has", label, values)
            if values.shape[0] != num:
                raise ValueError(
                    f"{where}: '{label}' has {values.shape[0]} rows but 'time' has {num}."
                )
            if values.dtype.kind != "f":
                continue
            sound = np.isfinite(values) | (np.isnan(values) & (label in WITH_GAPS))
            if not sound.all():
                row = int(np.argmax(~sound.reshape(num, -1).all(axis=1)))
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

    @classmethod
    def from_arrays(
        cls,
        time: Given | None = None,
        accel: Given | None = None,
        gyro: Given | None = None,
        temperature: Given | None = None,
        *,
        sample_rate: float | None = None,
        device: str = "",
        **columns: Given | None,
    ) -> "Recording":
        """A recording from arrays of samples.

        **Arguments:** `time` in s, increasing, or `sample_rate` in Hz instead; `accel` (m/s²) and `gyro` (rad/s)
        (time, 3); `temperature` (°C) (time,) or (time, probes); further columns by their names: `experiment`,
        `position`, `reference_accel`, `reference_gyro`, `supply`; `mag` (T) (time, 3), `current` (A) and `pressure`
        (Pa), which may have gaps of NaN.

        Raises `ValueError`, one line that names the argument, for shapes that do not fit and for numbers that are
        implausible in these units.
        """
        call = "Recording.from_arrays"
        given = {"accel": accel, "gyro": gyro, "temperature": temperature, **columns}
        unknown = sorted(set(given) - set(COLUMNS))
        if unknown:
            raise ValueError(f"`{call}({unknown[0]}=...)`: is no column of a recording.")
        made: dict[str, Any] = {k: _samples(call, k, v) for k, v in given.items() if v is not None}
        if (time is None) == (sample_rate is None):
            raise ValueError(f"`{call}(time=...)`: give either `time` (s) or `sample_rate` (Hz).")
        if sample_rate is not None:
            if not sample_rate > 0.0:
                raise ValueError(
                    f"`{call}(sample_rate=...)`: must be above 0 Hz; got {sample_rate}."
                )
            rows = len(next(iter(made.values()))) if made else 0
            made["time"] = np.arange(rows) / sample_rate
        else:
            made["time"] = _samples(call, "time", time)
            check_stamps_differ(call, time)
        _check_units(call, made)
        return cls(**made, device=device, name="")

    @classmethod
    def from_frame(
        cls, frame: Any, *, columns: Names | None = None, device: str = ""
    ) -> "Recording":
        """A recording from a table of polars, pandas, pyarrow or xarray, or from a mapping of columns.

        **Arguments:** columns are canonical (`time`, `accel_x`, …, `temperature`, `position`; SI and °C) or named by
        `columns`, such as `{"accel": ("ax", "ay", "az"), "time": "t"}`. A column of dates is taken as seconds.

        Raises `ValueError` as `from_arrays`, and for a column that is missing.
        """
        made = columns_of(frame, columns or {})
        if "time" not in made:
            raise ValueError(
                "`Recording.from_frame(frame)`: no column 'time'; name it by `columns`."
            )
        call = "Recording.from_frame"
        for name in sorted(WHOLE & made.keys()):
            made[name] = whole_numbers(f"{call}(frame): {name}", made[name])
        _check_units(call, made)
        return cls(**made, device=device)

    @property
    def num_samples(self) -> int:
        """Number of rows."""
        return int(self.time.shape[0])

    def __getitem__(self, rows: slice | np.ndarray) -> "Recording":
        """The same recording, only those rows."""
        columns = {k: v[rows] for k in COLUMNS if (v := getattr(self, k)) is not None}
        return Recording(**columns, device=self.device, name=self.name)


COLUMNS = (
    "time",
    "accel",
    "gyro",
    "temperature",
    "experiment",
    "position",
    "reference_accel",
    "reference_gyro",
    "supply",
    "mag",
    "current",
    "pressure",
)
WHOLE = {"experiment", "position"}  # whole numbers
WITH_GAPS = ("mag", "current", "pressure")  # NaN where a slower sensor was not read


def _check_shape(said: str, name: str, values: np.ndarray) -> None:
    """Raise `ValueError` for a column with other axes than its kind has."""
    if name in TRIADS:
        good, right = values.ndim == 2 and values.shape[1] == 3, "(time, 3)"
    elif name == "temperature":
        good, right = values.ndim == 2, "(time,) or (time, probes)"
    else:
        good, right = values.ndim == 1, "(time,)"
    if not good:
        raise ValueError(f"{said} shape {values.shape}; it must be {right}.")


def _samples(call: str, name: str, values: Any) -> np.ndarray:
    """An array of the column's kind and number of axes."""
    if is_traced(values):
        raise ValueError(f"`{call}({name}=...)`: a recording is of the host, not of traced code.")
    array = real_numbers(f"{call}({name}=...)", values)
    array = _probes(array) if name == "temperature" else array
    _check_shape(f"`{call}({name}=...)`:", name, array)
    return whole_numbers(f"{call}({name}=...)", array) if name in WHOLE else array


def _check_units(call: str, made: dict[str, Any]) -> None:
    if not len(made["time"]):
        raise ValueError(f"`{call}`: no rows; at least one sample is needed.")
    check_steps(call, made["time"], made.get("gyro"))
    for name, values in made.items():
        every = np.isfinite(values).reshape(len(values), -1).all(axis=1)
        if name == "temperature":
            check_temperature(call, values, every)
        elif name.endswith("accel"):
            check_force(call, name, values, every)
        elif name.endswith("gyro"):
            check_rate(call, name, values, every)
        elif name == "mag":
            check_field(call, values, every)


class Site(Module):
    """The test place.

    Raises `ValueError` for a gravity that is none in m/s², a latitude in degrees or a magnetic field that is none in T.
    """

    gravity: float = field(static=True, default=9.80665, converter=as_plain)  # m/s²
    # rad
    latitude: float | None = field(static=True, default=None, converter=as_plain)
    # T, magnitude
    magnetic_field: float | None = field(static=True, default=None, converter=as_plain)

    def __check_init__(self):
        check_earth_field("Site", self.magnetic_field)
        check_gravity("Site", self.gravity)
        if self.latitude is not None and not abs(self.latitude) <= np.pi / 2.0:
            raise ValueError(
                f"`Site(latitude=...)`: {self.latitude:g}; it is in rad, within ±π/2 (degrees?)."
            )


def _as_axes(given: Any) -> Any:
    """Two unit vectors as plain numbers."""
    return None if given is None else tuple(tuple(float(x) for x in axis) for axis in given)


class Rig(Module):
    """What the station promises, 1 sigma. `None` where it says nothing.

    Raises `ValueError` for numbers that are negative or implausible in these units.
    """

    # rad, each positioning
    position_uncertainty: float | None = field(static=True, default=None, converter=as_plain)
    # Relative to the rate
    rate_uncertainty: float | None = field(static=True, default=None, converter=as_plain)
    # °C
    temperature_uncertainty: float | None = field(static=True, default=None, converter=as_plain)
    # rad, of each of the two horizontal angles by which the table's base leans, the same all along
    level_uncertainty: float | None = field(static=True, default=None, converter=as_plain)
    # rad, by which the outer and the inner axis are not square, the same all along
    orthogonality_uncertainty: float | None = field(static=True, default=None, converter=as_plain)
    # Of a positioning's variance, the part that the outer axis has of a table with two; the inner one has the rest
    outer_part: float = field(static=True, default=HALF, converter=float)
    # Unit vectors of a table with two axes: the outer one in the room (north, west, up), the inner one in the case
    axes: tuple[tuple[float, ...], tuple[float, ...]] | None = field(
        static=True, default=None, converter=_as_axes
    )

    # °C, 1 sigma, of what a probe's whole steps hide of the temperature: found in the readings, stated by nobody
    hidden_by_steps: float = field(static=True, default=0.0, converter=float)

    def __check_init__(self):
        # Beyond these a station promises nothing: 30° of attitude, half of the rate, 50 °C.
        angles = ("position_uncertainty", "level_uncertainty", "orthogonality_uncertainty")
        most = {k: (0.5, "rad") for k in angles} | {"outer_part": (1.0, "of the variance")}
        most["rate_uncertainty"] = (0.5, "parts of the rate")
        most["temperature_uncertainty"] = (50.0, "°C")
        for key, (value, unit) in most.items():
            check_from_zero(f"Rig({key}=...)", getattr(self, key), value, unit)


NOT_CALIBRATED = "none"  # as an estimator, of a triad that is left as it is


class ModelChoice(Module):
    """The model that the user means to fit; `None` lets the tool choose and say so."""

    # Invariant | reference | static | none; None: the tool chooses.
    accel_estimator: str | None = field(static=True, default=None)
    # Reference | gravity | static | none; None: the tool chooses.
    gyro_estimator: str | None = field(static=True, default=None)
    g_sensitivity: bool | None = field(static=True, default=None)  # the gyros' matrix D
    # Of every parameter's polynomial; 0 = constant.
    temperature_degree: int | None = field(static=True, default=None, converter=as_plain)
    together: bool | None = field(static=True, default=None)  # both triads in one least squares
    lever_arms: bool | None = field(static=True, default=None)  # of the accelerometers
    misalignment: bool | None = field(static=True, default=None)  # of the gyros to them
    # Field | none; None: field where there are magnetometers.
    mag_estimator: str | None = field(static=True, default=None)


def restated(recording: Recording, **said: Any) -> Recording:
    """The same recording with another `device`, `notes` or `reservations`; no column is read or checked again."""
    own = copy.copy(recording)
    for name, value in said.items():
        object.__setattr__(own, name, value)
    return own


class Campaign(Module):
    """Recordings of one or many devices, with the place, the rig and the model to fit.

    `Campaign(recording, Site(gravity=9.81))` is that of one log. Raises `ValueError` for what is no recording.
    """

    recordings: tuple[Recording, ...] = field(converter=_together)  # of all devices; or one
    site: Site = Site()  # gravity and latitude
    rig: Rig = Rig()  # what the station promises, 1 sigma
    model: ModelChoice = ModelChoice()  # what the user wants to be fitted
    grade: str | None = field(static=True, default=None)  # navigation | tactical | consumer
    path: Path | None = field(static=True, default=None)  # campaign.toml, if read from one
    notes: tuple[str, ...] = field(static=True, default=())  # what a reader should know
    # Those of the notes that say how files of the two triads became one recording: no reservation on a calibration
    pairings: tuple[str, ...] = field(static=True, default=())

    def __check_init__(self):
        for each in self.recordings:
            if not isinstance(each, Recording):
                raise ValueError(
                    f"`Campaign(recordings=...)`: {type(each).__name__} is no Recording; make them by "
                    f"`Recording.from_arrays(time, accel, gyro)`."
                )

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
        further = (self.model, self.grade, self.path, self.notes, self.pairings)
        return Campaign(chosen, self.site, self.rig, *further)

    @property
    def reservations(self) -> tuple[str, ...]:
        """The notes that a result has to be read with."""
        return tuple(note for note in self.notes if note not in self.pairings)


def check_given_campaign(call: str, campaign: object) -> None:
    """Raise `ValueError` for what is no `Campaign`, with the call that makes one of it."""
    if not isinstance(campaign, Campaign):
        raise ValueError(
            f"`{call}`: {type(campaign).__name__} is no Campaign; a recording's is `Campaign(recording, "
            f"Site(gravity=...))`, a folder's `load_campaign(path)`."
        )
