"""Sizes of effects in the units that engineers use on data sheets."""

import math
from collections.abc import Sequence
from typing import NamedTuple, Protocol, runtime_checkable

from ..data.moments import since, unit_of_moments
from ..effects import CATALOGUE
from .quantities import DEG_PER_HOUR, with_sigma


_MICRO_G = 1e6 / 9.80665  # in a m/s²
_DEG = 180.0 / math.pi

# SI unit as the catalogue writes it: factor and customary unit.
CUSTOMARY = {
    "m/s^2": (_MICRO_G, "µg"),
    "m/s^2/g": (_MICRO_G, "µg/g"),
    "m/s^2/g^2": (_MICRO_G, "µg/g²"),
    "m/s^2/g^3": (_MICRO_G, "µg/g³"),
    "m/s^2/s": (3600.0 * _MICRO_G, "µg/h"),
    "m/s^2/V": (_MICRO_G, "µg/V"),
    "m/s^2/(degC/min)": (_MICRO_G, "µg/(°C/min)"),
    "rad/s": (DEG_PER_HOUR, "°/h"),
    "rad/s/g": (DEG_PER_HOUR, "°/h/g"),
    "rad/s/g^2": (DEG_PER_HOUR, "°/h/g²"),
    "rad/s/s": (3600.0 * DEG_PER_HOUR, "(°/h)/h"),
    "rad/s/V": (DEG_PER_HOUR, "°/h/V"),
    "rad/s/(degC/min)": (DEG_PER_HOUR, "°/h/(°C/min)"),
    "rad/s/(rad/s)^2": (DEG_PER_HOUR / _DEG**2, "(°/h)/(°/s)²"),
    "rad/s/(rad/s)^3": (DEG_PER_HOUR / _DEG**3, "(°/h)/(°/s)³"),
    "m/s^2/(degC/min/s)": (_MICRO_G, "µg/(°C/min/s)"),
    "rad/s/(degC/min/s)": (DEG_PER_HOUR, "°/h/(°C/min/s)"),
    "1/s": (3.6e9, "ppm/h"),
    "1/(degC/min)": (1e6, "ppm/(°C/min)"),
    "(rad/s)/(rad/s)": (1e6, "ppm"),
    "rad": (3600.0 * _DEG, "arcsec"),
    "m": (1e3, "mm"),
    "1": (1e6, "ppm"),
    "Hz": (1e3, "mHz"),
}
_OF_THE_STATION = {effect.name for effect in CATALOGUE if effect.common}
_COARSER = {"µg": (1e-3, "mg"), "°/h": (1.0 / 3600.0, "°/s"), "ppm": (1e-4, "%")}


def customary(size: float, unit: str) -> tuple[float, str]:
    """Factor from SI and the unit in which a value of about this size is shown.

    From 1000 µg, °/h or ppm (1 %) on the coarser unit is taken, with what it is divided by kept.
    """
    if unit == "s" and abs(size) < 1.0:
        return 1e3, "ms"
    factor, shown = CUSTOMARY.get(unit, (1.0, unit.replace("^2", "²").replace("degC", "°C")))
    for fine, (coarser, name) in _COARSER.items():
        limit = 1e4 if fine == "ppm" else 1e3
        if (shown == fine or shown.startswith(f"{fine}/")) and abs(size * factor) >= limit:
            return factor * coarser, shown.replace(fine, name, 1)
    return factor, shown


def in_words(name: str) -> str:
    """An effect's name as people read it."""
    return name.replace("_", " ")


@runtime_checkable
class Estimated(Protocol):
    """A number with its uncertainty, in the catalogue's unit."""

    @property
    def value(self) -> float:
        """In that unit."""
        ...

    @property
    def std(self) -> float | None:
        """The same; `None`: not determined."""
        ...

    @property
    def unit(self) -> str:
        """As the catalogue writes it."""
        ...


class Shown(NamedTuple):
    """A number with its uncertainty, in the catalogue's unit."""

    value: float
    std: float | None  # of any coverage; None: not determined
    unit: str


def shown_parameters(
    effect: str, parameters: Sequence[tuple[str, Estimated]], first: float = 0.0
) -> list[tuple[str, str, str, str]]:
    """Name, value, uncertainty and unit of an effect's parameters, those of one unit in one that suits the greatest."""
    greatest: dict[str, float] = {}
    for _, p in parameters:
        greatest[p.unit] = max(greatest.get(p.unit, 0.0), abs(p.value))
    return [
        (name, *shown_parameter(effect, name, p, first, size=greatest[p.unit]))
        for name, p in parameters
    ]


def shown_parameter(
    effect: str, name: str, parameter: Estimated, first: float = 0.0, *, size: float | None = None
) -> tuple[str, str, str]:
    """An effect's parameter as on a data sheet: value, uncertainty and unit, which is that for a value of `size`.

    Angles of the station are in arcsec, as the rig's; a sensor's misalignments in µrad, as its calibration's. A moment
    is one after the first row where the clock, `first` s at that row, counts from long before.
    """
    at_moment = name.partition(" ")[0] == "time"  # of several channels: "time (accel_x)"
    value = since(parameter.value, first) if at_moment else parameter.value
    factor, unit = customary(value if size is None or at_moment else size, parameter.unit)
    if at_moment and unit == "s":
        unit = unit_of_moments(first)
    if parameter.unit == "rad" and effect not in _OF_THE_STATION:
        factor, unit = 1e6, "µrad"
    if name.startswith("amplitude"):
        factor, unit = 1.0, "of what theory says"
    value, std = factor * value, parameter.std
    if std is None or not math.isfinite(std):
        return f"{value:.4g}", "not determined", unit
    return *with_sigma(value, factor * std), unit
