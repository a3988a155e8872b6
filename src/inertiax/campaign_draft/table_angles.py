"""A station's angles: which columns are the angles of which axis, where the axes point, and how the device stands.

All tables of one, two or three axes at right angles are tried, with the device in each of its 24 attitudes: gravity at
rest tells which one it is, up to a turn of the whole station about the vertical, and the gyros tell what gravity does
not, an axis that stands upright.
"""

import itertools
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from ..data.formats.columns import GYRO_UNITS
from ..data.formats.held_angles import held_rows
from ..data.formats.table_angles import DIRECTIONS, ideal_readings
from ..data.formats.turntable import Turntable
from .accel_unit import directions
from .raw_triads import RawTriads
from .references import labels_while_moving
from .resting import Resting


_NEAR = 0.1  # rms of the predicted minus the measured direction, rad: offsets and misalignments of consumer parts
_BETTER = 3.0  # times as far as that must any other table be
_SAME = 0.02  # rad: two tables that predict alike are one
_ALIKE = 0.9  # correlation of the gyros with the rates of the angles
_STILL = 0.02  # deg: within a rest, of an axis that stands
_JUMP = 5.0  # times the usual change from row to row
_FEWEST = 6  # rests in different directions
_MOST_RESTS, _MOST_MOVING = 200, 400  # that are looked at
_MOST_COLUMNS = 4
_APART = 0.25  # s before and after, over which a plateau's rate
_SAME_RATE = 0.01  # of itself stays
_TWINS = 0.1  # deg: no encoder is further from where its table was sent
_AGREE = 0.95  # of the rests: two axes may well stand alike at half of them
_COMMANDED = re.compile(
    r"cmd|command|demand|set|target|nominal|soll|vorgabe|consigne", re.IGNORECASE
)
_RADIANS = 7.0  # a whole turn is below; in degrees it would be no table's angle
_UNITS = {"deg": np.pi / 180.0, "rad": 1.0}


class TableAngles(NamedTuple):
    """The angles' columns, the outermost first, their unit, those of the rates, and the table."""

    names: tuple[str, ...]
    unit: str
    rates: tuple[str, ...] | None
    rate_unit: str
    table: Turntable
    why: str
    moving: list[int]  # labels of positions with which the table moves


class _Fit(NamedTuple):
    order: tuple[int, ...]
    table: Turntable
    force: Float[np.ndarray, "row 3"]  # predicted directions, of rests and of rows in motion
    away: float  # rms from what gravity reads, rad
    alike: float  # correlation with the gyros


def table_angles(found: RawTriads, rests: Resting) -> TableAngles | None:
    """The table whose angles stand in a log's columns that nothing else reads; `None` where none fits alone.

    Angles may be empty while the table moves.
    """
    log, accel = found.log, found.accel
    rows = len(found.seconds)
    if accel is None or rests.accel is None or rests.turned or rests.single_rows:
        return None
    if any(len(v) != rows for v in log.numbers.values()) or rests.num_rests < _FEWEST:
        return None
    start, stop = _without_ends(rests.start, rests.stop)
    places = {n: _places(log.numbers[n], start, stop) for n in log.names if n not in _read(found)}
    for fewest in (3, 2):
        if fewest == 3 or 2 in places.values():
            made = _among([n for n in places if places[n] >= fewest], found, rests, start, stop)
            if made is not None:
                return made
    return None


def _among(
    candidates: list[str], found: RawTriads, rests: Resting, start: np.ndarray, stop: np.ndarray
) -> TableAngles | None:
    """The table whose angles are some of these columns; `None` where none fits alone."""
    log, accel = found.log, found.accel
    assert accel is not None and rests.accel is not None
    middle = (start + stop) // 2
    candidates, twins = without_twins(candidates, log.numbers, start, stop)
    if not 1 <= len(candidates) <= _MOST_COLUMNS:
        return None
    columns = np.stack([log.numbers[n] for n in candidates], axis=1)
    still = np.stack([_spread(columns[a:b]) for a, b in zip(start, stop)]).max(axis=1)
    kept = np.flatnonzero(still < _STILL)[:: -(-rests.num_rests // _MOST_RESTS)]
    if len(kept) == 0:
        return None
    up = directions(accel, rests.accel)[kept]
    units = ["deg" if np.nanmax(np.abs(c)) > _RADIANS else "rad" for c in columns.T]
    angles = columns * [_UNITS[u] for u in units]
    held = held_rows(angles)
    moving = _moving(columns, start[kept], stop[kept], held)
    turn = _turned(angles, held)
    turning = moving & _steady(turn, moving)
    driven = np.flatnonzero(turning[1:-1]) + 1
    driven = driven[:: max(1, -(-len(driven) // _MOST_MOVING))]
    fits = [
        fit
        for size in range(1, min(len(candidates), 3) + 1)
        for order in itertools.permutations(range(len(candidates)), size)
        if len({units[k] for k in order}) == 1
        for fit in _fits(found, order, angles, turn, middle[kept], up, driven)
    ]
    best = _the_one(fits)
    if best is None:
        return None
    names = tuple(candidates[k] for k in best.order)
    rates, rate_unit = _rates(found, turn[:, list(best.order)], turning, names)
    label = found.roles.position
    words = f"gravity at rest is where they put it to {np.degrees(best.away):.1f} deg"
    said = [t for n in names for t in twins[n]]
    if said:
        words += (
            f"; {' and '.join(said)} say the same at rest: commanded, or without an encoder's noise"
        )
    labels = [] if label is None else labels_while_moving(log.numbers[label], moving)
    return TableAngles(names, units[best.order[0]], rates, rate_unit, best.table, words, labels)


def _read(found: RawTriads) -> set[str]:
    """Columns that are something else."""
    names: set[str] = {found.clock.name or ""}
    r = found.roles
    triads = (r.accel, r.gyro, r.mag, r.reference_accel, r.reference_gyro)
    for value in (r.time, r.temperature, r.position, r.device, r.experiment, *triads):
        names.update((value,) if isinstance(value, str) else value or ())
    return names


def _places(values: Float[np.ndarray, " row"], start: np.ndarray, stop: np.ndarray) -> int:
    """At how many places a column stands at rest; none where it mostly does not stand.

    A flag has two, and so has the inner axis in the plan of six faces: those are tried where columns of three tell no
    table.
    """
    spread = np.array([_spread(values[a:b, None])[0] for a, b in zip(start, stop)])
    still = spread < _STILL
    return len(np.unique(np.round(values[(start + stop) // 2][still], 1))) * int(still.mean() > 0.5)


def without_twins(
    names: list[str],
    columns: Mapping[str, Float[np.ndarray, " row"]],
    start: np.ndarray,
    stop: np.ndarray,
) -> tuple[list[str], dict[str, list[str]]]:
    """Of columns that say the same angle at all rests, as a commanded and a measured one do, the measured one, and the
    others of each.

    The measured one is the one that no word calls commanded, then the one with an encoder's noise at rest.
    """
    middle = (start + stop) // 2
    spread = {
        n: np.array([_spread(columns[n][a:b, None])[0] for a, b in zip(start, stop)]) for n in names
    }
    noise = {n: float(np.nanmedian(v)) for n, v in spread.items()}
    twins: dict[str, list[str]] = {}
    for name in sorted(names, key=lambda n: (_COMMANDED.search(n) is not None, -noise[n])):
        turn = _whole_turn(columns[name][:, None])[0]
        for kept in twins:
            # At a rest of the force alone, in a turn about the vertical, the one may be ahead of the other.
            still = (spread[name] < _STILL) & (spread[kept] < _STILL)
            away = (columns[name][middle] - columns[kept][middle])[still]
            away = np.abs(away - turn * np.round(away / turn))
            if len(away) and np.mean(away < _TWINS) > _AGREE:
                twins[kept].append(name)
                break
        else:
            twins[name] = []
    return [n for n in names if n in twins], twins


def _without_ends(start: np.ndarray, stop: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rests without an eighth at either end, where the outputs do not show that a ramp begins, and angles do."""
    cut = (stop - start) // 8
    return start + cut, stop - cut


def _whole_turn(columns: Float[np.ndarray, "row angle"]) -> Float[np.ndarray, " angle"]:
    """Of each column, by its largest value: in degrees, or in radians."""
    largest = np.nanmax(np.abs(columns), axis=0, initial=0.0)
    return np.where(largest > _RADIANS, 360.0, 2.0 * np.pi)


def _spread(columns: Float[np.ndarray, "row angle"]) -> Float[np.ndarray, " angle"]:
    """Of each column, whole turns taken away: at rest an encoder may go to and fro between 359.999 and 0."""
    away = columns - columns[:1]
    turn = _whole_turn(columns)
    return np.ptp(away - turn * np.round(away / turn), axis=0)


def _moving(
    columns: Float[np.ndarray, "row angle"], start: np.ndarray, stop: np.ndarray, held: int
) -> Bool[np.ndarray, " row"]:
    """Rows before and after which a column changes by more than an encoder's noise does at rest; `held` are the rows
    for which a column stays the same while it moves."""
    change, turn = np.diff(columns, axis=0), _whole_turn(columns)
    change = np.abs(change - turn * np.round(change / turn))
    still = [change[a : b - 1].max(axis=0) for a, b in zip(start, stop) if b - a > 1]
    noise = np.max(still, axis=0) if still else np.zeros(columns.shape[1])
    moves = np.any(~(change <= noise), axis=1)  # also where angles are empty
    total = np.r_[0, np.cumsum(moves)]
    here = np.arange(len(columns))
    before = total[here] > total[np.maximum(here - held, 0)]
    after = total[np.minimum(here + held, len(moves))] > total[here]
    return before & after


def _steady(
    turn: Float[np.ndarray, "row angle"], moving: Bool[np.ndarray, " row"]
) -> Bool[np.ndarray, " row"]:
    """Rows whose change is none of a gap or of a jump from one plan's step to the next."""
    size = np.linalg.norm(turn, axis=1)
    moves = size[moving & (size > 0.0)]
    usual = np.median(moves) if len(moves) else 0.0
    return np.isfinite(turn).all(axis=1) & (size <= _JUMP * usual)


def _turned(angles: Float[np.ndarray, "row angle"], held: int) -> Float[np.ndarray, "row angle"]:
    """Turn from the row before to the row after, rad; angles may start anew after a whole turn. Where rows are `held`
    it is the part of a whole step."""
    both = np.zeros_like(angles)
    both[held:-held] = angles[2 * held :] - angles[: -2 * held]
    return np.arctan2(np.sin(both), np.cos(both)) / held


def _fits(
    found: RawTriads,
    order: tuple[int, ...],
    angles: Float[np.ndarray, "row angle"],
    turn: Float[np.ndarray, "row angle"],
    rest: np.ndarray,
    up: Float[np.ndarray, "rest 3"],
    driven: np.ndarray,
) -> Iterator[_Fit]:
    """Every table of these columns in this order that gravity at rest agrees with."""
    rows = np.ix_(np.r_[rest, driven], order)
    seen = None if found.gyro is None else found.gyro - np.median(found.gyro[rest], axis=0)
    cases = _attitudes()
    matrices = np.stack([np.stack([DIRECTIONS[d] for d in c], axis=1) for c in cases])
    for axes in _axes(len(order)):
        made = ideal_readings(Turntable(axes=axes), angles[rows], turn[rows], 1.0, None)
        assert made.rate is not None
        judged = seen is not None and len(driven) > 0
        if not judged and np.ptp(made.force[: len(rest)], axis=0).max() < _NEAR:
            continue  # an upright axis alone, of which gravity says nothing
        agree = np.einsum("ni,nj,mji->m", up, made.force[: len(rest)], matrices) / len(rest)
        away = np.sqrt(np.maximum(2.0 - 2.0 * agree, 0.0))
        for k in np.flatnonzero(away < _NEAR):
            alike = 1.0
            if seen is not None and judged:
                alike = _correlation(made.rate[len(rest) :] @ matrices[k], seen[driven])
            table = Turntable(axes=axes, case=cases[k])
            yield _Fit(order, table, made.force @ matrices[k], float(away[k]), alike)


def _axes(number: int) -> list[tuple[str, ...]]:
    """Directions of so many axes, neighbours at right angles."""
    square = lambda a, b: abs(np.dot(DIRECTIONS[a], DIRECTIONS[b])) < 0.5
    return [
        axes
        for axes in itertools.product(DIRECTIONS, repeat=number)
        if all(square(a, b) for a, b in itertools.pairwise(axes))
    ]


def _attitudes() -> list[tuple[str, str, str]]:
    """The 24 ways a device's x, y and z can point; east, north and up first."""
    made = [
        c
        for c in itertools.permutations(DIRECTIONS, 3)
        if np.linalg.det(np.array([DIRECTIONS[d] for d in c])) > 0.5
    ]
    return sorted(made, key=lambda c: c != ("east", "north", "up"))


def _correlation(one: np.ndarray, other: np.ndarray) -> float:
    size = np.linalg.norm(one) * np.linalg.norm(other)
    return float(np.sum(one * other) / size) if size > 0.0 else 0.0


def _the_one(fits: Sequence[_Fit]) -> _Fit | None:
    """The table that all others that fit are a turn of about the vertical; `None` where there are rivals.

    Of those turns the one with the device's axes as the room's comes first.
    """
    fits = [f for f in fits if f.alike > _ALIKE]
    if not fits:
        return None
    fewest = min(len(f.order) for f in fits)
    fits = sorted((f for f in fits if len(f.order) == fewest), key=lambda f: f.away)
    best = fits[0]
    near = [f for f in fits if f.away < _BETTER * best.away + 1e-9]
    same = [f for f in near if np.abs(f.force - best.force).max() < _SAME]
    if any(f.alike > best.alike - 0.05 for f in near if not any(f is s for s in same)):
        return None
    plain = ("east", "north", "up")
    return min(
        (f for f in same if f.alike > best.alike - 1e-6),
        key=lambda f: (
            sum(a != b for a, b in zip(f.table.case, plain)),
            [list(DIRECTIONS).index(a) for a in f.table.axes if isinstance(a, str)],
        ),
    )


def _rate_of_any(
    found: RawTriads,
    turn: Float[np.ndarray, "row angle"],
    step: Float[np.ndarray, " row"],
    moving: np.ndarray,
    angles: tuple[str, ...],
) -> tuple[tuple[str, ...] | None, str]:
    """The column that is the rate of whichever axis turns, and its unit; `None` where there is none."""
    fastest = np.abs(turn).argmax(axis=1)
    turn = turn[np.arange(len(turn)), fastest]
    rows = _at_one_rate(turn, step, moving)
    rate = turn[rows] / step[rows]
    for name in found.log.names:
        if name not in _read(found) and name not in angles:
            unit = _unit_of(found.log.numbers[name][rows], rate)
            if unit is not None:
                return (name,), unit
    return None, ""


def _at_one_rate(
    turn: Float[np.ndarray, " row"], step: Float[np.ndarray, " row"], moving: np.ndarray
) -> Bool[np.ndarray, " row"]:
    """Rows in motion at a constant rate, for a programmed rate may be written before the table has it; all rows in
    motion where there are too few."""
    rows = moving & (step > 0.0)
    rate = np.divide(turn, step, out=np.zeros(len(turn)), where=rows)
    apart = max(1, round(_APART / (0.5 * float(np.median(step[step > 0.0]))))) if rows.any() else 1
    change = np.full(len(turn), np.inf)
    if len(turn) > 2 * apart:
        change[apart:-apart] = np.abs(rate[2 * apart :] - rate[: -2 * apart])
    steady = rows & (change < _SAME_RATE * np.abs(rate))
    return steady if steady.sum() >= _FEWEST else rows


def _unit_of(values: Float[np.ndarray, " row"], rate: Float[np.ndarray, " row"]) -> str | None:
    """The unit in which a column is the rate, rad/s, wherever it is not zero, as it is while a table moves to a
    position; `None` where it is not that rate."""
    said = values != 0.0
    values, rate = values[said], rate[said]
    size = float(values @ values)
    ratio = float(rate @ values) / size if size > 0.0 else 0.0
    unit = next((u for u, f in GYRO_UNITS.items() if abs(ratio / f - 1.0) < 0.02), None)
    return unit if _correlation(rate, values) > 0.98 else None


def _rates(
    found: RawTriads,
    turn: Float[np.ndarray, "row angle"],
    moving: np.ndarray,
    angles: tuple[str, ...],
) -> tuple[tuple[str, ...] | None, str]:
    """Columns of the axes' rates and their unit, by the change of the angles; one where it is the rate of whichever
    axis turns; `None` where one is missing."""
    step = np.zeros(len(found.seconds))
    step[1:-1] = found.seconds[2:] - found.seconds[:-2]
    step[step > _JUMP * np.median(step)] = 0.0  # a gap, or another recording
    names, units = [], []
    for k in range(turn.shape[1]):
        rows = _at_one_rate(turn[:, k], step, moving)
        rate = turn[rows, k] / step[rows]
        for name in found.log.names:
            if name in _read(found) or name in angles or name in names or not rows.any():
                continue
            unit = _unit_of(found.log.numbers[name][rows], rate)
            if unit is not None:
                names.append(name)
                units.append(unit)
                break
    if len(names) < turn.shape[1] or len(set(units)) > 1:
        return _rate_of_any(found, turn, step, moving, angles)
    return tuple(names), units[0]
