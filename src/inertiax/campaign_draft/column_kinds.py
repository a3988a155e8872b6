"""Which sensor three columns are of, by what they are called and by how steady their norm is."""

import re
from typing import Literal

import numpy as np

from .column_triads import called
from .column_words import is_a_rate, means, symbol
from .raw_log import RawLog


Triad = tuple[str, str, str]
Kind = Literal["accel", "gyro"]
STEADY = 0.5  # spread of the norm, 5 to 95 %, over its median
# The first of a triad that is called by its axis alone, or by that and what was done with it.
_OF_NO_NAME = re.compile(r"^(?:(?:axis|mean|avg|average|raw)_)?x$")


def kind_of(name: str, hint: str) -> Kind | None:
    """What a triad is by its name (`column_triads.called`), and by a unit in words that no accelerometers have."""
    if means("gyro", name) and not name.startswith("gf"):
        return "gyro"
    sole = "accel" if means("accel", name) or _OF_NO_NAME.match(name) else symbol(name)
    return "gyro" if sole == "accel" and is_a_rate(hint) else sole


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


def unsteadiness(log: RawLog, triad: Triad) -> float:
    """Spread of a triad's norm over its median: small where gravity is in it."""
    norm = np.linalg.norm([log.numbers[n] for n in triad], axis=0)
    low, middle, high = np.nanquantile(norm, [0.05, 0.5, 0.95])
    return float((high - low) / middle) if middle > 0 else np.inf
