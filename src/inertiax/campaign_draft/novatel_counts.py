"""What a count of NovAtel's raw IMU messages is: the IMU is told by what gravity reads."""

import numpy as np

from ..data.formats import novatel
from .accel_unit import TriadUnit
from .converters import G, rounded
from .raw_triads import RawTriads


_AGREES = 0.05  # relative, of gravity: the scales of two kinds are 20 % apart, or the same
_ARCSEC = np.pi / 180 / 3600
_FOOT = 0.3048  # m
# m/s and rad gained per count, by IMU: table "Raw IMU Scale Factors" of the OEM7 manual, as its ROS driver has it; of
# Epson's per second, m/s² and rad/s.
_COUNTS = (
    ("LN200", 2.0**-14, 2.0**-19),
    ("HG1700 AG11 or AG58, HG1900, HG1930", _FOOT * 2.0**-27, 2.0**-33),
    ("HG1700 AG17 or AG62", _FOOT * 2.0**-26, 2.0**-33),
    ("FSAS", 0.05 * 2.0**-15, 0.1 * 2.0**-8 * _ARCSEC),
    ("KVH 1750", 0.05 * 2.0**-15, 0.1 / (3600.0 * 256.0)),
    ("ISA-100C, µIMU", 2e-8, 1e-9),
    ("ADIS16488", 200.0 * 2.0**-31, np.deg2rad(720.0 * 2.0**-31)),
    ("STIM300", 2.0**-22, np.deg2rad(2.0**-21)),
    ("HG4930", 2.0**-29, 2.0**-33),
)
_RATES = (
    ("Epson G320", 2e-4 * 2.0**-16 * G, np.deg2rad(0.008 * 2.0**-16)),
    ("Epson G370", 4e-4 * 2.0**-16 * G, np.deg2rad(0.0151515 * 2.0**-16)),
)


def of_novatel(found: RawTriads, accel: TriadUnit) -> tuple[TriadUnit, TriadUnit] | None:
    """The units of both triads of a log of NovAtel's messages, by the counts that gravity reads in a step.

    **Arguments:** `accel` is the unit that gravity told. `None` for other logs, and where no known IMU has such counts.
    """
    if not set(novatel.NAMES.split(",")) <= set(found.log.names) or accel.unit != "count":
        return None
    step = float(np.median(np.diff(found.seconds)))
    counts = [(name, a / step, g / step) for name, a, g in _COUNTS] + list(_RATES)
    fits = [c for c in counts if abs(accel.factor / c[1] - 1.0) < _AGREES]
    if not fits:
        return None
    name, force, rate = fits[0]
    others = "".join(f"; {n} has {rounded(1.0 / g):g} count per rad/s" for n, _, g in fits[1:])
    why = f"increments of {name}, whose counts gravity agrees with{others}"
    units = ("count per m/s^2", force), ("count per rad/s", rate)
    one, other = (
        TriadUnit("count", rounded(1.0 / factor), said, None, factor, why, not others)
        for said, factor in units
    )
    return one._replace(certain=True), other
