"""The rate of a table that turns about the vertical alone, among the columns of a log: its unit and its sense."""

import math
from typing import NamedTuple

import numpy as np

from ..data.formats.columns import GYRO_UNITS
from .accel_unit import TriadUnit
from .raw_triads import RawTriads
from .toml_text import Line


_ALIKE = 0.99  # correlation with the gyros' rate, from which a column is the rate that made it (convention)
_TURNING = 0.3  # of the fastest rate, from which rows tell unit and sense
_NEAR = 0.1  # of a unit: gyros and tables are better than that
_UPRIGHT = math.cos(math.radians(20.0))  # of gravity along the nearest axis of the device
_SAME = 0.95  # part of the rows that turn which agree


class UprightRate(NamedTuple):
    """A column of rates, and whether they are about up or down."""

    name: str
    unit: str
    axis: str
    others: tuple[str, ...] = ()  # columns of rates that are less like the gyros

    @property
    def line(self) -> Line:
        """`[columns] table_rates`."""
        value = {"names": [self.name], "unit": self.unit}
        why = "the rate at which the gyros turn, about the axis that gravity shows upright"
        if self.others:
            why += f", more than {' and '.join(self.others)} does"
        return Line("table_rates", value, why)


def upright_rate(found: RawTriads, accel: TriadUnit, gyro: TriadUnit) -> UprightRate | None:
    """The column that turns as the gyros do about the axis that points up, in a usual unit and on two faces of the
    device or more; `None` without one.

    Of a rate that was commanded and one that was measured it is the one that is more like the gyros.

    **Arguments:** `accel` and `gyro` are the units of the triads, of which offsets and factors are used.
    """
    names = rates_of_a_table(found, list(found.log.numbers))
    if found.accel is None or found.gyro is None or not names:
        return None
    name, others = names[0], tuple(sorted(names[1:]))
    rate = found.log.numbers[name]
    force = found.accel - (0.0 if accel.offset is None else np.asarray(accel.offset))
    output = (found.gyro - (0.0 if gyro.offset is None else np.asarray(gyro.offset))) * gyro.factor
    turning = np.abs(rate) > _TURNING * np.abs(rate).max()
    axis, rows = np.abs(force).argmax(axis=1), np.arange(len(rate))
    upright = np.abs(force[rows, axis]) > _UPRIGHT * np.linalg.norm(force, axis=1)
    if np.mean(upright[~turning]) < _SAME:
        return None
    faces = 2 * axis + (force[rows, axis] > 0.0)
    if len(np.unique(faces[turning & upright])) < 2:
        return None  # a filtered output of the device itself would look the same
    about_up = (output[rows, axis] * np.sign(force[rows, axis]))[turning] / rate[turning]
    ratio = float(np.median(about_up))
    if np.mean(np.sign(about_up) == np.sign(ratio)) < _SAME:
        return None
    for unit, factor in GYRO_UNITS.items():
        if abs(abs(ratio) / factor - 1.0) < _NEAR:
            return UprightRate(name, unit, "up" if ratio > 0.0 else "down", others)
    return None


def rates_of_a_table(found: RawTriads, names: list[str]) -> list[str]:
    """Those of the columns that have both signs and whose size goes with that of the gyros' rate, in any unit; the one
    that does so best comes first."""
    if found.gyro is None:
        return []
    taken = {*(found.gyro_columns or ()), *(found.roles.accel or ()), *(found.roles.mag or ())}
    speed = found.turning
    held = {n: found.log.numbers[n] for n in names if n in found.log.numbers and n not in taken}
    signed = {n: v for n, v in held.items() if len(v) == len(speed) and v.min() < 0.0 < v.max()}
    if not np.ptp(speed) > 0.0:
        return []
    alike = {n: float(np.corrcoef(np.abs(v), speed)[0, 1]) for n, v in signed.items()}
    return [n for n in sorted(alike, key=lambda n: -alike[n]) if alike[n] > _ALIKE]
