"""A temperature that was logged apart from the device: by a chamber, or by a probe's own logger."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from .clock import Clock, UNITS
from .column_roles import roles_of
from .column_words import means, said, TIME_UNITS
from .raw_log import RawLog, read_log
from .raw_triads import absolute, RawTriads
from .split_stamps import EPOCH
from .table_log import clock_column, without_repeats_of_stamps
from .temperature_unit import temperature_unit, TemperatureUnit
from .toml_text import Line


_ALIKE = 10.0  # times as long: the next unit is a thousand times another


class ProbeLog(NamedTuple):
    """What of a temperature's log goes into the campaign."""

    path: Path
    clock: Clock
    column: str
    unit: TemperatureUnit
    delay: (
        float | None
    )  # s, by which its stamps are late if both logs began at once; `None` on one clock


def split_off(others: Sequence[Path]) -> tuple[tuple[Path, ...], tuple[Path, ...]]:
    """The device's further logs, and those of a temperature alone, which are called so."""
    probes = tuple(p for p in others if p.is_file() and means("temperature", p.stem) and _alone(p))
    return tuple(p for p in others if p not in probes), probes


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
    if any(p.delay is not None for p in probes):
        delays = [round(p.delay or 0.0, 3) for p in probes]
        why = "s, by which the temperature's stamps are late, for its clock is another: so it is if both began at once"
        lines.append(
            Line("temperature_delay", delays[0] if len(delays) == 1 else delays, why, certain=False)
        )
    return lines


def column_lines(probes: Sequence[ProbeLog]) -> list[Line]:
    """The temperature and its clock under `[columns]`."""
    if not probes:
        return []
    first = probes[0]
    value: dict[str, object] = {"name": first.column, "unit": first.unit.unit}
    if first.unit.scale is not None:
        value |= {
            "scale": first.unit.scale,
            "scale_unit": "count per degC",
            "offset": first.unit.offset,
        }
    clock = {} if first.clock.unit is None else {"unit": first.clock.unit}
    why = f"of the temperature's log, {first.clock.why}"
    return [
        Line("temperature", value, first.unit.why, first.unit.certain),
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
        _column(log, clock_column(log))
    except ValueError:
        return False
    try:
        roles_of(log)
    except ValueError:
        return True
    return False


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
    name = clock_column(log)
    if name is None:
        raise ValueError(
            f"{path}: no column of times in it, of which a temperature's log needs one."
        )
    log = without_repeats_of_stamps(log, name)
    column = _column(log, name)
    values = log.numbers[column]
    told = np.isfinite(values)
    unit = temperature_unit(log._replace(numbers={column: values[told]}), column)
    if unit.unit is None:
        raise ValueError(f"{path}: {unit.why}.")
    device = absolute(found.log, found.clock)
    clock = _clock(log, name, float(device[-1] - device[0]))
    return ProbeLog(path, clock, column, unit, _delay(device, absolute(log, clock)))


def _clock(log: RawLog, name: str, duration: float) -> Clock:
    """The clock of a log that is as slow as it likes: a unit that the file says, else that in which it lasts about as
    long as the device's log (`duration`, s)."""
    if name in log.stamps:
        return Clock(name, None, None, log.stamps[name], "ISO 8601 stamps", True)
    values = log.numbers[name]
    since_1970 = [u for u, f in UNITS.items() if EPOCH[0] < f * float(values[0]) < EPOCH[1]]
    words = said(TIME_UNITS, log.hint(name))
    last = float(values[-1] - values[0])
    off = {u: abs(math.log(f * last / max(duration, 1e-9))) for u, f in UNITS.items()}
    nearest = min(off, key=lambda u: off[u])
    unit = next(iter(since_1970), words) or nearest
    why = "times since 1970" if since_1970 else "as the file says"
    if not since_1970 and words is None:
        why = f"in {unit} it lasts {UNITS[unit] * last:.4g} s, most like the device's log"
    seconds = UNITS[unit] * (values - values[0])
    certain = bool(since_1970) or words is not None or off[nearest] < math.log(_ALIKE)
    return Clock(name, unit, None, seconds, why, certain)


def _delay(
    device: Float[np.ndarray, " time"], probe: Float[np.ndarray, " readings"]
) -> float | None:
    """How late the readings' stamps are if both logs began at once; `None` where they have times in common."""
    apart = probe[-1] < device[0] or device[-1] < probe[0]
    return float(probe[0] - device[0]) if apart else None
