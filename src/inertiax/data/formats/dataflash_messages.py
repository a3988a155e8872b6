"""The container of ArduPilot's dataflash logs: messages that the log itself describes.

A message is A3 95, its type (one byte) and fields as packed by the type's FMT message, which comes before:
type, length, name[4], field formats[16], column names[64]. A log holds damaged stretches where writing was
interrupted; what lies between messages is passed over.

**Reference:** ArduPilot, *DataFlash log structure* (AP_Logger/LogStructure.h).
"""

from typing import NamedTuple

import numpy as np


HEAD = b"\xa3\x95"
_FMT = 0x80
_FMT_LENGTH = 89
# Each field format's NumPy type; text and arrays are kept as bytes. c, C, e and E are in hundredths, L in 1e-7 deg.
_TYPES = {
    "a": "V64", "b": "i1", "B": "u1", "h": "<i2", "H": "<u2", "i": "<i4", "I": "<u4", "f": "<f4", "d": "<f8",
    "g": "<f2", "n": "S4", "N": "S16", "Z": "S64", "c": "<i2", "C": "<u2", "e": "<i4", "E": "<u4",
    "L": "<i4", "M": "u1", "q": "<i8", "Q": "<u8",
}  # fmt: skip
_FACTORS = {"c": 1e-2, "C": 1e-2, "e": 1e-2, "E": 1e-2, "L": 1e-7}


class Kind(NamedTuple):
    """What a FMT message says of a type of messages."""

    name: str
    length: int  # bytes, the head of three included
    columns: tuple[str, ...]
    formats: str


def messages(content: bytes, names: tuple[str, ...]) -> list[tuple[str, dict[str, np.ndarray]]]:
    """The fields of all messages of these names, one entry for each form in which the log describes them.

    Raises `ValueError` where the log describes such a message in a way that cannot be.
    """
    kinds: dict[int, Kind] = {}
    places: dict[Kind, list[int]] = {}
    position, end = content.find(HEAD), len(content)
    while 0 <= position <= end - 3:
        number = content[position + 2]
        kind = kinds.get(number)
        length = _FMT_LENGTH if number == _FMT else kind.length if kind is not None else 0
        if not 3 <= length <= end - position:
            position = content.find(HEAD, position + 1)
            continue
        if number == _FMT:
            described, told = _kind(content[position : position + length])
            kinds[described] = told
        elif kind is not None and kind.name in names:
            places.setdefault(kind, []).append(position)
        position += length
        if content[position : position + 2] != HEAD:
            position = content.find(HEAD, position)
    return [(kind.name, _fields(content, kind, at)) for kind, at in places.items()]


def _kind(message: bytes) -> tuple[int, Kind]:
    """The type that a FMT message describes, and its description."""
    text = [
        message[a:b].split(b"\0")[0].decode("ascii", "replace")
        for a, b in ((5, 9), (9, 25), (25, 89))
    ]
    name, formats, columns = text
    return message[3], Kind(name, message[4], tuple(columns.split(",")), formats)


def _fields(content: bytes, kind: Kind, places: list[int]) -> dict[str, np.ndarray]:
    unknown = [f for f in kind.formats if f not in _TYPES]
    if (
        unknown
        or len(kind.formats) != len(kind.columns)
        or len(set(kind.columns)) < len(kind.columns)
    ):
        raise ValueError(
            f"its description of {kind.name} cannot be: fields {kind.formats!r} for columns "
            f"{','.join(kind.columns)!r}"
        )
    layout = np.dtype([(c, _TYPES[f]) for c, f in zip(kind.columns, kind.formats, strict=True)])
    if layout.itemsize != kind.length - 3:
        raise ValueError(
            f"its description of {kind.name} cannot be: {kind.length} bytes for fields of {layout.itemsize + 3}"
        )
    at = np.array(places)[:, None] + np.arange(3, kind.length)
    rows = np.frombuffer(content, np.uint8)[at].view(layout).reshape(-1)
    return {
        c: rows[c] * _FACTORS[f] if f in _FACTORS else rows[c]
        for c, f in zip(kind.columns, kind.formats, strict=True)
    }
