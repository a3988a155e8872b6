"""Times written as text, to seconds: ISO 8601, and as stations and spreadsheets write days and hours.

`2026-01-31T12:00:00.25Z`, with a blank for the T, with an offset for the Z, a colon before the milliseconds, all with
underscores as in names of files (2026_01_31_12_00_00.25) or with dashes (2026-1-31--12-00-00-250, whose last number
are milliseconds without zeros before them); `1/31/2026 9:05:00 PM`, `31.01.2026 21:05`, `31-Jan-2026
21:05:00`; the time of day alone, which may pass midnight once or more; and minutes and seconds, `05:00.3`, to which a
spreadsheet cuts a time with a fraction.
"""

import re

import numpy as np
import polars as pl
from jaxtyping import Float

from ...storage.harmless_text import short


_MONTHS = "jan feb mar apr may jun jul aug sep oct nov dec".split()
_NAMED = rf"(?:{'|'.join(_MONTHS)})[a-z]{{0,6}}\.?"
_DATE = (
    r"(?P<first>\d{1,4})(?P<between>[-/_.])(?P<second>\d{1,2})[-/_.](?P<third>\d{4}|\d{1,2})"
    rf"|(?P<day>\d{{1,2}})[- ](?P<month>{_NAMED})[- ](?P<year>\d{{4}}|\d{{2}})"
    rf"|(?P<us_month>{_NAMED}) (?P<us_day>\d{{1,2}}),? (?P<us_year>\d{{4}})"
)
_WHOLE_DATE = re.sub(r"\(\?P<\w+>", "(?:", _DATE)  # a date's parts are read once a date
_HALF = r"a\.?m\.?|p\.?m\.?|上午|下午|午前|午後|오전|오후"
_PARTS = (
    rf"(?i)^\s*(?:(?P<date>{_WHOLE_DATE})(?:,?\s|T|_))?\s*(?:(?P<half_before>{_HALF})\s*)?"
    r"(?P<hour>\d{1,2})[:_](?P<minute>\d{2})(?:[:_](?P<seconds>\d{2}(?:[.,:]\d+)?))?"
    rf"\s?(?:(?P<half>{_HALF})|Z|UTC|(?P<sign>[+-])(?P<east>\d{{2}}):?(?P<further>\d{{2}}))?\s*$"
)
_CUT = r"^\s*(?P<minute>\d{1,2}):(?P<seconds>\d{2}[.,]\d+)\s*$"
_DASHES = (
    rf"(?i)^\s*(?P<date>{_WHOLE_DATE})(?:--?|[ _T])(?P<hour>\d{{1,2}})-(?P<minute>\d{{1,2}})-(?P<seconds>\d{{1,2}})"
    r"(?:-(?P<parts>\d{1,9}))?\s*$"
)
_STAMP, _CUT_STAMP, _DASHED = re.compile(_PARTS), re.compile(_CUT), re.compile(_DASHES)
_AFTERNOON = ("p", "下", "午後", "오후")
_YEAR_FIRST, _DAY_FIRST, _MONTH_FIRST = (
    (0, 1, 2),
    (2, 1, 0),
    (2, 0, 1),
)  # places of year, month, day
_DAY, _HOUR = 86400.0, 3600.0  # s
_YEARS = (1900.0, 2200.0)  # a clock that was never set begins in 1970 or 1980
_LAST_CENTURY = 90.0  # years of two digits from here on


def is_stamp(text: str) -> bool:
    """Whether a field is a time as `seconds_of` reads them."""
    return _has_clock(text) or any(p.fullmatch(text) for p in (_CUT_STAMP, _DASHED))


def _has_clock(text: str) -> bool:
    """Whether it is an hour and what follows; `3_10` is a label."""
    found = _STAMP.fullmatch(text)
    return found is not None and (found["seconds"] is not None or "_" not in text)


def seconds_of(text: pl.Series, where: str) -> Float[np.ndarray, " rows"] | None:
    """Seconds since 1970 in UTC (without a date: since the first midnight); `None` where the text is no stamps.

    Stamps without an offset are taken to be in UTC. Doubles near 1.8e9 s are 2.4e-7 s apart. Where numbers do not tell
    day from month (3/4/2026 throughout), the days of a log that passes midnight are those that follow one another, and
    the date itself is left open: the seconds are since the first midnight.

    Raises `ValueError` where the first row is a stamp and a later one is not.
    """
    if not len(text) or text[0] is None:
        return None
    if _CUT_STAMP.fullmatch(text[0]):
        return _of_minutes(text, where)
    if _DASHED.fullmatch(text[0]):
        return _of_dashes(text, where)
    if not _has_clock(text[0]):
        return None
    parts = text.str.extract_groups(_PARTS).struct.unnest()
    dated = parts.get_column("date").is_not_null()
    _refuse(text, parts.get_column("hour").is_null() | (dated != dated[0]), where)
    hour = _number(parts, "hour")
    half = parts.get_column("half").fill_null("") + parts.get_column("half_before").fill_null("")
    if (half != "").any():
        half = half.str.to_lowercase()
        late = np.logical_or.reduce([half.str.starts_with(x).to_numpy() for x in _AFTERNOON])
        hour = np.where((half == "").to_numpy(), hour, hour % 12.0 + 12.0 * late)
    clock = 3600.0 * hour + 60.0 * _number(parts, "minute") + _number(parts, "seconds")
    east = 3600.0 * _number(parts, "east") + 60.0 * _number(parts, "further")
    clock = clock - np.where((parts.get_column("sign") == "-").fill_null(False), -east, east)
    if not dated[0]:
        return _unrolled(clock, _DAY)
    return _dated(text, parts, clock, where)


def _dated(
    text: pl.Series, parts: pl.DataFrame, clock: Float[np.ndarray, " rows"], where: str
) -> Float[np.ndarray, " rows"]:
    days = _days(parts, clock)
    _refuse(text, pl.Series(np.isnan(days)), where)
    return _DAY * days + clock


def _of_minutes(text: pl.Series, where: str) -> Float[np.ndarray, " rows"]:
    """Minutes and seconds, which begin anew each hour."""
    parts = text.str.extract_groups(_CUT).struct.unnest()
    _refuse(text, parts.get_column("minute").is_null(), where)
    return _unrolled(60.0 * _number(parts, "minute") + _number(parts, "seconds"), _HOUR)


def _of_dashes(text: pl.Series, where: str) -> Float[np.ndarray, " rows"]:
    """A date and a time of dashes alone. Parts of a second are as fine as the longest says, for zeros before them may
    be left out: of -5, -38 and -830 all are milliseconds."""
    parts = text.str.extract_groups(_DASHES).struct.unnest()
    _refuse(text, parts.get_column("date").is_null(), where)
    finest = int(parts.get_column("parts").fill_null("").str.len_chars().to_numpy().max())
    below = _number(parts, "parts") / 10.0**finest
    clock = 3600.0 * _number(parts, "hour") + 60.0 * _number(parts, "minute")
    return _dated(text, parts, clock + _number(parts, "seconds") + below, where)


def _unrolled(clock: Float[np.ndarray, " rows"], turn: float) -> Float[np.ndarray, " rows"]:
    """A clock that begins anew after `turn` s; one that goes back by less has gone back."""
    return clock + turn * np.cumsum(np.diff(clock, prepend=clock[:1]) < -0.5 * turn)


def _number(parts: pl.DataFrame, name: str) -> Float[np.ndarray, " rows"]:
    text = parts.get_column(name).str.replace("[,:]", ".")
    return text.cast(pl.Float64).fill_null(0.0).to_numpy()


def _refuse(text: pl.Series, bad: pl.Series, where: str) -> None:
    if not bad.any():
        return
    row = int(bad.arg_true()[0])
    told = f"{where}: time holds '{short(text[row] or '')}' in row {row}"
    if row == 0:
        raise ValueError(f"{told}, which is no day of the calendar.")
    raise ValueError(f"{told}, where a stamp like '{short(text[0])}' of row 0 is needed.")


def _days(parts: pl.DataFrame, clock: Float[np.ndarray, " rows"]) -> Float[np.ndarray, " rows"]:
    """Days since 1970; since the first one where nothing tells day from month; NaN in rows without a date."""
    dates = parts.get_column("date").str.to_lowercase()
    each = dates.unique(maintain_order=True)
    place = pl.DataFrame({"date": dates}).join(
        pl.DataFrame({"date": each, "place": np.arange(len(each))}),
        on="date",
        how="left",
        maintain_order="left",
    )["place"]
    rows = place.to_numpy()
    found = each.str.extract_groups(rf"(?i)^(?:{_DATE})$").struct.unnest()
    readings = _readings(found)
    if len(readings) == 1:
        return readings[0][rows]
    spans = [float(np.ptp(_DAY * days[rows] + clock)) for days in readings]
    least = min(spans)
    told = [days for days, span in zip(readings, spans, strict=True) if span == least]
    if any(not np.array_equal(days, told[0]) for days in told[1:]):
        return (told[0] - told[0][0])[rows]
    return told[0][rows]


def _readings(found: pl.DataFrame) -> list[Float[np.ndarray, " date"]]:
    """Days since 1970 of each date, by each order in which all of them are dates."""
    if found.get_column("first").is_null().all():
        return [_days_of_names(found)]
    between = str(found.get_column("between").drop_nulls()[0])
    numbers = [_number(found, n) for n in ("first", "second", "third")]
    if (found.get_column("first").str.len_chars() > 2).any():  # of four digits are years alone
        order = (_YEAR_FIRST,)
    elif between == ".":
        order = (_DAY_FIRST,)
    else:
        whole_year = bool((found.get_column("third").str.len_chars() > 2).any())
        order = (_DAY_FIRST, _MONTH_FIRST) + (() if whole_year else (_YEAR_FIRST,))
    made = [_dates(*(numbers[k] for k in one)) for one in order]
    whole = [days for days in made if not np.isnan(days).any()]
    # Where no order holds for all rows, the first that holds for the first row tells which one is wrong.
    return whole or [next((d for d in made if not np.isnan(d[0])), made[0])]


def _days_of_names(found: pl.DataFrame) -> Float[np.ndarray, " date"]:
    """Days of dates in which the month has a name."""
    part = lambda name: found.get_column(name).fill_null(found.get_column(f"us_{name}"))
    month = part("month").str.slice(0, 3).replace_strict(_MONTHS, range(1, 13), default=None)
    year, day = (part(name).cast(pl.Float64).to_numpy() for name in ("year", "day"))
    return _dates(year, month.cast(pl.Float64).to_numpy(), day)


def _dates(
    year: Float[np.ndarray, " date"],
    month: Float[np.ndarray, " date"],
    day: Float[np.ndarray, " date"],
) -> Float[np.ndarray, " date"]:
    """Days since 1970 in the Gregorian calendar; NaN where there is no such day."""
    year = np.where(year < 100.0, year + np.where(year < _LAST_CENTURY, 2000.0, 1900.0), year)
    told = (year >= _YEARS[0]) & (year < _YEARS[1]) & (month >= 1.0) & (month <= 12.0) & (day >= 1)
    whole = lambda x, other: np.where(told, x, other).astype(np.int64)
    first = (whole(year, 1970) - 1970).astype("datetime64[Y]").astype("datetime64[M]")
    months = first + (whole(month, 1) - 1)
    days = months.astype("datetime64[D]") + (whole(day, 1) - 1)
    told &= days.astype("datetime64[M]") == months
    return np.where(told, days.astype(np.int64).astype(float), np.nan)
