"""Columns that belong together by their names: x, y, z of a triad, arrays of six, attitudes."""

import re
from collections.abc import Sequence

import numpy as np

from .column_words import plain, triad_of_words, without_unit
from .raw_log import RawLog


_UNIT = 1e-3  # of a quaternion's norm, as it is printed
# Letters before digits: imu0_x, imu1_x, imu2_x are of three sensors.
_AXES = ("xyz", "XYZ", "123", "012", "abc", "ABC")
_BETWEEN = re.compile(r"(?<=[a-z0-9])(?=[A-Z])")  # where a word begins in motionRate


def triads_by_name(names: Sequence[str]) -> list[tuple[str, str, str]]:
    """Columns that differ in one letter x, y, z (or X, Y, Z; 1, 2, 3; 0, 1, 2; a, b, c; A, B, C) alone, or in a word
    such as roll, pitch, yaw."""
    found = _by_letter(names)
    left = [n for n in names if not any(n in t for t in found)]
    by_plain = {plain(n): n for n in left}
    if len(by_plain) == len(left):  # HX, HY, Hz
        found += [(by_plain[x], by_plain[y], by_plain[z]) for x, y, z in _by_letter(list(by_plain))]
        by_plain = {k: n for k, n in by_plain.items() if not any(n in t for t in found)}
    found += [t for n in by_plain.values() if (t := triad_of_words(n, by_plain)) is not None]
    return found


def _by_letter(names: Sequence[str]) -> list[tuple[str, str, str]]:
    found: list[tuple[str, str, str]] = []
    taken: set[str] = set()
    for name in names:
        for axes in _AXES:
            for place, letter in enumerate(name):
                if letter != axes[0] or name in taken:
                    continue
                triad = tuple(name[:place] + a + name[place + 1 :] for a in axes)
                if all(t in names and t not in taken for t in triad):
                    found.append((triad[0], triad[1], triad[2]))
                    taken.update(triad)
                    found += _second_of_six(name[:place], name[place + 1 :], names, axes)
                    taken.update(found[-1])
    return found


def called(triad: tuple[str, str, str]) -> str:
    """What three columns are called, with the first axis behind it wherever it stands: `av_x` of xav, yav, zav.

    In lower case, without units and without the path before it (`/imu/angular_velocity/x` is `angular_velocity_x`).
    """
    place = _axis(triad)
    if place is None:
        return plain(without_unit(triad[0])).split("/")[-1]
    before, after = _BETWEEN.sub("_", triad[0][:place]), triad[0][place + 1 :]
    inside = before[-1:].isalnum() and after[:1].isalnum()
    rest = without_unit(f"{before}{'_' * inside}{after}")
    name = plain(rest).rstrip(" /_.:-").split("/")[-1].strip("_.:- ")
    return f"{name}_{plain(triad[0][place])}".removeprefix("_")


def _axis(triad: tuple[str, str, str]) -> int | None:
    """Where the one letter stands in which three names differ; `None` where they differ in words."""
    if len({len(n) for n in triad}) > 1:
        return None
    places = [k for k, letters in enumerate(zip(*triad, strict=True)) if len(set(letters)) > 1]
    return places[0] if len(places) == 1 else None


def _second_of_six(
    before: str, after: str, names: Sequence[str], axes: str
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


def is_one_array(names: tuple[str, ...]) -> bool:
    """Whether the columns are those of one array, as a MATLAB or HDF5 file holds it: numbered from 0, without names."""
    first = names[0].removesuffix("_0") if names else ""
    return len(names) > 3 and names == tuple(f"{first}_{k}" for k in range(len(names)))


def fourth_of(log: RawLog, triad: tuple[str, str, str]) -> str | None:
    """The column w beside x, y, z; `None` where there is none."""
    place = _axis(triad)
    fourth = None if place is None else {"x": "w", "X": "W"}.get(triad[0][place])
    if fourth is None or place is None:
        return None
    name = triad[0][:place] + fourth + triad[0][place + 1 :]
    return name if name in log.numbers else None


def is_of_quaternion(log: RawLog, triad: tuple[str, str, str]) -> bool:
    """Whether three columns with one called w beside them have a norm of 1 together: an attitude."""
    name = fourth_of(log, triad)
    if name is None or any(n not in log.numbers for n in triad):
        return False
    norm = np.linalg.norm([log.numbers[n] for n in (*triad, name)], axis=0)
    return abs(float(np.nanmedian(norm)) - 1.0) < _UNIT


def left_aside(log: RawLog, kind: str, triad: tuple[str, str, str]) -> str:
    """The remark on a triad beside another of its kind: with a column w it is an attitude, whose norm need not be 1,
    as of a filter that does not keep it."""
    columns = ", ".join(triad)
    fourth = fourth_of(log, triad)
    if fourth is not None:
        return f"{columns}, {fourth}: a quaternion by their names, left aside"
    return f"{columns}: a further {kind} triad, left aside"
