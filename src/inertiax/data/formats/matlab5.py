"""The container of MATLAB's v5 to v7 files: numeric arrays, lines of text and structs of them, nothing else.

A file is a header of 128 bytes and elements of (type, size, data), padded to eight bytes; an element may be
packed by zlib. Every size is checked against the bytes that are there, so that a damaged or hostile file is
refused: SciPy's reader, in C, ends the process on some of them.

**Reference:** MathWorks, *MAT-File Format*, level 5.
"""

import math
import zlib
from collections.abc import Iterator
from typing import NamedTuple, TypeAlias

import numpy as np

from .expansion import limit


Content: TypeAlias = "dict[str, np.ndarray | str | Content]"

_HEADER = 128
_DEEPEST = 16  # structs in structs
_MATRIX, _COMPRESSED, _STRUCT, _OBJECT, _CHAR = 14, 15, 2, 17, 4
_COMPLEX = 0x0800
# NumPy's type of each numeric element, and of each class of arrays.
_TYPES = {
    1: "i1",
    2: "u1",
    3: "i2",
    4: "u2",
    5: "i4",
    6: "u4",
    7: "f4",
    9: "f8",
    12: "i8",
    13: "u8",
}
# Encoding of each element that holds the letters of a text.
_TEXTS = {1: "latin-1", 2: "latin-1", 4: "utf-16", 16: "utf-8", 17: "utf-16"}
_CLASSES = dict(zip(range(6, 16), "f8 f4 i1 u1 i2 u2 i4 u4 i8 u8".split(), strict=True))


class _Damaged(Exception):
    """What is wrong, in words."""


class _Element(NamedTuple):
    kind: int
    data: memoryview


def parse(content: bytes, where: str) -> Content:
    """The numeric arrays and the texts of one line in a file by name, and each 1 × 1 struct as a dictionary of its own.

    Cells, objects, sparse and complex arrays are left out. Raises `ValueError` naming the file.
    """
    order = {b"IM": "<", b"MI": ">"}.get(content[126:_HEADER])
    if order is None:
        raise ValueError(f"{where}: not a MATLAB file of v5 to v7: its header says no byte order.")
    try:
        found: Content = {}
        room = limit(len(content))
        for element in _elements(memoryview(content)[_HEADER:], order, room):
            if element.kind == _MATRIX:
                found |= _array(element.data, order, 0)
        found.pop("", None)  # where MATLAB keeps the values of its objects
        return found
    except _Damaged as error:
        raise ValueError(f"{where}: the MATLAB file is damaged or cut off: {error}.") from None


def objects(content: bytes) -> dict[str, str]:
    """The class of each MATLAB object in a file that `parse` read, by the object's name."""
    order = "<" if content[126:_HEADER] == b"IM" else ">"
    found: dict[str, str] = {}
    for element in _elements(memoryview(content)[_HEADER:], order, limit(len(content))):
        flags, data = _numbers(element.data, order)
        if element.kind == _MATRIX and len(flags) and int(flags[0]) & 0xFF == _OBJECT:
            name, data = _next(data, order)
            _, data = _next(data, order)
            of, _ = _next(data, order)
            found[bytes(name.data).decode("latin-1")] = bytes(of.data).decode("latin-1")
    return found


def _elements(data: memoryview, order: str, room: int) -> Iterator[_Element]:
    """The elements one after the other, unpacked; `room` bytes in all may be unpacked."""
    while len(data):
        element, padded = _element(data, order)
        if element.kind != _COMPRESSED:
            yield element
        else:
            padded = 8 + len(element.data)  # packed elements are not padded
            unpacked = _unpack(element.data, room)
            room -= len(unpacked)
            yield _element(memoryview(unpacked), order)[0]
        data = data[padded:]


def _element(data: memoryview, order: str) -> tuple[_Element, int]:
    """The first element, and where the next one begins."""
    if len(data) < 8:
        raise _Damaged(f"an element of {len(data)} bytes")
    kind, size = (int(x) for x in np.frombuffer(data[:8], f"{order}u4"))
    if kind >> 16:  # up to four bytes lie in the tag itself
        kind, size, start, padded = kind & 0xFFFF, kind >> 16, 4, 8
        if size > 4:
            raise _Damaged(f"a short element of {size} bytes")
    else:
        start, padded = 8, 8 + size + -size % 8
    if start + size > len(data):
        raise _Damaged(f"an element of {size} bytes where {len(data) - start} are left")
    return _Element(kind, data[start : start + size]), padded


def _unpack(data: memoryview, room: int) -> bytes:
    stream = zlib.decompressobj()
    try:
        unpacked = stream.decompress(data, max(room, 1))
    except zlib.error as error:
        raise _Damaged(f"packed data: {error}") from None
    if stream.unconsumed_tail:
        raise _Damaged("packed data of a size that no recording packs into so few bytes")
    return unpacked


def _array(data: memoryview, order: str, depth: int) -> Content:
    """One array by its name; nothing where it is of a kind that is left out."""
    flags, data = _numbers(data, order)
    dims, data = _numbers(data, order)
    name, data = _next(data, order)
    kind = int(flags[0]) & 0xFF if len(flags) else 0
    if (
        kind == _OBJECT
    ):  # its name is where others have their dimensions, and its values are elsewhere
        return {}
    text = bytes(name.data).decode("latin-1")
    shape = tuple(int(d) for d in dims)
    if not 2 <= len(shape) <= 8 or min(shape) < 0:
        raise _Damaged(f"an array of shape {shape[:8]}")
    if kind == _STRUCT:
        return {text: _fields(data, order, depth + 1)} if math.prod(shape) == 1 else {}
    if kind == _CHAR:
        return _text(text, data, order) if shape[0] == 1 and len(shape) == 2 else {}
    if kind not in _CLASSES or int(flags[0]) & _COMPLEX:
        return {}
    values, _ = _numbers(data, order)
    if len(values) != math.prod(shape):
        raise _Damaged(f"{len(values)} values in an array of shape {shape}")
    with np.errstate(invalid="ignore"):  # values beyond the class, which no program writes
        return {text: values.astype(_CLASSES[kind]).reshape(shape, order="F")}


def _text(name: str, data: memoryview, order: str) -> Content:
    """A line of text by its name; nothing where it is in an encoding that is not known."""
    element, _ = _next(data, order)
    encoding = _TEXTS.get(element.kind, "")
    encoding += {"<": "-le", ">": "-be"}[order] if encoding == "utf-16" else ""
    return {name: bytes(element.data).decode(encoding, "replace")} if encoding else {}


def _fields(data: memoryview, order: str, depth: int) -> Content:
    if depth > _DEEPEST:
        raise _Damaged(f"structs nested deeper than {_DEEPEST}")
    lengths, data = _numbers(data, order)
    names, data = _next(data, order)
    length = int(lengths[0]) if len(lengths) else 0
    if length < 1 or len(names.data) % length:
        raise _Damaged(f"field names of {length} bytes in {len(names.data)}")
    found: Content = {}
    for start in range(0, len(names.data), length):
        name = bytes(names.data[start : start + length]).split(b"\0")[0].decode("latin-1")
        field, data = _next(data, order)
        if field.kind == _MATRIX and len(field.data):
            for value in _array(field.data, order, depth).values():
                found[name] = value
    return found


def _next(data: memoryview, order: str) -> tuple[_Element, memoryview]:
    element, padded = _element(data, order)
    return element, data[padded:]


def _numbers(data: memoryview, order: str) -> tuple[np.ndarray, memoryview]:
    """The first element as numbers, and what follows."""
    element, rest = _next(data, order)
    kind = _TYPES.get(element.kind)
    if kind is None:
        raise _Damaged(f"numbers of the unknown type {element.kind}")
    if len(element.data) % int(kind[1]):
        raise _Damaged(f"{len(element.data)} bytes of {int(kind[1])}-byte numbers")
    return np.frombuffer(element.data, order + kind), rest
