"""Columns that belong together by their names: x, y, z of a triad, arrays of six, attitudes."""

import numpy as np

from .column_words import plain, triad_of_words
from .raw_log import RawLog


_UNIT = 1e-3  # of a quaternion's norm, as it is printed


def triads_by_name(names: tuple[str, ...]) -> list[tuple[str, str, str]]:
    """Columns that differ in one letter x, y, z (or X, Y, Z; 1, 2, 3; 0, 1, 2; a, b, c; A, B, C) alone, or in a word
    such as roll, pitch, yaw."""
    found: list[tuple[str, str, str]] = []
    taken: set[str] = set()
    for name in names:
        if name in taken:
            continue
        for place, letter in enumerate(name):
            for axes in ("xyz", "XYZ", "123", "012", "abc", "ABC"):
                if letter != axes[0]:
                    continue
                triad = tuple(name[:place] + a + name[place + 1 :] for a in axes)
                if all(t in names and t not in taken for t in triad):
                    found.append((triad[0], triad[1], triad[2]))
                    taken.update(triad)
                    found += _second_of_six(name[:place], name[place + 1 :], names, axes)
                    taken.update(found[-1])
    by_plain = {plain(n): n for n in names if n not in taken}
    found += [t for n in by_plain.values() if (t := triad_of_words(n, by_plain)) is not None]
    return found


def _second_of_six(
    before: str, after: str, names: tuple[str, ...], axes: str
) -> list[tuple[str, str, str]]:
    """The second triad of an array of exactly six columns that are numbered from 0."""
    later = [f"{before}{k}{after}" for k in range(3, 7)]
    if axes != "012" or not set(later[:3]) <= set(names) or later[3] in names:
        return []
    return [(later[0], later[1], later[2])]


def of_one_six(one: tuple[str, str, str], other: tuple[str, str, str]) -> bool:
    """Whether two triads are an array of six columns."""
    ends = sorted(n[-1] for n in (*one, *other))
    return ends == list("012345") and len({n[:-1] for n in (*one, *other)}) == 1


def is_of_quaternion(log: RawLog, triad: tuple[str, str, str]) -> bool:
    """Whether three columns with one called w beside them have a norm of 1 together: an attitude."""
    place = next(
        (k for k, (a, b) in enumerate(zip(triad[0], triad[1], strict=True)) if a != b), None
    )
    fourth = None if place is None else {"x": "w", "X": "W"}.get(triad[0][place])
    if fourth is None or place is None:
        return False
    name = triad[0][:place] + fourth + triad[0][place + 1 :]
    if any(n not in log.numbers for n in (*triad, name)):
        return False
    norm = np.linalg.norm([log.numbers[n] for n in (*triad, name)], axis=0)
    return abs(float(np.nanmedian(norm)) - 1.0) < _UNIT
