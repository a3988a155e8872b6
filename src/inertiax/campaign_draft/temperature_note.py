"""A probe's scale by what the lines above the names say of it: `temp: 256 LSB/degC, 0 = 23 degC`."""

import re
from collections.abc import Iterable
from typing import NamedTuple


_NUMBER = r"([-+]?\d+(?:[.,]\d+)?(?:e[-+]?\d+)?)"
_COUNT = r"(?:lsb|counts?|digits?|cts?)"
_DEGREE = r"(?:k(?:elvin)?|(?:deg(?:rees?)?|°|º)[ _]?(?:c(?:elsius)?|k)?|c(?:elsius)?)\b"
_PER = r"[ ]?(?:/|per)[ ]?"
_TEMPERATURE = re.compile(r"temp|probe|\bt\b|therm")
_COUNTS_PER_DEGREE = re.compile(rf"{_NUMBER} ?{_COUNT}{_PER}{_DEGREE}")
_DEGREES_PER_COUNT = re.compile(rf"{_NUMBER} ?{_DEGREE}{_PER}{_COUNT}\b")
_ZERO_FIRST = re.compile(  # 0 = 23 degC; 0 LSB at 25 °C; zero: 21 C; offset 25 degC
    rf"(?:(?<![\d.,])0(?![.,]?\d)(?: ?{_COUNT})?|zero|offset)(?: is)? ?(?:=|:|->|at|\bis\b|@)? ?{_NUMBER} ?{_DEGREE}"
)
_ZERO_LAST = re.compile(rf"{_NUMBER} ?{_DEGREE} ?(?:at|=|@|for) ?0(?![.,]?\d)(?: ?{_COUNT})?")


class TemperatureNote(NamedTuple):
    """°C = counts / `scale` + `zero`."""

    scale: float  # counts per °C, above zero
    zero: float  # °C at a count of zero


def temperature_note(lines: Iterable[str]) -> TemperatureNote | None:
    """The scale of the temperature that a line states with the temperature at zero counts; `None` where none does.

    A line counts where it speaks of a temperature and states both: a scale alone leaves the zero open.

    **Arguments:** `lines` stand above the names, as the file has them.
    """
    for line in lines:
        text = line.lower()
        start = _TEMPERATURE.search(text)
        if start is None:
            continue
        scale = _scale(text[start.start() :])
        zero = _ZERO_FIRST.search(text, start.start()) or _ZERO_LAST.search(text, start.start())
        if scale is not None and zero is not None:
            return TemperatureNote(scale, _value(zero[1]))
    return None


def temperature_scale_note(lines: Iterable[str]) -> float | None:
    """Counts per °C that a line which speaks of a temperature states, with or without a zero; `None` where none does.

    **Arguments:** `lines` stand above the names, as the file has them.
    """
    for line in lines:
        text = line.lower()
        start = _TEMPERATURE.search(text)
        scale = None if start is None else _scale(text[start.start() :])
        if scale is not None:
            return scale
    return None


def _scale(text: str) -> float | None:
    """Counts a degree."""
    if (found := _COUNTS_PER_DEGREE.search(text)) and _value(found[1]) > 0.0:
        return _value(found[1])
    if (found := _DEGREES_PER_COUNT.search(text)) and _value(found[1]) > 0.0:
        return 1.0 / _value(found[1])
    return None


def _value(text: str) -> float:
    return float(text.replace(",", "."))
