"""Which column of a file means what, and in which unit: the `[columns]` table of a campaign.

The strings that users write are understood here and nowhere else; everything past this file is SI
(temperatures in °C). A `g` is the standard 9.80665 m/s², as sensor makers use it, never the local one.
"""

import difflib
import math
from collections.abc import Iterable
from typing import Any, Literal

import msgspec
import numpy as np
from jaxtyping import Float

from ...storage.harmless_text import short
from .turntable import Turntable


AXES = ("x", "y", "z")
TIME_UNITS = {
    "s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0, "d": 86400.0,
    "0.1 ms": 1e-4,  # the clock of an Xsens MTi
}  # fmt: skip
ACCEL_UNITS = {
    "m/s^2": 1.0, "m/s2": 1.0, "m/s²": 1.0, "g": 9.80665, "mg": 9.80665e-3, "cm/s^2": 1e-2, "mm/s^2": 1e-3,
}  # fmt: skip
GYRO_UNITS = {"rad/s": 1.0, "deg/s": math.pi / 180, "deg/h": math.pi / 180 / 3600}
ANGLE_UNITS = {"deg": math.pi / 180, "rad": 1.0, "arcsec": math.pi / 180 / 3600}
# °C = scale · (value + shift)
TEMPERATURE_UNITS = {
    "degC": (1.0, 0.0),
    "°C": (1.0, 0.0),
    "K": (1.0, -273.15),
    "degF": (1 / 1.8, -32.0),
    "°F": (1 / 1.8, -32.0),
}

SUPPLY_UNITS = {"V": 1.0, "mV": 1e-3}
# T first; a gauss is 1e-4 T, and mgauss is how flight controllers log it.
MAG_UNITS = {
    "T": 1.0, "mT": 1e-3, "uT": 1e-6, "µT": 1e-6, "nT": 1e-9,
    "gauss": 1e-4, "G": 1e-4, "mgauss": 1e-7, "mG": 1e-7,
}  # fmt: skip
CURRENT_UNITS = {"A": 1.0, "mA": 1e-3}
PRESSURE_UNITS = {"Pa": 1.0, "hPa": 100.0, "mbar": 100.0, "kPa": 1e3, "bar": 1e5}
_TRIAD_UNITS = {"accel": ACCEL_UNITS, "gyro": GYRO_UNITS, "mag": MAG_UNITS}


class _Strict(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A table in which an unknown key is an error."""


class TimeColumn(_Strict, frozen=True):
    """`name` and `unit` of the stamps; or `rate` (Hz) where a log has no usable clock, and then
    time is row number / rate. `row_index = true` says the same in words and needs `rate`. `mend = true` puts a few
    stamps that repeat or go back between their neighbours. `gyro_name` is that of the stamps in the gyros' files, where
    these are apart and call them otherwise."""

    name: str | None = None
    gyro_name: str | None = None
    unit: str = "s"
    rate: float | None = None
    row_index: bool = False
    mend: bool = False


class TriadColumns(_Strict, frozen=True):
    """Three columns of one triad.

    `unit = "count"` is for raw converter readings: SI = (count − `offset`) · `scale`, with
    `scale_unit` saying what a scale means, e.g. "m/s^2 per count" or "count per m/s^2".
    """

    names: tuple[str, str, str] | None = None
    unit: str | None = None
    scale: float | tuple[float, float, float] | None = None
    scale_unit: str | None = None
    offset: float | tuple[float, float, float] | None = None


class ProbeColumns(_Strict, frozen=True):
    """One temperature column (`name`) or several (`names`); the first is the device's own probe.

    `unit = "count"` is for raw converter readings, as for a triad: °C = (count − `offset`) · `scale`, with
    `scale_unit` "degC per count" or "count per degC".
    """

    name: str | None = None
    names: tuple[str, ...] | None = None
    unit: str = "degC"
    scale: float | None = None
    scale_unit: str | None = None
    offset: float | None = None


class AngleColumns(_Strict, frozen=True):
    """A column of each axis of a table, the outermost first."""

    names: tuple[str, ...]
    unit: str = "deg"


class RateColumns(_Strict, frozen=True):
    """The rate of each axis of a table, the outermost first."""

    names: tuple[str, ...]
    unit: str = "deg/s"


class SupplyColumn(_Strict, frozen=True):
    """The voltage that feeds the device."""

    name: str | None = None
    unit: str = "V"


class CurrentColumn(_Strict, frozen=True):
    """The current whose field the magnetometers feel."""

    name: str | None = None
    unit: str = "A"


class PressureColumn(_Strict, frozen=True):
    """The barometer's output."""

    name: str | None = None
    unit: str = "Pa"


class LabelColumn(_Strict, frozen=True):
    """A column of labels: device, experiment or position."""

    name: str


class PositionColumn(_Strict, frozen=True):
    """A column of positions by `name`; or `row_index = true` where each row is the mean of one pose.

    `moving` is the label that the column has while the device moves, where that is not −1; several are a list.
    """

    name: str | None = None
    row_index: bool = False
    moving: int | tuple[int, ...] | None = None

    @property
    def moving_labels(self) -> tuple[int, ...]:
        """Labels that stand for −1."""
        said = self.moving
        return () if said is None else (said,) if isinstance(said, int) else said


class ColumnMap(_Strict, frozen=True):
    """What the `[columns]` table says. A key that is absent means canonical names and SI units."""

    time: TimeColumn | str | None = None
    accel: TriadColumns | None = None
    gyro: TriadColumns | None = None
    temperature: ProbeColumns | str | None = None
    reference_accel: TriadColumns | None = None
    reference_gyro: TriadColumns | None = None
    device: LabelColumn | str | None = None
    experiment: LabelColumn | str | None = None
    position: PositionColumn | str | None = None
    supply: SupplyColumn | str | None = None
    mag: TriadColumns | None = None
    current: CurrentColumn | str | None = None
    pressure: PressureColumn | str | None = None
    table_angles: AngleColumns | None = None
    table_rates: RateColumns | None = None
    table_time: TimeColumn | str | None = None  # of `table_files`
    temperature_time: TimeColumn | str | None = None  # of `temperature_files`, as `temperature` is

    def of_files(self, layout: "Layout") -> "ColumnMap":
        """What it says of the device's own files of that layout: those of the gyros alone have stamps of their own, and
        what says how a temperature's log is read says nothing of them."""
        made, time = self, self.time
        if layout.triad == "gyro" and isinstance(time, TimeColumn) and time.gyro_name is not None:
            time = msgspec.structs.replace(time, name=time.gyro_name, gyro_name=None)
            made = msgspec.structs.replace(made, time=time)
        if layout.temperature_log is not None:
            made = msgspec.structs.replace(made, temperature=None)
        return made

    def label(self, key: Literal["device", "experiment", "position"]) -> str | None:
        """Column name that the campaign gives for a label, `None` where it gives none."""
        said = getattr(self, key)
        return said.name if isinstance(said, LabelColumn | PositionColumn) else said

    @property
    def each_row_is_a_pose(self) -> bool:
        """Whether the campaign says that each row is the mean of one pose.

        Raises `ValueError` where it names a column of positions as well.
        """
        said = self.position
        if not isinstance(said, PositionColumn) or not said.row_index:
            return False
        if said.name is not None:
            raise ValueError(
                f"[columns] position: both name = '{said.name}' and row_index are given; name the column of "
                "positions, or write row_index = true where each row is the mean of one pose."
            )
        return True


class Layout(_Strict, frozen=True):
    """How rows lie in a file, beyond what it shows itself; a format lists the keys it knows in `KEYS`."""

    names: tuple[str, ...] | None = None  # column names of a file without a header line
    gyro_names: tuple[str, ...] | None = None  # the same of the gyros' files, where they differ
    start_row: int = 0  # data rows to leave out at the start
    header_line: int | None = None  # the line of a text that holds the names, counted from 1
    triad: Literal["accel", "gyro"] | None = None  # the only triad a single-triad file holds
    group: str | None = None  # HDF5 group or table, MATLAB struct
    topic: str | None = None  # ROS or ULog topic
    temperature_topic: str | None = None  # ROS topic of the probe
    instance: int | None = None  # which IMU of a flight controller's log
    sections: str | None = None  # imucal's list of sections, beside the session
    turn_angle: float | None = None  # deg, of imucal's turns
    gravity: float | None = None  # m/s², for references that are made
    latitude: float | None = None  # rad, likewise
    turntable: Turntable = Turntable()  # whose angles [columns] names
    table_log: Any = None  # a `TableMotion`, where the table writes a log of its own
    temperature_log: Any = None  # a `TemperatureLog`, where the temperature was logged apart

    @property
    def said_names(self) -> tuple[str, ...] | None:
        """The column names that the campaign gives for the file that is read."""
        return self.gyro_names if self.triad == "gyro" and self.gyro_names else self.names


def time_scale(column: TimeColumn, where: str) -> float:
    """Seconds per unit of the time column. Raises `ValueError` for contradictory or unknown keys."""
    if column.rate is not None and not (math.isfinite(column.rate) and column.rate > 0):
        raise ValueError(
            f"{where} time: rate must be a positive number of Hz; found {column.rate:g}."
        )
    for key in ("name", "gyro_name"):
        if column.rate is not None and getattr(column, key) is not None:
            raise ValueError(
                f"{where} time: both {key} = '{getattr(column, key)}' and rate are given; write name and unit to "
                "use the stamps, or rate alone to count rows."
            )
    if column.rate is not None and column.mend:
        raise ValueError(
            f"{where} time: both mend and rate are given; counted rows have no stamps to mend."
        )
    if column.row_index and column.rate is None:
        raise ValueError(f"{where} time: row_index = true needs rate, the samples per second.")
    return TIME_UNITS[_known(column.unit, TIME_UNITS, f"{where} time")]


def triad_factors(
    column: TriadColumns, kind: Literal["accel", "gyro", "mag"], where: str
) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
    """Offset and factor of each axis, SI = (value − offset) · factor.

    Raises `ValueError` for an unknown unit and for scale, scale_unit or offset without raw counts.
    """
    units = _TRIAD_UNITS[kind]
    unit = column.unit or next(iter(units))
    if unit != "count":
        _refuse_count_keys(column, unit, where)
        return np.zeros(3), np.full(3, units[_known(unit, units, where)])
    if column.scale is None:
        raise ValueError(
            f'{where}: unit = "count" needs scale (and scale_unit, for example '
            f'"count per {next(iter(units))}"), the nominal scale of the data sheet.'
        )
    scale = np.broadcast_to(np.asarray(column.scale, float), (3,))
    if not np.isfinite(scale).all() or np.any(scale == 0):
        raise ValueError(f"{where}: scale must be finite and not zero; found {scale.tolist()}.")
    offset = 0.0 if column.offset is None else column.offset
    offset = np.broadcast_to(np.asarray(offset, float), (3,))
    return offset, _scale_to_si(scale, column.scale_unit, units, where)


def _refuse_count_keys(column: TriadColumns | ProbeColumns, unit: str, where: str) -> None:
    for key in ("scale", "scale_unit", "offset"):
        if getattr(column, key) is not None:
            raise ValueError(
                f"{where}: {key} belongs to raw counts, but unit is '{unit}'; "
                'write unit = "count" or leave it out.'
            )


def _scale_to_si(
    scale: Float[np.ndarray, "3"], scale_unit: str | None, units: dict[str, float], where: str
) -> Float[np.ndarray, "3"]:
    si = next(iter(units))
    if scale_unit is None:
        return scale
    above, per, below = scale_unit.replace(" per ", "|").partition("|")
    if per and below == "count" and above in units:
        return scale * units[above]
    if per and above == "count" and below in units:
        return units[below] / scale
    raise ValueError(
        f"{where}: scale_unit '{scale_unit}' is not understood; write \"{si} per count\" or "
        f'"count per {si}", where the unit is one of {", ".join(units)}.'
    )


def temperature_factors(column: ProbeColumns, where: str) -> tuple[float, float]:
    """Scale and shift, °C = scale · (value + shift).

    Raises `ValueError` for an unknown unit and for scale, scale_unit or offset without raw counts.
    """
    if column.unit != "count":
        _refuse_count_keys(column, column.unit, where)
        known = {**TEMPERATURE_UNITS, "count": (1.0, 0.0)}  # for the message
        return known[_known(column.unit, known, where)]
    if column.scale is None or not math.isfinite(column.scale) or column.scale == 0:
        raise ValueError(
            f'{where}: unit = "count" needs scale (and offset), finite and not zero, of the data sheet: '
            f"°C = (count − offset) · scale; found {column.scale}."
        )
    scale = _scale_to_si(np.full(3, column.scale), column.scale_unit, {"degC": 1.0}, where)
    return float(scale[0]), -(column.offset or 0.0)


def angle_scale(unit: str, where: str) -> float:
    """Radians per unit."""
    return ANGLE_UNITS[_known(unit, ANGLE_UNITS, where)]


def rate_scale(unit: str, where: str) -> float:
    """rad/s per unit."""
    return GYRO_UNITS[_known(unit, GYRO_UNITS, where)]


def supply_scale(unit: str, where: str) -> float:
    """Volts per unit."""
    return SUPPLY_UNITS[_known(unit, SUPPLY_UNITS, where)]


def current_scale(unit: str, where: str) -> float:
    """Amperes per unit."""
    return CURRENT_UNITS[_known(unit, CURRENT_UNITS, where)]


def pressure_scale(unit: str, where: str) -> float:
    """Pascals per unit."""
    return PRESSURE_UNITS[_known(unit, PRESSURE_UNITS, where)]


def _known(unit: str, units: Iterable[str], where: str) -> str:
    if unit not in units:
        raise ValueError(
            f"{where}: unit '{unit}' is not known; {nearest(unit, units)}use one of {', '.join(units)}."
        )
    return unit


def numbered_name(name: str, number: int) -> str:
    """What the column of that number, from 1, is called where a header has a name more than once."""
    return f"{name} ({number})"


def nearest(name: str, names: Iterable[str]) -> str:
    """ "did you mean 'x'? " with the likeliest of `names`, or nothing where none is near."""
    # Comparing takes time with the square of the length: hostile names are not compared.
    by_case = {n.lower(): n for n in list(names)[:1000] if len(n) < 80}
    close = difflib.get_close_matches(name.lower()[:80], list(by_case), n=1, cutoff=0.6)
    return f"did you mean '{by_case[close[0]]}'? " if close else ""


def shown(names: Iterable[str]) -> list[str]:
    """Names of a file's columns or topics as a message repeats them: the first few, none of them long."""
    listed = list(names)
    few = [short(n) for n in listed[:_MOST_SHOWN]]
    return [*few, "…"] if len(listed) > _MOST_SHOWN else few


_MOST_SHOWN = 16

CANONICAL = ColumnMap()  # the contract's column names, in SI
AS_FOUND = Layout()  # a file that says everything itself
