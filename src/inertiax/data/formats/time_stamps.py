"""Times written as ISO 8601 text, to seconds.

`2026-01-31T12:00:00.25Z`, with a blank for the T, with an offset for the Z, the date as 31.01.2026 or 2026/01/31, a
colon before the milliseconds, all with underscores as in names of files (2026_01_31_12_00_00.25), and the time of day
alone, which may pass midnight once or more.
"""

import re

import numpy as np
import polars as pl
from jaxtyping import Float

from ...storage.harmless_text import short


_PARTS = (
    r"^\s*(?:(?P<date>\d{4}[-/_]\d{2}[-/_]\d{2}|\d{2}\.\d{2}\.\d{4})[T _])?"
    r"(?P<hour>\d{2})[:_](?P<minute>\d{2})[:_](?P<second>\d{2}(?:[.,:]\d+)?)"
    r"\s?(?:Z|(?P<sign>[+-])(?P<east>\d{2}):?(?P<further>\d{2}))?\s*$"
)
STAMP = re.compile(_PARTS)
_DAY_FIRST = r"^(\d{2})\.(\d{2})\.(\d{4})$"
_DAY = 86400.0  # s
_BACK = 0.5 * _DAY  # a time of day that falls by more than this has passed midnight


def seconds_of(text: pl.Series, where: str) -> Float[np.ndarray, " rows"] | None:
    """Seconds since 1970 in UTC (without a date: since the first midnight); `None` where the text is no stamps.

    Stamps without an offset are taken to be in UTC. Doubles near 1.8e9 s are 2.4e-7 s apart.

    Raises `ValueError` where the first row is a stamp and a later one is not.
    """
    parts = text.str.extract_groups(_PARTS).struct.unnest()
    told = parts.get_column("hour").is_not_null()
    if not len(told) or not told[0]:
        return None
    number = lambda name: parts.get_column(name).str.replace("[,:]", ".").cast(pl.Float64)
    clock = 3600.0 * number("hour") + 60.0 * number("minute") + number("second")
    date = parts.get_column("date").str.replace_all("[/_]", "-").str.replace(_DAY_FIRST, "$3-$2-$1")
    days = date.str.to_date("%Y-%m-%d", strict=False)
    dated = parts.get_column("date").is_not_null()
    bad = ~told | (dated != dated[0]) | (dated & days.is_null())
    if bad.any():
        row = int(bad.arg_true()[0])
        like = "YYYY-MM-DDThh:mm:ss.s" if dated[0] else "hh:mm:ss.s"
        raise ValueError(
            f"{where}: time holds '{short(text[row] or '')}' in row {row}, where stamps like {like} are needed, as "
            "in row 0."
        )
    seconds = clock.to_numpy()
    east = 3600.0 * number("east").fill_null(0.0) + 60.0 * number("further").fill_null(0.0)
    seconds = seconds - np.where((parts.get_column("sign") == "-").fill_null(False), -east, east)
    if dated[0]:
        return _DAY * days.to_physical().cast(pl.Float64).to_numpy() + seconds
    return seconds + _DAY * np.cumsum(np.diff(seconds, prepend=seconds[:1]) < -_BACK)
