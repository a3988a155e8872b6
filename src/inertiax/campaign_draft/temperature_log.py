"""A temperature that was logged apart from the device: by a chamber, or by a probe's own logger."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from .clock import ALL_UNITS, Clock, UNITS
from .column_roles import roles_of
from .column_words import LONG_TIME_UNITS, means, said, TIME_UNITS
from .raw_log import RawLog, read_log
from .raw_triads import absolute, RawTriads
from .split_stamps import EPOCH
from .table_log import clock_column, without_repeats_of_stamps
from .temperature_unit import temperature_unit, TemperatureUnit
from .toml_text import Line


_ALIKE = 4.0  # times as long: the next unit is 24 times another, or more
_DAY, _HALF_HOUR = 86400.0, 1800.0  # s; time zones are half hours apart
_LARGEST_ZONE = 26 * 3600.0  # s, from UTC−12 to UTC+14


class Delay(NamedTuple):
    """How late a log's stamps are, and why it is taken to be so late; `None` s where both logs have one clock."""

    seconds: float | None
    why: str = ""


class ProbeLog(NamedTuple):
    """What of a temperature's log goes into the campaign."""

    path: Path
    clock: Clock
    column: str
    unit: TemperatureUnit
    delay: Delay


def split_off(others: Sequence[Path]) -> tuple[tuple[Path, ...], tuple[Path, ...]]:
    """The device's further logs, and those of a temperature alone, which are called so."""
    probes = tuple(p for p in others if p.is_file() and means("temperature", p.stem) and _alone(p))
    return tuple(p for p in others if p not in probes), probes


def in_rows_of_its_own(found: RawTriads, paths: Sequence[Path]) -> tuple[ProbeLog, ...]:
    """The device's files where each has its temperature in rows without a sample, as a log of messages; else none."""
    name, log = found.roles.temperature, found.log
    if name is None or found.clock.name is None or not log.has_header:
        return ()
    if np.isfinite(log.numbers[name]).sum() > 1:
        return ()
    logs = [read_log(path) for path in paths]
    if not all(name in x.numbers and np.isfinite(x.numbers[name]).sum() > 1 for x in logs):
        return ()
    unit = temperature_unit(logs[0], name)
    if unit.unit is None:
        return ()
    clock = found.clock._replace(why="the device's own, in rows without a sample")
    return tuple(ProbeLog(path, clock, name, unit, Delay(None)) for path in paths)


def probe_logs(found: RawTriads, paths: Sequence[Path]) -> tuple[ProbeLog, ...]:
    """The logs of a device's temperature. Raises `ValueError` where one has no clock, or no temperature."""
    made = tuple(_probe_log(found, path) for path in paths)
    for one in made[1:]:
        if one.column != made[0].column:
            raise ValueError(
                f"{one.path}: its temperature is {one.column!r}, that of {made[0].path.name} {made[0].column!r}; write "
                "both with one name."
            )
    return made


def file_lines(probes: Sequence[ProbeLog], names: list[str]) -> list[Line]:
    """The logs under `[recordings]` by their `names`, and by how much they are late."""
    if not probes:
        return []
    lines = [Line("temperature_files", names, "the temperature, logged apart")]
    told = [p.delay for p in probes if p.delay.seconds is not None]
    if told:
        delays = [round(p.delay.seconds or 0.0, 3) for p in probes]
        said = delays[0] if len(delays) == 1 else delays
        lines.append(Line("temperature_delay", said, told[0].why, certain=False))
    return lines


def column_lines(probes: Sequence[ProbeLog]) -> list[Line]:
    """The temperature and its clock under `[columns]`."""
    if not probes:
        return []
    first = probes[0]
    clock = {} if first.clock.unit is None else {"unit": first.clock.unit}
    why = f"of the temperature's log, {first.clock.why}"
    return [
        Line("temperature", first.unit.of_column(first.column), first.unit.why, first.unit.certain),
        Line(
            "temperature_time",
            {"name": first.clock.name, **clock},
            why,
            certain=first.clock.certain,
        ),
    ]


def _alone(path: Path) -> bool:
    """Whether a file holds a temperature and no triad."""
    try:
        log = read_log(path)
        _column(log, _clock_column(log))
    except ValueError:
        return False
    try:
        roles_of(log)
    except ValueError:
        return True
    return False


def _clock_column(log: RawLog) -> str | None:
    """The log's clock: no temperature, which may rise throughout, too; an array's columns are all named alike."""
    stem = log.names[0].removesuffix("_0")
    array = len(log.names) > 1 and log.names == tuple(f"{stem}_{k}" for k in range(len(log.names)))
    others = {n: v for n, v in log.numbers.items() if array or not means("temperature", n)}
    return clock_column(log._replace(numbers=others))


def _column(log: RawLog, clock: str | None) -> str:
    """The probe's column: of several, one that is not of a chamber's air or a setting. Raises `ValueError` without."""
    told = [n for n, v in log.numbers.items() if n != clock and np.isfinite(v).sum() > 1]
    named = [n for n in told if means("temperature", n)]
    named.sort(key=lambda n: means("surroundings", n))
    if not named and len(told) != 1:
        raise ValueError(
            f"{log.path}: no column is called a temperature among {list(log.names)[:16]}; name it under [columns] in a "
            "campaign.toml."
        )
    return (named or told)[0]


def _probe_log(found: RawTriads, path: Path) -> ProbeLog:
    log = read_log(path)
    if not log.has_header:
        raise ValueError(
            f"{path}: a temperature's log needs a line of column names above its rows."
        )
    name = _clock_column(log)
    if name is None:
        raise ValueError(
            f"{path}: no column of times in it, of which a temperature's log needs one: seconds, or stamps as "
            "2026-03-02 09:30:00."
        )
    log = without_repeats_of_stamps(log, name)
    column = _column(log, name)
    unit = temperature_unit(log, column)
    if unit.unit is None:
        raise ValueError(f"{path}: {unit.why}.")
    device = absolute(found.log, found.clock)
    clock = _clock(log, name, float(device[-1] - device[0]))
    return ProbeLog(path, clock, column, unit, _delay(device, absolute(log, clock)))


def _clock(log: RawLog, name: str, duration: float) -> Clock:
    """The clock of a log that is as slow as it likes: a unit that the file says, else that in which it lasts about as
    long as the device's log (`duration`, s)."""
    if name in log.stamps:
        return Clock(name, None, None, log.stamps[name], "stamps as text", True)
    values = log.numbers[name]
    since_1970 = [u for u, f in UNITS.items() if EPOCH[0] < f * float(values[0]) < EPOCH[1]]
    words = said((*TIME_UNITS, *LONG_TIME_UNITS), log.hint(name))
    last = float(values[-1] - values[0])
    off = {u: abs(math.log(f * last / max(duration, 1e-9))) for u, f in ALL_UNITS.items()}
    nearest = min(off, key=lambda u: off[u])
    unit = next(iter(since_1970), words) or nearest
    why = "times since 1970" if since_1970 else "as the file says"
    if not since_1970 and words is None:
        why = f"in {unit} it lasts {ALL_UNITS[unit] * last:.4g} s, most like the device's log"
    seconds = ALL_UNITS[unit] * (values - values[0])
    certain = bool(since_1970) or words is not None or off[nearest] < math.log(_ALIKE)
    return Clock(name, unit, None, seconds, why, certain)


def _delay(device: Float[np.ndarray, " time"], probe: Float[np.ndarray, " readings"]) -> Delay:
    """How late the readings' stamps are.

    Two clocks with dates that have no time in common differ by a time zone if that is enough, and a time of day is of
    the device's day if it then has. Clocks without dates, and all others, are taken to begin at once.
    """
    late = "s, by which the temperature's stamps are late"
    dated = [EPOCH[0] < x[0] < EPOCH[1] for x in (device, probe)]
    covers = lambda delay: probe[0] - delay <= device[0] and device[-1] <= probe[-1] - delay
    apart = probe[-1] < device[0] or device[-1] < probe[0]
    if all(dated) and not apart:
        return Delay(None)
    begun = float(probe[0] - device[0])
    zone = _HALF_HOUR * round(begun / _HALF_HOUR)
    if all(dated) and abs(zone) <= _LARGEST_ZONE and covers(zone):
        return Delay(zone, f"{late}: the hours between two time zones, if both logs are of one run")
    midnight = _DAY * float(np.floor(probe[0] / _DAY) - np.floor(device[0] / _DAY))
    of_day = [0.0 <= x[0] < _DAY for x in (device, probe)]
    if (dated[0] and of_day[1] or dated[1] and of_day[0]) and covers(midnight):
        return Delay(midnight, f"{late}: a time of day, if both logs are of one day and time zone")
    if not any(dated) and not apart:
        return Delay(0.0, f"{late}: both clocks begin anew, and so it is if they are one")
    return Delay(begun, f"{late}, for its clock is another: so it is if both began at once")
