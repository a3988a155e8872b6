"""A line of names that is one name short of its data: the first field or the last has none.

R writes row numbers before the columns that it names, and a logger whose stamp has two parts names it once. Every
other column is beside its name all the same, once it is told at which end the name is missing:

* under a name of a counter or a clock stands what hardly ever goes back;
* a first field that goes up by one from row to row numbers the rows, where the names leave that open;
* a field that is no number, or the same in all rows, is the one that nobody named, if the other end is none such.
"""

import itertools
import re
from collections.abc import Sequence


_SET_BACK = 0.02  # of the rows: a counter of 8 bits is full every 256; noise goes back in a half
_FEWEST_ROWS = 10  # by which a counter is told from outputs: these rise ten times running once in ten factorial
_CLOCK_OR_COUNTER = re.compile(
    r"count|packet|index|seq|sample|time|stamp|millis|micros|zeit|zaehler|^(?:t|n|nr|id)$",
    re.IGNORECASE,
)
_AXES = ("xyz", "XYZ")


def names_axes(names: Sequence[str]) -> bool:
    """Whether some three of the names differ in a letter x, y, z alone, as no sentence and no line of settings does."""
    return any(
        all(n[:k] + a + n[k + 1 :] in names for a in axes)
        for axes in _AXES
        for n in names
        for k, letter in enumerate(n)
        if letter == axes[0]
    )


def with_unnamed(
    names: tuple[str, ...], rows: Sequence[Sequence[str]], line: int, where: str
) -> tuple[str, ...]:
    """The names with an empty one at the end that lacks it.

    **Arguments:** `rows` are the first rows of data, of one field more than there are names; `line` holds the names.
    Raises `ValueError` where the numbers do not tell which field has no name.
    """
    columns = [[_number(field) for field in column] for column in zip(*rows, strict=True)]
    first, last = ("", *names), (*names, "")
    fits = [made for made in (first, last) if _clocks_go_on(made, columns)]
    if len(fits) == 1:
        return fits[0]
    told = [x for x in columns[0] if x is not None]
    rises_by_one = all(b - a == 1.0 for a, b in itertools.pairwise(told))
    if len(told) == len(rows) >= _FEWEST_ROWS and rises_by_one:
        return first
    nothing = [c[0] is None or len(set(c)) == 1 for c in (columns[0], columns[-1])]
    if nothing[0] != nothing[1] and len(rows) > 1:
        return first if nothing[0] else last
    raise ValueError(
        f"{where}: line {line} names {len(names)} columns but the rows have {len(names) + 1} fields, and their numbers "
        "do not tell whether the first or the last has no name; write one for it at the line's start or end."
    )


def _clocks_go_on(names: Sequence[str], columns: Sequence[Sequence[float | None]]) -> bool:
    """Whether what stands under names of clocks and counters does not go back, as far as it is numbers."""
    for name, column in zip(names, columns, strict=True):
        told = [x for x in column if x is not None]
        if not _CLOCK_OR_COUNTER.search(name) or len(told) < max(_FEWEST_ROWS, len(column)):
            continue
        back = sum(b < a for a, b in itertools.pairwise(told))
        if back > _SET_BACK * len(told):
            return False
    return True


def _number(field: str) -> float | None:
    try:
        return float(field.replace(",", "."))
    except ValueError:
        return None
