"""A table's log of its own beside the device's: how late its clock is, and its columns at the device's rows."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import scipy.optimize
import scipy.signal
from jaxtyping import Bool, Float

from ..data.formats.columns import angle_scale, rate_scale
from ..data.formats.delay import Clocks, compared, delay_of, evened
from ..data.formats.held_angles import held_rows, without_repeats, without_stairs
from ..data.formats.table_angles import ideal_readings
from .clock import Clock, clock_of
from .raw_log import RawLog, read_log
from .raw_triads import absolute, columns, in_rows, RawTriads
from .table_angles import TableAngles
from .toml_text import Line


_GRID = 20.0  # Hz, on which the two logs are first compared
_RUN = 3  # rows in a row in which a column of a table that moves changes
_STANDS = 0.2  # of the rows, at least, in which an angle or a rate stays
_MOVES = 0.05  # of its fastest, above which the device turns
_WRAPS = 315.0  # deg from row to row: a whole turn is left out
_MOST = 20_000  # rows of a fit
_RATE = 0.95  # correlation of a size with the gyros', from which it is a rate's (convention)
_NEXT_TO_NOTHING = 0.05  # of the greatest share (convention)
_GROWS = 0.5  # of the steps at least: a logger may write each of a table's rows twice
_SAME = 2e-3  # s: delays of two clocks that are told no better than this


class TableLog(NamedTuple):
    """What of the table's log goes into the campaign."""

    path: Path
    clock: Clock
    log: RawLog
    seconds: Float[np.ndarray, " rows"]  # on the table's clock
    clocks: Clocks  # how late its stamps are


Beside = tuple[RawTriads, TableLog]  # a device's log with the table's columns, and the table's log


def beside_each(
    found: RawTriads, others: Sequence[RawLog], tables: Sequence[Path]
) -> tuple[Beside, ...]:
    """Each log of the device with its table's columns at its rows: `found`, then `others` of the same columns.

    **Arguments:** `tables` are one log of the table for all of the device's, or one for each, in their order.

    Raises `ValueError` for another number of them, and as `beside` does.
    """
    logs = 1 + len(others)
    if len(tables) not in (1, logs):
        raise ValueError(
            f"--table names {len(tables)} logs of the table for {logs} of the device; give one for all, or one for "
            "each, in their order."
        )
    each = (found, *(_like(found, other) for other in others))
    made = [beside(one, path) for one, path in zip(each, tuple(tables) * (logs // len(tables)))]
    for _, own in made[1:]:
        missing = [n for n in made[0][1].log.names if n not in own.log.names]
        if missing:
            raise ValueError(
                f"{own.path}: has no column {', '.join(map(repr, missing[:4]))}, which {made[0][1].path.name} has."
            )
    return tuple(made)


def _like(first: RawTriads, log: RawLog) -> RawTriads:
    """A further log of the device, with the columns of its first one."""
    rows = len(next(iter(log.numbers.values())))
    accel, gyro = columns(log, first.roles.accel), columns(log, first.roles.gyro)
    clock = clock_of(log, first.clock.name, rows, first.roles.temperature, accel)
    made = RawTriads(log, first.roles, clock, None, None, clock.seconds, None, None)
    return in_rows(made, clock.seconds, accel, gyro)


def beside(found: RawTriads, path: Path) -> Beside:
    """The device's log with the table's columns at its rows, and the table's log.

    The delay is that for which the device turns when columns of the table change.

    Raises `ValueError` where the table's log has no clock, and where the triads are logged apart.
    """
    if found.gyro_log is not None:
        raise ValueError(
            f"{path}: a table's own log is put beside logs of both triads, and these log them apart."
        )
    log = read_log(path)
    name = clock_column(log)
    if name is None:
        raise ValueError(f"{path}: no column of times in it, of which a table's log needs one.")
    log = without_repeats_of_stamps(log, name)
    clock = clock_of(log, name, len(next(iter(log.numbers.values()))))
    if found.gyro is None:
        raise ValueError(
            f"{path}: a table's log of its own is put beside gyros, of which {found.log.path.name} has none."
        )
    for at, one in ((path, clock), (found.log.path, found.clock)):
        if one.name is None:
            raise ValueError(
                f"{path}: a table's log of its own is put beside gyros by the stamps of both logs, and {at.name} has "
                f"none that serve: {one.why}."
            )
    time, seconds = absolute(found.log, found.clock), absolute(log, clock)
    if len(time) != len(found.gyro):
        raise ValueError(
            f"{found.log.path}: rows without numbers; drop them to put a table's log beside."
        )
    speed = found.turning
    said = {n: v for n, v in log.numbers.items() if n != name}
    whole = {n: _continuous(v) for n, v in said.items()}
    # Of an angle over a whole turn; or of a rate, from −180 to 180.
    jumps = [n for n in said if whole[n] is not said[n]]
    told = [*whole.values(), *(said[n] for n in jumps)]
    delay = _finer(time, speed, seconds, told, _coarse(time, speed, seconds, told))
    put = {n: np.interp(time + delay, seconds, v) for n, v in whole.items()}
    for n in jumps:
        rate = np.interp(time + delay, seconds, said[n])
        if np.corrcoef(np.abs(rate), speed)[0, 1] > _RATE:
            put[n] = rate
    merged = found.log._replace(numbers=put | found.log.numbers)
    return found._replace(log=merged), TableLog(
        path, clock, log, seconds, Clocks(delay, 0.0, float(seconds[0]))
    )


def with_delay(found: RawTriads, table: TableLog, angles: TableAngles) -> TableLog:
    """The same with the delay for which the gyros turn as the angles say."""
    scale = angle_scale(angles.unit, "table_angles")
    turned = np.stack([scale * _continuous(table.log.numbers[n]) for n in angles.names], axis=1)
    # Over whole telegrams: a rate that jumps from each to the next fits as well half a row off.
    held = held_rows(turned)
    turned = without_stairs(without_repeats(turned, table.seconds), table.seconds)
    before, after = (np.clip(np.arange(len(turned)) + n, 0, len(turned) - 1) for n in (-held, held))
    rates = (turned[after] - turned[before]) / (table.seconds[after] - table.seconds[before])[
        :, None
    ]
    if angles.rates is not None and len(angles.rates) == len(angles.names):
        factor = rate_scale(angles.rate_unit, "table_rates")
        rates = np.stack([factor * table.log.numbers[n] for n in angles.rates], axis=1)
    ideal = ideal_readings(angles.table, turned, rates, 1.0, None)
    assert ideal.rate is not None
    time = absolute(found.log, found.clock)
    speed = evened(time, found.turning)
    told = evened(table.seconds, np.linalg.norm(ideal.rate, axis=1))
    return table._replace(clocks=compared(time, speed, table.seconds, told, table.clocks))


def refined(each: Sequence[Beside], angles: TableAngles) -> tuple[TableLog, ...]:
    """`with_delay` of each log of the device."""
    return tuple(with_delay(found, table, angles) for found, table in each)


def refined_by_rate(each: Sequence[Beside], name: str) -> tuple[TableLog, ...]:
    """The tables' logs with the delays for which the gyros turn as one column says, of which all else may be late."""
    made = []
    for found, table in each:
        rate, time = np.abs(table.log.numbers[name]), absolute(found.log, found.clock)
        clocks = compared(time, found.turning, table.seconds, rate, table.clocks)
        made.append(table._replace(clocks=clocks))
    return tuple(made)


def column_lines(table: TableLog) -> list[Line]:
    """The table's clock under `[columns]`."""
    unit = {} if table.clock.unit is None else {"unit": table.clock.unit}
    return [
        Line(
            "table_time",
            {"name": table.clock.name, **unit},
            f"of the table's log, {table.clock.why}",
        )
    ]


def clock_lines(tables: Sequence[TableLog]) -> list[Line]:
    """The delay under `[table]`, and the drift where there is one: one number where it is the same for all logs, else
    one for each."""
    delays = [round(float(t.clocks.delay), 4) for t in tables]
    same = max(delays) - min(delays) < _SAME
    why = "s, by which the table's stamps are late: so the gyros turn as it does"
    lines = [
        Line("delay", round(float(np.median(delays)), 4), why)
        if same
        else Line("delay", delays, f"{why}; of each log, for the clocks begin anew")
    ]
    drifts = [round(float(t.clocks.drift), 2) for t in tables]
    if any(drifts):
        said = drifts[0] if len(drifts) == 1 else drifts
        lines.append(
            Line("drift", said, "ppm, by which the table's clock runs faster than the device's")
        )
    return lines


def without_repeats_of_stamps(log: RawLog, name: str) -> RawLog:
    """Without rows that do not go on from all above them, which a logger writes that asks faster than its table
    answers; `read_table_log` leaves out the same."""
    stamps = (log.stamps | log.numbers)[name]
    later = np.r_[True, stamps[1:] > np.maximum.accumulate(stamps)[:-1]]
    kept = lambda columns: {n: v[later] if len(v) == len(later) else v for n, v in columns.items()}
    return log._replace(numbers=kept(log.numbers), stamps=kept(log.stamps))


def clock_column(log: RawLog) -> str | None:
    """The first column that does not go back, and moves on all along."""
    grows = lambda v: bool(np.all(np.diff(v) >= 0.0) and np.mean(np.diff(v) > 0.0) > _GROWS)
    return next((n for n, v in (log.stamps | log.numbers).items() if len(v) > 2 and grows(v)), None)


def _continuous(values: Float[np.ndarray, " rows"]) -> Float[np.ndarray, " rows"]:
    """Degrees that begin anew after a whole turn, going on; other columns as they are."""
    steps = np.diff(values)
    turns = np.where(np.abs(steps) > _WRAPS, np.round(steps / 360.0), 0.0)
    if np.ptp(values) > 361.0 or not turns.any():
        return values
    return values - 360.0 * np.r_[0.0, np.cumsum(turns)]


def _table_moves(columns: list[Float[np.ndarray, " rows"]]) -> Bool[np.ndarray, " rows"]:
    """Rows in which a column that often stands has changed in several rows in a row, or telegrams."""
    moves = np.zeros(len(columns[0]), bool)
    for values in columns:
        changed = np.r_[False, np.diff(values) != 0.0]
        held = held_rows(values[:, None])
        changed = np.convolve(changed, np.ones(held))[: len(changed)] > 0.0
        runs = np.convolve(changed, np.ones(_RUN * held), "same") >= _RUN * held
        if np.mean(~changed) >= _STANDS:
            moves |= runs
    return moves


def _table_turns(columns: list[Float[np.ndarray, " rows"]]) -> Bool[np.ndarray, " rows"]:
    """Rows in which a column that often stands changes as fast as the device must turn to count as turning: more than
    an encoder's noise, which changes in all rows."""
    turns = np.zeros(len(columns[0]), bool)
    for values in columns:
        change = np.abs(np.gradient(values))
        fast = change > _MOVES * np.quantile(change, 0.99)
        if np.mean(~fast) >= _STANDS:
            turns |= fast
    return turns


def _masks(columns: list[Float[np.ndarray, " rows"]]) -> list[Bool[np.ndarray, " rows"]]:
    """When a table may move: where columns change, as angles do, and where one is not zero, as a rate is then, which
    may step from one value to the next."""
    size = [np.abs(v) for v in columns if v.min() < 0.0 < v.max()]
    return [
        _table_moves(columns),
        _table_turns(columns),
        *(v > _MOVES * np.quantile(v, 0.99) for v in size),
    ]


def _coarse(
    time: Float[np.ndarray, " rows"],
    speed: Float[np.ndarray, " rows"],
    seconds: Float[np.ndarray, " others"],
    columns: list[Float[np.ndarray, " others"]],
) -> float:
    """The delay at which the device turns when the table moves, to a step of the grid; any size.

    Each mask of the table's motion has one that is most like the device's turns; of these the columns explain the
    speed best at the right one, while a mask may be like turns that come again at even intervals.
    """
    onto = lambda t, x: np.interp(np.arange(t[0], t[-1], 1.0 / _GRID), t, x)
    turns = onto(time, (speed > _MOVES * np.quantile(speed, 0.99)).astype(float))
    delays = set()
    for mask in _masks(columns):
        moved = onto(seconds, mask.astype(float))
        moved -= moved.mean()
        alike = scipy.signal.correlate(moved, turns - turns.mean(), method="fft")
        lag = int(np.argmax(alike)) - (len(turns) - 1) if alike.max() > 0.0 else 0
        delays.add(float(seconds[0] - time[0] + lag / _GRID))
    return min(sorted(delays), key=lambda d: _shares(time, speed, seconds, columns, d)[1])


def _shares(
    time: Float[np.ndarray, " rows"],
    speed: Float[np.ndarray, " rows"],
    seconds: Float[np.ndarray, " others"],
    columns: list[Float[np.ndarray, " others"]],
    delay: float,
) -> tuple[Float[np.ndarray, " others"], float]:
    """The speed that the sum of squared columns and of their squared changes tells which is nearest to the device's
    squared one at this delay, at the table's rows, and how far off it is."""
    rates = [*columns, *(np.gradient(c, seconds) for c in columns)]
    # Rows at rest, too, where it must be zero.
    rows = np.arange(len(time))[:: max(1, len(time) // _MOST)]
    squares = np.stack([np.square(r) for r in rates], axis=1)
    at = np.stack([np.interp(time[rows] + delay, seconds, s) for s in squares.T], axis=1)
    size = np.maximum(np.linalg.norm(at, axis=0), 1e-300)
    share, off = scipy.optimize.nnls(at / size, np.square(speed[rows]))
    # What explains next to nothing here may be all there is elsewhere, such as the change of a rate that steps.
    share[share < _NEXT_TO_NOTHING * share.max(initial=0.0)] = 0.0
    return np.sqrt(np.maximum(squares @ (share / size), 0.0)), float(off)


def _finer(
    time: Float[np.ndarray, " rows"],
    speed: Float[np.ndarray, " rows"],
    seconds: Float[np.ndarray, " others"],
    columns: list[Float[np.ndarray, " others"]],
    delay: float,
) -> float:
    """The delay by the columns' speed that is nearest to the device's."""
    told, _ = _shares(time, speed, seconds, columns, delay)
    found = delay_of(time, speed, seconds - delay, told)
    return delay if found is None else delay + found[0]
