"""What one count is, as a column's name or unit states: `(0.1 deg/s)`, `[x0.001 g]`, `1/16 dps`, `131 LSB/dps`."""

import re
from collections.abc import Iterable
from typing import NamedTuple

from .column_words import plain
from .converters import DEGREE, G
from .scale_notes import gyro_note


_NUMBER = r"(?<![a-z0-9.,+±-])(?:[x×*] ?)?(?P<number>\d+(?:[.,]\d+)?(?:e[-+]?\d+)?)(?: ?/ ?(?P<part>\d+))?"
_BETWEEN = r"(?:[ _]?[x×*]?[ _]?)"
_COUNTS_PER = r"(?P<counts>[ _]?(?:lsb|counts?|digits?|cts?)[ _]?(?:/|per)[ _]?\(?)"
_PREFIX = r"(?P<prefix>milli_?|micro_?|[mcuµμ])?"
_DEGREE = r"deg(?:rees?)?|°|º"
_RATE = rf"(?:(?P<dps>dps)|(?:(?P<degrees>{_DEGREE})|rad(?:ians?)?)[ _]?(?:/|per|p)?[ _]?s(?:ec(?:ond)?)?)"
_FORCE = r"(?:(?P<g>g)|m ?(?:/ ?s ?(?:\^|\*\*)?[2²]|ps2|_s2|/s/s))"
_END = r"(?![a-z0-9^*²])"
_RATES, _FORCES = (
    re.compile(f"{_NUMBER}(?:{_COUNTS_PER}|{_BETWEEN}){_PREFIX}{unit}{_END}")
    for unit in (_RATE, _FORCE)
)
_PREFIXES = {"": 1.0, "m": 1e-3, "milli": 1e-3, "c": 1e-2}
_MICRO = 1e-6


class StatedScale(NamedTuple):
    """Counts per unit that a file states."""

    scale: float
    scale_unit: str  # "count per deg/s"
    factor: float  # m/s² or rad/s per count
    text: str  # as the file has it


def stated_rate_scale(hint: str) -> StatedScale | None:
    """The scale of gyros that words of a file state.

    A number of 1 and more before a unit is a range, `250 dps`: no converter's steps are as coarse.

    **Arguments:** `hint` are the names and units of all three columns, which must agree.
    """
    found = _stated(_RATES, hint)
    if found is None or (found["counts"] is None and not _step(found) < 1.0):
        return None
    degrees = found["dps"] or found["degrees"]
    return _scale(found, "deg/s" if degrees else "rad/s", DEGREE if degrees else 1.0)


def gyro_scale(hint: str, lines: Iterable[str]) -> StatedScale | None:
    """The scale of gyros by the words of their columns, else by a line above the names."""
    by_line = gyro_note(lines)
    if by_line is None:
        return stated_rate_scale(hint)
    text = f"{by_line:.6g} counts per deg/s above the names"
    above = StatedScale(by_line, "count per deg/s", DEGREE / by_line, text)
    return stated_rate_scale(hint) or above


def stated_force_scale(hint: str) -> StatedScale | None:
    """The scale of accelerometers that words of a file state; what gravity reads tells whether it is one, or a range.

    **Arguments:** `hint` are the names and units of all three columns, which must agree.
    """
    found = _stated(_FORCES, hint)
    if found is None:
        return None
    return _scale(found, "g" if found["g"] else "m/s^2", G if found["g"] else 1.0)


def _stated(words: re.Pattern[str], hint: str) -> re.Match[str] | None:
    """The scale that all columns state alike; `None` where it is that of a plain unit, `1 mg`."""
    found = list(words.finditer(plain(hint)))
    if not found or len({_step(f) for f in found}) > 1 or _step(found[0]) == 0.0:
        return None
    plain_unit = found[0]["number"] == "1" and not (found[0]["part"] or found[0]["counts"])
    return None if plain_unit else found[0]


def _step(found: re.Match[str]) -> float:
    """Units per count, of deg/s, rad/s, g or m/s²; 0 where there is none."""
    number, part = float(found["number"].replace(",", ".")), float(found["part"] or 1.0)
    size = _PREFIXES.get((found["prefix"] or "").rstrip("_"), _MICRO)
    over, under = (number, part) if found["counts"] is None else (part, number)
    return size * over / under if under > 0.0 else 0.0


def _scale(found: re.Match[str], unit: str, size: float) -> StatedScale:
    scale = float(f"{1.0 / _step(found):.7g}")
    text = found[0].strip(" _")
    text = f"{text})" if "(" in text else text
    text = text if found["counts"] else f"{text} a count"
    return StatedScale(scale, f"count per {unit}", size / scale, text)
