"""Which of several temperatures in a log is the inertial sensors', by names alone: the same for all of a logger's."""

import re

import numpy as np

from .column_words import means, plain
from .raw_log import RawLog


# Of the inertial sensors' own die: `gtemp` beside gx is the gyros'. No `atemp`, which is an ambient one for some.
_OWN = re.compile(
    r"imu|gyr|acc|^g_?te?mp|(?<![a-z])(?:mpu|icm|iim|bmi|lsm|adxl|adis|xsens)|^t_?(?:sens|die|chip)|"
    r"(?<![a-z])(?:die|chip)(?![a-z])"
)
# Of another sensor, or of a part that warms by itself: humidity, pressure, processor, receiver, battery. "board" is
# nearer to the sensors than any of these and is ranked with names that say nothing.
_OTHERS = re.compile(
    r"(?<![a-z])(?:aht|bm[pe]|dht|sht|htu|hdc|si70|lps\d|dps3|ms56|ds18|cpu|mcu|gpu|soc|gps|gnss|esc|bat|mag)"
    r"|hum|baro|press|weather|batt|motor|magnet|process"
)


def ranked(log: RawLog, names: list[str]) -> list[str]:
    """Temperatures' columns, the inertial sensors' own first, then those whose names do not say whose they are, those
    of other sensors, those of what is around the device, which it follows late, and those that read nothing."""
    return sorted(names, key=lambda n: (_is_dead(log, n), _rank(n)))


def rivals(log: RawLog, names: list[str]) -> tuple[str, ...]:
    """Of `ranked` temperatures those that may each be the device's, where there is more than one."""
    of_device = [n for n in names if n in log.numbers and not _is_dead(log, n) and _rank(n) < 3]
    return tuple(of_device) if len(of_device) > 1 else ()


def _rank(name: str) -> int:
    if means("surroundings", name):
        return 3
    if _OTHERS.search(plain(name)):
        return 2
    return 0 if _OWN.search(plain(name)) else 1


def _is_dead(log: RawLog, name: str) -> bool:
    return name in log.numbers and not np.any(log.numbers[name])
