"""Raw IMU messages of NovAtel's receivers in ASCII, as rows of a table.

`RAWIMU`, `RAWIMUX` and their short forms `RAWIMUS`, `RAWIMUSX` hold the GNSS week, the seconds in it, a status, and
what was gained since the last sample in counts: velocities along z, −y, x, then angles about z, −y, x (OEM7 manual,
"RAWIMUS" and "RAWIMUSX"). Other messages of the same log are left out.
"""

import re


NAMES = "gps_time [s],acc_x,acc_y,acc_z,gyr_x,gyr_y,gyr_z"
_WEEK = 604800  # s
_GPS_EPOCH = 315964800  # s from 1970 to 6 January 1980; leap seconds are not taken away
_COUNT = rb"(-?)(\d+)"
_MESSAGE = re.compile(
    rb"^[%#]RAWIMUS?(?:X?)A,[^;\n]*;(?:[0-9A-Fa-f]{1,2},\d+,)?(\d+),(\d+)(\.\d+)?,[0-9A-Fa-f]+,"
    + rb",".join([_COUNT] * 6)
    + rb"\*",
    re.MULTILINE,
)


def is_novatel(text: bytes) -> bool:
    """Whether a text is a log of such messages."""
    first = text[:65536]
    return b"RAWIMU" in first and _MESSAGE.search(first) is not None


def as_rows(text: bytes) -> bytes:
    """A line of names, and one of numbers for each message: s since 1970 on GPS time, counts along x, y, z.

    Messages that are cut off are left out.
    """
    rows = [NAMES.encode()]
    for found in _MESSAGE.finditer(text):
        week, whole, part, *signed = found.groups()
        az, ay, ax, gz, gy, gx = (s + n for s, n in zip(signed[::2], signed[1::2], strict=True))
        seconds = b"%d" % (int(week) * _WEEK + _GPS_EPOCH + int(whole))
        rows.append(
            b",".join([seconds + (part or b""), ax, _negative(ay), az, gx, _negative(gy), gz])
        )
    return b"\n".join(rows) + b"\n"


def _negative(count: bytes) -> bytes:
    return count[1:] if count[:1] == b"-" else b"-" + count
