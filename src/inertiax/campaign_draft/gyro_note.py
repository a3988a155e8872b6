"""The gyros' scale by what the lines above the names say of it: `GYRO 0.0009375 deg/s/LSB`, `gyro 16.4 LSB/dps`."""

import re
from collections.abc import Iterable


_NUMBER = r"(?<![\w.,])(\d+(?:[.,]\d+)?(?:e[-+]?\d+)?)"
_COUNT = r"(?:lsb|counts?|digits?|cts?)\b"
_PER = r" ?(?:/|per) ?"
_RATE = r"(m?)(?:dps\b|\(?(?:deg(?:rees?)?|°|º) ?(?:/|per) ?s(?:ec(?:ond)?)?\b\)?)"
_GYROS = re.compile(r"gyro|angular|\brates?\b|drehrate")
_OTHERS = re.compile(r"acc|temp|mag|probe|therm")
_PER_RATE = re.compile(rf"{_NUMBER} ?{_COUNT}{_PER}{_RATE}")
_PER_COUNT = re.compile(rf"{_NUMBER} ?{_RATE}{_PER}{_COUNT}")
_MILLI = 1000.0


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
        text = text if other is None else text[: other.start()]
        found, upside_down = _PER_RATE.search(text), False
        if found is None:
            found, upside_down = _PER_COUNT.search(text), True
        if found is None or not (value := float(found[1].replace(",", "."))) > 0.0:
            continue
        factor = _MILLI if found[2] else 1.0
        return factor / value if upside_down else factor * value
    return None
