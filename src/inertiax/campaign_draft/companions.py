"""What the other triads of a chip count where gravity tells the chip by a scale that no other one has.

Bosch's BNO055, whose registers many libraries log as they are: 100 counts per m/s², 16 per deg/s, 16 per µT.
"""

from typing import NamedTuple

from .accel_unit import TriadUnit
from .converters import PER_G_OF_HUNDREDTHS


_PER_DEGREE, _PER_MICROTESLA = 16.0, 16.0


class Companion(NamedTuple):
    """The scale that a chip has beside its accelerometers' one."""

    scale: float  # counts per deg/s or per µT
    sure: bool  # whether gravity tells the chip, or another scale is as near
    text: str


def gyro_companion(accel: TriadUnit | None) -> Companion | None:
    """Counts per deg/s beside accelerometers in `accel`; `None` where that is no chip's own."""
    return _companion(accel, _PER_DEGREE, "deg/s")


def field_companion(accel: TriadUnit | None) -> Companion | None:
    """Counts per µT beside accelerometers in `accel`; `None` where that is no chip's own."""
    return _companion(accel, _PER_MICROTESLA, "uT")


def _companion(accel: TriadUnit | None, scale: float, unit: str) -> Companion | None:
    if accel is None or accel.scale != PER_G_OF_HUNDREDTHS:
        return None
    text = f"{scale:g} counts per {unit} go with {accel.scale:g} per g in a BNO055's registers"
    return Companion(scale, accel.certain, text)
