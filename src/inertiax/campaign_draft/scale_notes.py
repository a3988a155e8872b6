"""Scales of raw counts by what the lines above the names say of them: `GYRO 0.0009375 deg/s/LSB`, `gyro 16.4 LSB/dps`,
`temp: 256 LSB/degC, 0 = 23 degC`."""

import re
from collections.abc import Iterable
from typing import NamedTuple


_NUMBER = r"(?<![\w.,])([-+]?\d+(?:[.,]\d+)?(?:e[-+]?\d+)?)"
_COUNT = r"(?:lsb|counts?|digits?|cts?)\b"
_PER = r" ?(?:/|per) ?"
_DEGREE = r"(?:k(?:elvin)?|(?:deg(?:rees?)?|°|º)[ _]?(?:c(?:elsius)?|k)?|c(?:elsius)?)\b"
_RATE = r"(m?)(?:dps\b|\(?(?:deg(?:rees?)?|°|º) ?(?:/|per) ?s(?:ec(?:ond)?)?\b\)?)"
_MILLI = 1000.0

_GYROS = re.compile(r"gyro|angular|\brates?\b|drehrate")
_OTHERS = re.compile(r"acc|temp|mag|probe|therm")
_PER_RATE = re.compile(rf"{_NUMBER} ?{_COUNT}{_PER}{_RATE}")
_RATE_PER = re.compile(rf"{_NUMBER} ?{_RATE}{_PER}{_COUNT}")

_TEMPERATURE = re.compile(r"temp|probe|\bt\b|therm")
_PER_DEGREE = re.compile(rf"{_NUMBER} ?{_COUNT}{_PER}{_DEGREE}")
_DEGREE_PER = re.compile(rf"{_NUMBER} ?{_DEGREE}{_PER}{_COUNT}")
_NOUGHT = rf"(?<![\d.,])0(?![.,]?\d)(?: ?{_COUNT})?"
_ZERO_FIRST = re.compile(  # 0 = 23 degC; 0 LSB at 25 °C; zero: 21 C; offset 25 degC
    rf"(?:{_NOUGHT}|zero|offset)(?: is)? ?(?:=|:|->|at|\bis\b|@)? ?{_NUMBER} ?{_DEGREE}"
)
_ZERO_LAST = re.compile(rf"{_NUMBER} ?{_DEGREE} ?(?:at|=|@|for) ?{_NOUGHT}")


class TemperatureNote(NamedTuple):
    """°C = counts / `scale` + `zero`."""

    scale: float  # counts per °C, above zero
    zero: float | None  # °C at a count of zero; `None` where the line leaves it open


def temperature_note(lines: Iterable[str]) -> TemperatureNote | None:
    """The scale of the temperature that a line states; the first with a zero, else the first without; `None` where no
    line that speaks of a temperature states one.

    **Arguments:** `lines` stand above the names, as the file has them.
    """
    without = None
    for line in lines:
        text = line.lower()
        start = _TEMPERATURE.search(text)
        if start is None:
            continue
        scale = _scale(text[start.start() :], _PER_DEGREE, _DEGREE_PER)
        if scale is None:
            continue
        zero = _ZERO_FIRST.search(text, start.start()) or _ZERO_LAST.search(text, start.start())
        if zero is not None:
            return TemperatureNote(scale, _value(zero[1]))
        without = without or TemperatureNote(scale, None)
    return without


def gyro_note(lines: Iterable[str]) -> float | None:
    """Counts per deg/s that a line states behind a word for the gyros, before it speaks of another triad or of the
    temperature; `None` where none does.

    **Arguments:** `lines` stand above the names, as the file has them.
    """
    for line in lines:
        text = line.lower()
        start = _GYROS.search(text)
        if start is None:
            continue
        text = text[start.end() :]
        other = _OTHERS.search(text)
        found = _scale(text if other is None else text[: other.start()], _PER_RATE, _RATE_PER)
        if found is not None:
            return found
    return None


def _scale(text: str, counts_per: re.Pattern[str], per_count: re.Pattern[str]) -> float | None:
    """Counts per unit, above zero; a second group of a pattern is the prefix of a thousandth."""
    for pattern, sign in ((counts_per, 1), (per_count, -1)):
        found = pattern.search(text)
        if found and _value(found[1]) > 0.0:
            factor = _MILLI if found.lastindex == 2 and found[2] else 1.0
            return factor * _value(found[1]) ** sign
    return None


def _value(text: str) -> float:
    return float(text.replace(",", "."))
