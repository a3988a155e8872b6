"""Sentences of satellite receivers (NMEA 0183: `$GPGSV,4,1,13,...`), which are texts of numbers, but of no IMU.

**Reference:** NMEA 0183, Standard for Interfacing Marine Electronic Devices: two letters say who talks (GP, GL, GA,
GB, GN: receivers of satellites), three what the sentence is.
"""

import re


_SENTENCE = re.compile(
    rb"\$((?:G[PLABNQI]|BD|QZ)(?:GGA|GLL|GSA|GSV|GST|GNS|GBS|GRS|RMC|VTG|ZDA|DTM|TXT|HDT|THS)),"
)
_LINES = 2000  # that are looked at: receivers tell the same every second
_NEARLY_ALL = 0.9  # of the lines; beside an IMU's sentences they are fewer


def refuse_satellites(text: bytes, where: str) -> None:
    """Raise `ValueError` where nearly all lines are sentences of a satellite receiver."""
    if not text.startswith(b"$"):
        return
    lines = [line for line in text.split(b"\n", _LINES)[:_LINES] if line.strip()]
    found = [m[1].decode() for m in map(_SENTENCE.match, lines) if m is not None]
    if len(found) > _NEARLY_ALL * len(lines):
        kinds = ", ".join(f"${k}" for k in list(dict.fromkeys(found))[:4])
        raise ValueError(
            f"{where}: it holds sentences of a satellite receiver (NMEA 0183: {kinds}), no outputs of an IMU; give the "
            "IMU's own log."
        )
