"""What a file of arrays says beside them: a scalar `Fs` is their rate, the text gyro of a struct UNITS a unit."""

import re
from collections.abc import Iterable, Mapping
from typing import NamedTuple

import numpy as np


_RATE = re.compile(
    r"fs|f_?samp\w*|odr|samp\w*_?(?:rate|freq\w*)|(?:rate|freq\w*)_?hz", re.IGNORECASE
)
_ANY_RATE = re.compile(r"rate|freq|frequency", re.IGNORECASE)  # may be a table's, too
_RATES = (1.0, 20000.0)  # Hz: what an IMU may be read at
_UNITS = re.compile(r"(?:^|_)units?(?:$|_)", re.IGNORECASE)


class ArrayNotes(NamedTuple):
    """Rate and units that a file holds apart from its arrays."""

    rate: float | None = None  # Hz
    rate_name: str = ""
    sure: bool = False  # that it is the samples' rate
    units: Mapping[str, str] = {}  # by array


NOTHING = ArrayNotes()


def array_notes(arrays: Mapping[str, np.ndarray], texts: Mapping[str, str]) -> ArrayNotes:
    """The notes of a file whose arrays and texts have these names, those in structs and groups behind a `/`.

    Of several rates that differ none is taken.
    """
    units = {_described(name): text for name, text in texts.items() if _is_unit(name)}
    for words, sure in ((_RATE, True), (_ANY_RATE, False)):
        rates = {n: float(v.reshape(-1)[0]) for n, v in arrays.items() if _is_rate(words, n, v)}
        if len(set(rates.values())) == 1:
            name, rate = next(iter(rates.items()))
            return ArrayNotes(rate, name, sure, units)
    return ArrayNotes(units=units)


def words_of(notes: ArrayNotes, columns: Iterable[str]) -> dict[str, str]:
    """Units by column: those of `gyro` are of gyro_x, gyro_y and gyro_z; one without an array's name is of a file's
    three columns."""
    names = list(columns)
    found = {c: u for a, u in notes.units.items() for c in names if a and _is_of(c, a)}
    if not found and "" in notes.units and len(names) == len("xyz"):
        found = dict.fromkeys(names, notes.units[""])
    return found


def _is_rate(words: re.Pattern[str], name: str, values: np.ndarray) -> bool:
    if values.size != 1 or values.dtype.kind not in "fiu":
        return False
    named = words.fullmatch(name.split("/")[-1])
    return named is not None and _RATES[0] <= float(values.reshape(-1)[0]) <= _RATES[1]


def _is_unit(name: str) -> bool:
    return any(_UNITS.search(part) for part in name.split("/"))


def _described(name: str) -> str:
    """The array whose unit a text is by its name: accel of `UNITS/accel`, of `accel/units` and of `accel_unit`."""
    parts = [_UNITS.sub("_", part).strip("_") for part in name.split("/")]
    return "/".join(p for p in parts if p)


def _is_of(column: str, array: str) -> bool:
    return column == array or column.startswith((f"{array}_", f"{array}/"))
