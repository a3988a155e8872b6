"""Parameters as people read them: labels, customary units, and values with their uncertainty."""

import math
from collections.abc import Sequence
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np

from .triad import TriadCalibration, unit_of


DEG_PER_HOUR = 3600.0 * 180.0 / math.pi  # in a rad/s
_AXES = "xyz"


class Quantity(NamedTuple):
    """One parameter in its customary unit."""

    name: str  # as in calibration.json, e.g. accel.bias[0]
    label: str  # in words, e.g. bias x
    value: float
    sigma: float
    unit: str


def label(name: str) -> str:
    """A parameter's name in words: `accel.matrix[1,0]` is "misalignment yx"."""
    kind, indices = name.partition(".")[2].rstrip("]").split("[")
    axes = "".join(_AXES[int(i)] for i in indices.split(","))
    if kind == "bias":
        return f"hard iron {axes}" if name.startswith("mag") else f"bias {axes}"
    if kind == "current":
        return f"field of the current {axes}"
    if kind == "g_sensitivity":
        return f"g-sensitivity {axes}"
    if kind == "lever_arm":
        return f"lever arm {axes}"
    return f"scale factor {axes[0]}" if axes[0] == axes[1] else f"misalignment {axes}"


def family(name: str) -> str:
    """Which parameters are drawn together: "bias", "scale factor", "misalignment", ..."""
    return label(name).rsplit(" ", 1)[0]


def customary_units(triad: TriadCalibration) -> tuple[tuple[float, str], ...]:
    """Factor from SI and unit in which each parameter is shown.

    Gyro biases are in °/h, or in °/s where one of them is beyond 1000 °/h.
    """
    (first,), _ = triad.over(np.array([triad.curve.basis.nodes[0]]))
    coarse = coarse_rates([float(v) for v, n in zip(first, triad.names) if ".bias" in n])
    return tuple(customary_unit(name, coarse=coarse) for name in triad.names)


def coarse_rates(biases: Sequence[float]) -> bool:
    """Whether one of the gyros' biases (rad/s) is beyond 1000 °/h, so that all are shown in °/s."""
    return max(map(abs, biases), default=0.0) * DEG_PER_HOUR > 1000.0


# A magnetometer's soft iron is per cents, and its axes are known to tenths of a degree.
_MAGNETIC = {
    "hard iron": (1e6, "µT"),
    "field of the current": (1e6, "µT/A"),
    "scale factor": (100.0, "%"),
    "misalignment": (1e3, "mrad"),
}


def customary_unit(name: str, *, coarse: bool = False) -> tuple[float, str]:
    """Factor from SI and unit in which a parameter is shown; a gyro's in °/s instead of °/h where `coarse`."""
    what = family(name)
    if name.startswith("mag"):
        return _MAGNETIC[what]
    if what == "scale factor":
        return 1e6, "ppm"
    if what == "misalignment":
        return 1e6, "µrad"
    if name.startswith("accel"):
        return 1.0, "m/s²"
    factor, unit = (DEG_PER_HOUR / 3600.0, "°/s") if coarse else (DEG_PER_HOUR, "°/h")
    return factor, unit if what == "bias" else f"{unit}/g"


def quantities(triad: TriadCalibration, temperature: float) -> tuple[Quantity, ...]:
    """All fitted parameters of a triad at one temperature, °C."""
    (values,), (sigmas,) = triad.over(np.array([temperature]))
    rows = []
    units = customary_units(triad)
    for name, value, sigma, (factor, unit) in zip(triad.names, values, sigmas, units, strict=True):
        rows.append(Quantity(name, label(name), float(value * factor), float(sigma * factor), unit))
    return tuple(rows)


@runtime_checkable
class Ranged(Protocol):
    """Whatever has a calibrated range."""

    @property
    def temperature_range(self) -> tuple[float, float] | None:
        """°C."""
        ...


def middle_temperature(calibration: Ranged) -> float:
    """Middle of the calibrated range, °C; 0 where there is no temperature model."""
    if calibration.temperature_range is None:
        return 0.0
    return float(0.5 * sum(calibration.temperature_range))


def with_sigma(value: float, sigma: float) -> tuple[str, str]:
    """Value and uncertainty as text: two significant digits of the uncertainty decide."""
    if not (math.isfinite(sigma) and sigma > 0.0):
        return f"{value:.6g}", f"{sigma:.2g}"
    decimals = 1 - math.floor(math.log10(sigma))
    # Rounding 0.0996 up to 0.10 leaves one digit too many.
    decimals = 1 - math.floor(math.log10(round(sigma, decimals)))
    if decimals > 12:
        return f"{value:.6g}", f"{sigma:.2g}"
    shown = max(decimals, 0)
    # Adding 0.0 makes a rounded -0.0 a plain 0.
    return f"{round(value, decimals) + 0.0:.{shown}f}", f"{round(sigma, decimals):.{shown}f}"


# How a misfit in an SI unit is shown.
SHOWN_AS = {
    "m/s^2": (1.0, "m/s²"),
    "rad/s": (DEG_PER_HOUR, "°/h"),
    "rad": (1e3, "mrad"),
    "T": (1e6, "µT"),
}


def rms_text(unit: str, value: float) -> str:
    """A root mean square in the SI unit m/s^2, rad/s, rad or T, as people read it."""
    factor, shown = SHOWN_AS[unit]
    return f"{factor * value:.3g} {shown}"


def si_unit(name: str) -> str:
    """The SI unit of a parameter, as `calibration.json` writes it."""
    return unit_of(name)
