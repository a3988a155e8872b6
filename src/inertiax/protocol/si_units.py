r"""Units of results as D-SI writes them, in base and derived units: `m/s^2` is `\metre\second\tothe{-2}`.

**Reference:** Hutzschenreuter et al., *SmartCom Digital System of Units (D-SI)*, 2nd ed., 2020.
"""

from typing import NamedTuple


class Unit(NamedTuple):
    """A unit as D-SI writes it."""

    factor: float  # from the package's unit
    text: str


# Without g and minutes, which D-SI does not have: with the power of 1/g (in m/s²) and of 1/min that a value is
# divided by.
_UNITS = {
    "1": (0, 0, r"\one"),
    "(rad/s)/(rad/s)": (0, 0, r"\one"),
    "s": (0, 0, r"\second"),
    "m": (0, 0, r"\metre"),
    "rad": (0, 0, r"\radian"),
    "Hz": (0, 0, r"\hertz"),
    "degC": (0, 0, r"\degreecelsius"),
    "T": (0, 0, r"\tesla"),
    "T/A": (0, 0, r"\tesla\ampere\tothe{-1}"),
    "m/s^2": (0, 0, r"\metre\second\tothe{-2}"),
    "m/s^2/g": (1, 0, r"\one"),
    "m/s^2/g^2": (2, 0, r"\metre\tothe{-1}\second\tothe{2}"),
    "m/s^2/g^3": (3, 0, r"\metre\tothe{-2}\second\tothe{4}"),
    "m/s^2/s": (0, 0, r"\metre\second\tothe{-3}"),
    "m/s^2/V": (0, 0, r"\metre\second\tothe{-2}\volt\tothe{-1}"),
    "m/s^2/(degC/min)": (0, 1, r"\metre\second\tothe{-1}\kelvin\tothe{-1}"),
    "m/s^2/(degC/min/s)": (0, 1, r"\metre\kelvin\tothe{-1}"),
    "1/s": (0, 0, r"\second\tothe{-1}"),
    "1/(degC/min)": (0, 1, r"\second\kelvin\tothe{-1}"),
    "rad/s": (0, 0, r"\radian\second\tothe{-1}"),
    "rad/s/g": (1, 0, r"\radian\second\metre\tothe{-1}"),
    "rad/s/g^2": (2, 0, r"\radian\second\tothe{3}\metre\tothe{-2}"),
    "rad/s/s": (0, 0, r"\radian\second\tothe{-2}"),
    "rad/s/V": (0, 0, r"\radian\second\tothe{-1}\volt\tothe{-1}"),
    "rad/s/(degC/min)": (0, 1, r"\radian\kelvin\tothe{-1}"),
    "rad/s/(degC/min/s)": (0, 1, r"\radian\second\kelvin\tothe{-1}"),
    "rad/s/(rad/s)^2": (0, 0, r"\radian\tothe{-1}\second"),
    "rad/s/(rad/s)^3": (0, 0, r"\radian\tothe{-2}\second\tothe{2}"),
}


def in_si(unit: str, gravity: float) -> Unit:
    """The D-SI form of a unit in which results and the catalogue's effects are, and the factor to it.

    **Arguments:** `gravity` in m/s² is what a g is.
    """
    by_g, by_minute, text = _UNITS[unit]
    return Unit(60.0**by_minute / gravity**by_g, text)
