"""The clock of a log: which unit its stamps are in, or at which rate its rows were taken."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from ..data.formats.mended_stamps import can_be_mended, full, mended, restarts
from ..physics.vectors import angle_between
from ..reduction.host_stamps import host_stamps, usual_rate
from .column_words import LONG_TIME_UNITS, plain, said, TIME_UNITS
from .raw_log import RawLog
from .split_stamps import EPOCH, split_stamps


UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
_LONG_UNITS = {"min": 60.0, "h": 3600.0, "d": 86400.0}  # where the file says them
_TENTH = "0.1 ms"  # of the 10 kHz clock of an Xsens MTi
ALL_UNITS = UNITS | _LONG_UNITS | {_TENTH: 1e-4}
_USUAL = (8.0, 2200.0)  # Hz, IMUs that people log
_POSSIBLE = (0.5, 20000.0)  # Hz
_SLOW = 20.0  # Hz: few IMUs are read as slowly, and those by a host, whose stamps are not equally far apart
_WARMING = 1.0  # °C/s over a whole log: no chamber is as quick
_STEPS = 0.2  # of the differences go back: what holds steps goes up and down
_LONGEST_STEP = 50.0  # times the usual one
_PAUSE = 20.0  # usual steps: neither a pause nor where stamps go back is part of a mean rate
_ANEW = 1.5  # usual steps to mean ones: the stamps' span is that of one of several runs
_SHORTEST = 1.0  # s
_FASTEST = np.deg2rad(4400.0)  # rad/s: MEMS gyros go to 4000 deg/s
_STEADY_ROWS, _TURNING_ROWS, _SEVERAL = 5, 3, 3  # of each direction, between the two; such turns
_LOOKED_AT = 200_000  # rows
UNKNOWN_RATE = 100.0  # Hz, where nothing tells it


class Clock(NamedTuple):
    """How rows become seconds."""

    name: str | None
    unit: str | None
    rate: float | None  # Hz, where rows are counted
    seconds: Float[np.ndarray, " rows"]
    why: str
    certain: bool
    mend: bool = False  # a few stamps that repeat or go back stand between their neighbours

    @property
    def known(self) -> bool:
        """Whether the file tells the time at all."""
        return self.name is not None or self.certain


def clock_of(
    log: RawLog,
    name: str | None,
    rows: int,
    temperature: str | None = None,
    accel: Float[np.ndarray, "rows 3"] | None = None,
) -> Clock:
    """The clock of a log, by the column of times `name` where there is one; a `temperature` and `accel` (outputs) tell
    its unit by how fast they move."""
    rate = log.stated_rate
    if name is not None and name in log.stamps:
        return _checked(name, None, log.stamps[name], "stamps as text")
    split = split_stamps(log)
    if split is not None and name in (None, *split.columns):
        rate = (rows - 1) / float(split.seconds[-1] - split.seconds[0])
        text = f"seconds and nanoseconds stand in two columns ({split.columns[0]}, {split.columns[1]}): their mean rate"
        return _counted(usual_rate(rate), rows, text, True)
    if name is not None:
        values = log.numbers[name]
        tenths = _tenths_of_ms(name, values)
        if tenths is not None:
            return _counted(tenths, rows, f"{name} of an MTi counts tenths of a millisecond", True)
        if _in_tenths_of_ms(name, values):
            why = f"{name} of an MTi counts tenths of a millisecond"
            return _checked(name, _TENTH, ALL_UNITS[_TENTH] * (values - values[0]), why)
        steps = _steps(log, name, values)
        if steps is not None and rate is None:
            return steps
        unit, why, certain = _unit(log, name, values, rate, temperature, accel)
        if unit is not None:
            found = _checked(name, unit, ALL_UNITS[unit] * (values - values[0]), why)
            return found if certain else found._replace(certain=False)
    if log.notes.rate is not None:
        states = "states the rate" if log.notes.sure else "may be the samples' rate"
        text = f"{log.notes.rate_name} in the file {states}"
        return _counted(log.notes.rate, rows, text, log.notes.sure)
    if rate is not None:
        return _counted(rate, rows, "a line above the header states the rate", True)
    return _counted(UNKNOWN_RATE, rows, "nothing in the file tells the rate", False)


def _tenths_of_ms(name: str, values: Float[np.ndarray, " rows"]) -> float | None:
    """The rate, Hz, of stamps by the 10 kHz clock of an Xsens MTi, where no row is missing; its DOTs count µs."""
    steps = np.diff(values)
    if "sampletimefine" not in plain(name) or len(steps) == 0 or not np.all(steps == steps[0]):
        return None
    rate = 1e4 / float(steps[0]) if steps[0] > 0 else 0.0
    return rate if _USUAL[0] < rate < _USUAL[1] else None


def _in_tenths_of_ms(name: str, values: Float[np.ndarray, " rows"]) -> bool:
    """Whether stamps by the clock of an MTi lack rows; as those of a DOT, in µs, they would be no IMU's."""
    usual = float(np.nanmedian(np.diff(values))) if len(values) > 1 else 0.0
    if "sampletimefine" not in plain(name) or not usual > 0.0:
        return False
    return _USUAL[0] < 1e4 / usual < _USUAL[1] < 1e6 / usual


def _may_be_tenths(values: Float[np.ndarray, " rows"], step: float) -> bool:
    """Whether stamps that make a slow rate in ms are a device's own, whole steps apart, which may count tenths."""
    apart = np.diff(values) / step
    return bool(1e3 / step <= _SLOW and np.all(apart == np.round(apart)) and step == round(step))


def _steps(log: RawLog, name: str, values: Float[np.ndarray, " rows"]) -> Clock | None:
    """The mean rate where a column holds the time from row to row, of which none is zero."""
    told = values[np.isfinite(values)]
    if len(told) < 3 or not told.min() > 0.0 or np.mean(np.diff(told) < 0.0) < _STEPS:
        return None
    usual = float(np.median(told))
    if told.max() > _LONGEST_STEP * usual:
        return None
    rates = {u: 1.0 / (f * float(told.mean())) for u, f in UNITS.items()}
    fits = [u for u, r in rates.items() if _USUAL[0] <= r <= _USUAL[1]]
    unit = said(TIME_UNITS, log.hint(name))
    unit = unit if unit in fits else next(iter(fits), None)
    if unit is None:
        return None
    text = f"{name} goes up and down about {usual:.4g}, so it holds steps in {unit}, whose mean counts rows"
    return _counted(usual_rate(rates[unit]), len(values), text, True)


def _counted(rate: float, rows: int, why: str, certain: bool) -> Clock:
    return Clock(None, None, rate, np.arange(rows) / rate, why, certain)


def counted(rate: float, rows: int, why: str) -> Clock:
    """A clock that counts rows."""
    return _counted(rate, rows, why, True)


def _unit(
    log: RawLog,
    name: str,
    values: Float[np.ndarray, " rows"],
    rate: float | None,
    temperature: str | None,
    accel: Float[np.ndarray, "rows 3"] | None,
) -> tuple[str | None, str, bool]:
    """The stamps' unit (`None`: they are no times), why, and whether that is certain."""
    told = values[np.isfinite(values)]  # a logger may write words of another kind below its rows
    if not len(told):
        return None, "", False
    step = float(np.median(np.diff(told))) if len(told) > 1 else 1.0
    mean = float((told[-1] - told[0]) / max(len(told) - 1, 1))
    if np.any(np.diff(told) < 0) and _ANEW * mean < step:
        mean = step  # from its first stamp to its last a log that begins anew may go back
    if not (step > 0 or mean > 0) or not np.isfinite(mean):
        return None, "", False
    long = said(LONG_TIME_UNITS, log.hint(name))
    if long is not None and 1.0 / _POSSIBLE[1] <= _LONG_UNITS[long] * mean <= 1.0 / _POSSIBLE[0]:
        return long, "as the file says", True
    steps = {u: mean * f for u, f in UNITS.items()}
    if rate is not None:
        agree = [u for u, s in steps.items() if 0.9 < rate * s < 1.1]
        if agree:
            return agree[0], "as the stated rate says", True
        if step == 1.0:  # rows are counted
            return None, "", False
    possible = [u for u, s in steps.items() if _POSSIBLE[0] <= 1.0 / s <= _POSSIBLE[1]]
    if temperature is not None and np.isfinite(log.numbers[temperature]).any():
        swing = float(np.nanmax(log.numbers[temperature]) - np.nanmin(log.numbers[temperature]))
        slow = [u for u in possible if swing < 5.0 or swing / (steps[u] * len(values)) < _WARMING]
        if len(slow) < len(possible) and slow:
            if said(TIME_UNITS, log.hint(name)) == slow[-1]:
                return slow[-1], "as the file says", True
            why = "with a smaller unit the temperature would move faster than any chamber moves it"
            return slow[-1], why, False
    since_1970 = [u for u in possible if EPOCH[0] < UNITS[u] * float(np.nanmin(values)) < EPOCH[1]]
    if since_1970:
        return since_1970[0], "times since 1970", True
    said_unit = said(TIME_UNITS, log.hint(name))
    if said_unit in possible:
        return said_unit, "as the file says", True
    usual = [u for u in possible if _USUAL[0] <= 1.0 / steps[u] <= _USUAL[1]]
    if len(possible) > 1 and usual and _too_short(values, usual[0]):
        why = f"in {usual[0]} the log would last {steps[usual[0]] * len(values):.2g} s, with stamps finer than a µs"
        return possible[0], why, False
    chosen = next(iter(usual or possible), None)
    if chosen not in (None, possible[0]) and accel is not None and _too_fast(accel, steps[chosen]):
        why = f"in {chosen} the device would turn faster than any gyro reads, if this does not count rows"
        return possible[0], why, False
    if chosen is not None and np.all(np.diff(values) == 1.0):
        return chosen, f"it goes up by one: {chosen}, if it does not count rows", False
    why = f"usual step is {step:.4g}" if _ANEW * step > mean else f"mean step is {mean:.4g}"
    why = f"the {why}, so an IMU's rate needs this unit"
    if chosen == "ms" and _may_be_tenths(told, step):
        why += f', if it counts no tenths of ms (Xsens MTi: unit = "{_TENTH}", {1e4 / step:.4g} Hz)'
        return chosen, why, False
    return chosen, why, len(usual) == 1


def _too_fast(accel: Float[np.ndarray, "rows 3"], step: float) -> bool:
    """Whether rows `step` (s) apart turn from one steady direction to another faster than any device, several times."""
    if len(accel) < _STEADY_ROWS:
        return False
    rows = np.lib.stride_tricks.sliding_window_view(accel[:_LOOKED_AT], _STEADY_ROWS, axis=0)
    apart = _STEADY_ROWS + _TURNING_ROWS
    mean, spread = rows.mean(axis=2), rows.std(axis=2).max(axis=1)
    before, after = mean[:-apart], mean[apart:]
    steady = np.maximum(spread[:-apart], spread[apart:]) < 0.1 * np.linalg.norm(
        after - before, axis=1
    )
    fast = np.flatnonzero(steady & (angle_between(before, after) > _FASTEST * apart * step))
    return len(fast) > 0 and int((np.diff(fast) > apart).sum()) + 1 >= _SEVERAL


def _too_short(values: Float[np.ndarray, " rows"], unit: str) -> bool:
    """Whether nobody records for so short a time, by a clock so fine; whole numbers are ticks of a clock."""
    told = values[np.isfinite(values)] * UNITS[unit]
    fine = np.abs(told * 1e6 - np.round(told * 1e6)) > 1e-3
    return bool(np.ptp(told) < _SHORTEST and fine.mean() > 0.5)


def _checked(name: str, unit: str | None, seconds: Float[np.ndarray, " rows"], why: str) -> Clock:
    """The stamps, or a rate in their place where they were not made with the samples."""
    steps = np.diff(seconds)
    bad = int((~(steps > 0)).sum())
    if bad and can_be_mended(seconds):
        found = _checked(name, unit, mended(seconds), why)
        if found.name is None:
            return found
        anew, counted_out = restarts(seconds), full(seconds)
        few, text = bad - len(anew), found.why
        anew = np.setdiff1d(anew, counted_out)
        if few:
            text += f"; {few} stamps that repeat or go back are put between their neighbours"
        if len(counted_out):
            text += f"; its counter is full at row {_listed(counted_out)} and goes on from 0"
        if len(anew):
            text += f"; it begins anew at row {_listed(anew)}: what follows is "
            text += "put behind what was before"
        return found._replace(why=text, mend=True, certain=not len(anew))
    rate = (
        len(steps) / float(np.nanmax(seconds) - np.nanmin(seconds)) if len(steps) else UNKNOWN_RATE
    )
    if bad:
        text = f"{bad} stamps of {name} repeat or go back, so rows are counted at their mean rate"
        usual = float(np.nanmedian(steps))
        ticks = np.flatnonzero(steps > 0.0) + 1  # rows in which a coarse clock goes on
        if not (steps < 0.0).any() and len(ticks) > 1:
            rate = float(ticks[-1] - ticks[0]) / float(seconds[ticks[-1]] - seconds[ticks[0]])
        forward = steps[(steps >= 0.0) & (steps < _PAUSE * usual)] if usual > 0.0 else steps[:0]
        if (steps < 0.0).any() and len(forward) and usual * rate < _ANEW:
            rate = len(forward) / float(forward.sum())
        if usual * rate > _ANEW:
            rate = 1.0 / usual
            text = f"{name} begins anew {int((steps < 0).sum())} times, so rows are counted at its usual step"
        return _counted(usual_rate(rate), len(seconds), text, True)
    bunched = host_stamps(seconds)
    if bunched is not None and bunched.rate is not None:
        text = f"{name} was stamped in bursts ({bunched.pauses} pauses), so rows are counted at their mean rate"
        return _counted(bunched.rate, len(seconds), text, True)
    usual = float(np.nanmedian(steps)) if len(steps) else 0.0
    often = 1.0 / usual if 0.0 < _ANEW * usual < 1.0 / rate else None
    shown = f"{rate:.4g} Hz" if often is None else f"{often:.4g} Hz between pauses"
    return Clock(name, unit, None, seconds, f"{why}: {shown}", True)


def _listed(rows: Int[np.ndarray, " some"]) -> str:
    return ", ".join(map(str, rows[:4])) + " …" * (len(rows) > 4)
