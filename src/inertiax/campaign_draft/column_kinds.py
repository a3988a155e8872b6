"""Which sensor three columns are of, by what they are called and by how steady their norm is."""

import re
from typing import Literal

import numpy as np

from .column_triads import called
from .column_words import FORCE_UNITS, is_a_rate, means, said, symbol, UNIT
from .converters import G
from .raw_log import RawLog
from .toml_text import CHECK


Triad = tuple[str, str, str]
Kind = Literal["accel", "gyro"]
STEADY = 0.5  # spread of the norm, 5 to 95 %, over its median
# The first of a triad that is called by its axis alone, or by that and what was done with it.
_OF_NO_NAME = re.compile(r"^(?:(?:axis|mean|avg|average|raw)_)?x$")


_LETTER_G = re.compile(r"g[_ .-]?[fx](?![a-z])")  # of gyros for most, of a force in g for some
_GRAVITY = (1.0, G, 1000.0)  # g, m/s², mg
_NEAR_GRAVITY = 0.2  # relative: raw biases and scales of consumer accelerometers stay within
_BLOCK = 20  # rows, whose mean takes noise and vibration out of a direction
# Of the directions' squares along their second axis: one axis both ways, as a table turns, has nothing there; poses or
# a hand's turns by 25° and more do.
_SECOND_AXIS = 0.05


def kind_of(name: str, hint: str) -> Kind | None:
    """What a triad is by its name (`column_triads.called`), and by a unit in words that no accelerometers have."""
    if means("gyro", name) and not name.startswith("gf"):
        unit = UNIT.search(hint)
        force = unit is not None and said(FORCE_UNITS, unit[0]) is not None
        return "accel" if force and _LETTER_G.match(name) else "gyro"
    sole = "accel" if means("accel", name) or _OF_NO_NAME.match(name) else symbol(name)
    return "gyro" if sole == "accel" and is_a_rate(hint) else sole


def are_probes(log: RawLog, triad: Triad) -> bool:
    """Whether three columns are temperatures, one for each axis."""
    first = called(triad)
    kind = "mag" if means("mag", first) else kind_of(first, log.hint(triad[0]))
    return kind is None and means("temperature", first)


def is_g_force(name: str) -> bool:
    """Whether a triad is called gF, with gravity in it; `a` beside it is Physics Toolbox's acceleration without."""
    return re.match(r"g[_ .-]?f", name) is not None


def gyros_of_one_name(log: RawLog, kinds: dict[str, list[Triad]]) -> list[Triad]:
    """Of accelerometers that have one name with others (`ax, ay, az, ax, ay, az`), those whose norm is not steady are
    the gyros where none have a name of their own. They are moved in `kinds`."""
    named: dict[str, list[Triad]] = {}
    for triad in kinds["accel"]:
        if all(n in log.numbers for n in triad):
            named.setdefault(called(triad), []).append(triad)
    several = next((t for t in named.values() if len(t) > 1), [])
    spread = {t: unsteadiness(log, t) for t in several}
    rates = [t for t in several if spread[t] > STEADY]
    if kinds["gyro"] or len(rates) != 1 or min(spread.values()) > STEADY:
        return []
    kinds["gyro"] = rates
    kinds["accel"].remove(rates[0])
    return rates


def gravity_among_gyros(log: RawLog, kinds: dict[str, list[Triad]]) -> list[str]:
    """Remarks on triads that are called as gyros are and read what no rates are: gravity, in several directions.

    Where the name is the letter g alone and no accelerometers of the file read gravity, the triad becomes these, in
    `kinds`.
    """
    remarks = []
    whose = "the norm stays that of gravity while they point in several directions"
    if any(_reads_gravity(log, t) for t in kinds["accel"]):
        return []
    for triad in [t for t in kinds["gyro"] if _reads_gravity(log, t) and _points_about(log, t)]:
        columns = ", ".join(triad)
        if _LETTER_G.match(called(triad)):
            kinds["gyro"].remove(triad)
            kinds["accel"].insert(0, triad)
            remarks.append(f"{columns}: taken for the accelerometers, because {whose}")
        else:
            remarks.append(f"{CHECK} gyro: {whose}, as accelerometers do: {columns}")
    return remarks


def _reads_gravity(log: RawLog, triad: Triad) -> bool:
    if any(n not in log.numbers for n in triad):
        return False
    size = float(np.nanmedian(np.linalg.norm([log.numbers[n] for n in triad], axis=0)))
    near = any(abs(size / gravity - 1.0) < _NEAR_GRAVITY for gravity in _GRAVITY)
    return near and unsteadiness(log, triad) < STEADY


def _points_about(log: RawLog, triad: Triad) -> bool:
    """Whether the outputs point along more than one axis in the course of the log."""
    rows = np.stack([log.numbers[n] for n in triad], axis=1)
    rows = rows[np.isfinite(rows).all(axis=1)]
    blocks = rows[: len(rows) // _BLOCK * _BLOCK].reshape(-1, _BLOCK, 3).mean(axis=1)
    up = blocks / np.maximum(np.linalg.norm(blocks, axis=1, keepdims=True), 1e-12)
    return len(up) > 1 and bool(np.linalg.eigvalsh(up.T @ up / len(up))[1] > _SECOND_AXIS)


def unsteadiness(log: RawLog, triad: Triad) -> float:
    """Spread of a triad's norm over its median: small where gravity is in it."""
    norm = np.linalg.norm([log.numbers[n] for n in triad], axis=0)
    low, middle, high = np.nanquantile(norm, [0.05, 0.5, 0.95])
    return float((high - low) / middle) if middle > 0 else np.inf
