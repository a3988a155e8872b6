"""The temperature's unit, by its range."""

import re
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from .column_words import plain
from .converters import TEMPERATURE_SCALES
from .raw_log import RawLog
from .scale_notes import temperature_note


_CELSIUS = (-60.0, 130.0)  # what electronics bears
_KELVIN = (210.0, 405.0)
_NEARLY_ALL = (0.005, 0.995)  # of the rows; a few may be a sensor's that was not ready
_ROOM = (10.0, 55.0)  # °C, a board at work in a room
_TENTHS = re.compile(
    r"^(?:imu|baro|esc)temperature$"
)  # columns of INAV's blackbox: int16 in 0.1 °C
_PARTS = (  # of a degree, as loggers of whole numbers name them: cdegC, "0.01 degC", temp_x100
    (
        1000.0,
        "thousandths",
        r"\bm(?:illi)?_?(?:deg|°)|_mdeg|milli|(?<![\d.,])(?:0[.,]001|1/1000)(?!\d)|x ?1000(?!\d)",
    ),
    (
        100.0,
        "hundredths",
        r"\bc(?:enti)?_?(?:deg|°)|_cdeg|centi(?!grad)|(?<![\d.,])(?:0[.,]01|1/100)(?!\d)|x ?100(?!\d)",
    ),
    (
        10.0,
        "tenths",
        r"\bd(?:eci)?_?(?:deg|°)|_ddeg|deci|(?<![\d.,])(?:0[.,]1|1/10)(?!\d)|x ?10(?!\d)",
    ),
)
_SAME = 0.01  # of a scale as a line rounds it
_FAHRENHEIT = re.compile(r"degf|°f|fahr|\bf\b")
_MAYBE_FAHRENHEIT = re.compile(r"_f\b")  # or "filtered"; the values tell


class TemperatureUnit(NamedTuple):
    """How a probe's values become °C; `unit` is `None` where that cannot be told."""

    unit: str | None
    scale: float | None
    offset: float | None
    why: str
    certain: bool

    def of_column(self, name: str) -> dict[str, object]:
        """The value of `[columns] temperature` for a column that has this unit."""
        value: dict[str, object] = {"name": name, "unit": self.unit}
        if self.scale is not None:
            value |= {"scale": self.scale, "scale_unit": "count per degC", "offset": self.offset}
        return value


def temperature_unit(log: RawLog, name: str, *, of_chip: bool = False) -> TemperatureUnit:
    """Unit of a temperature column.

    **Arguments:** `of_chip` says that the accelerometers beside it are counts by a data sheet as well; counts alone may
    be any converter's.
    """
    values: Float[np.ndarray, " rows"] = log.numbers[name]
    told = np.isfinite(values)
    if not told.all():
        if told.sum() < 2:
            return TemperatureUnit(None, None, None, f"{name} holds no two numbers", False)
        unit = temperature_unit(log._replace(numbers={name: values[told]}), name, of_chip=of_chip)
        text = f"{unit.why}; {told.sum()} of {len(told)} rows hold it, with straight lines between"
        return unit._replace(why=text)
    low, high = float(values.min()), float(values.max())
    span = f"{low:.4g} to {high:.4g}"
    counts = bool(np.all(values == np.round(values)))
    note = temperature_note(log.preamble) if counts else None
    if note is not None and note.zero is not None:
        ends = [v / note.scale + note.zero for v in (low, high)]
        # Values that are temperatures as they stand: the line may be the sensor's, not the log's.
        raw = not (_CELSIUS[0] <= low and high <= _CELSIUS[1])
        if raw and _CELSIUS[0] <= ends[0] and ends[1] <= _CELSIUS[1]:
            text = (
                f"counts {span}, by the scale above the names {ends[0]:.4g} to {ends[1]:.4g} degC"
            )
            return TemperatureUnit(
                "count", note.scale, round(-note.zero * note.scale, 6), text, True
            )
    if _FAHRENHEIT.search(log.hint(name)):
        return TemperatureUnit("degF", None, None, f"as the file says; {span}", True)
    in_celsius = tuple((v - 32.0) / 1.8 for v in (low, high))
    warm = float(np.median(values)) > _ROOM[1]
    if (
        warm
        and _MAYBE_FAHRENHEIT.search(log.hint(name))
        and _ROOM[0] <= in_celsius[0]
        and in_celsius[1] <= _ROOM[1]
    ):
        return TemperatureUnit("degF", None, None, f"as the file says; {span}", True)
    tenths = (
        bool(_TENTHS.match(plain(name)))
        and np.all(values == np.round(values))
        and high > _CELSIUS[1]
    )
    if tenths and 10.0 * _CELSIUS[0] <= low and high <= 10.0 * _CELSIUS[1]:
        return TemperatureUnit(
            "count", 10.0, 0.0, f"{span}: tenths of a degree, as INAV logs it", True
        )
    part = _part_said(log.hint(name)) if np.all(values == np.round(values)) else None
    if part is not None and part[0] * _CELSIUS[0] <= low and high <= part[0] * _CELSIUS[1]:
        text = f"{span}: {part[1]} of a degree, as the file says"
        return TemperatureUnit("count", part[0], 0.0, text, True)
    if _CELSIUS[0] <= low and high <= _CELSIUS[1]:
        doubt = (
            f"; if degF ({in_celsius[0]:.3g} to {in_celsius[1]:.3g} degC), write so" if warm else ""
        )
        return TemperatureUnit("degC", None, None, f"{span}{doubt}", not warm)
    if _KELVIN[0] <= low and high <= _KELVIN[1]:
        return TemperatureUnit("K", None, None, span, True)
    middle = float(np.median(values))
    ends = np.quantile(values, _NEARLY_ALL)
    fits = [
        (scale, zero, sensor)
        for scale, zero, sensor in TEMPERATURE_SCALES
        if _ROOM[0] <= middle / scale + zero <= _ROOM[1]
        and _CELSIUS[0] <= ends[0] / scale + zero <= ends[1] / scale + zero <= _CELSIUS[1]
    ]
    scale = None if note is None else note.scale
    known = scale is None or any(abs(scale / s[0] - 1.0) < _SAME for s in TEMPERATURE_SCALES)
    if scale is not None and not known:
        ends = [v / scale for v in (low, high)]
        if _CELSIUS[0] <= ends[0] and ends[1] <= _CELSIUS[1]:
            decimal = any(abs(scale / n - 1.0) < _SAME for n, _, _ in _PARTS)
            text = (
                f"counts {span}, by the scale above the names {ends[0]:.4g} to {ends[1]:.4g} degC"
            )
            if not decimal:
                text += " if a count of zero is 0 degC, which it does not say"
            return TemperatureUnit("count", scale, 0.0, text, decimal)
    if counts and fits:
        named = [s for s in fits if _names(log, s[2])]
        scale, zero, sensor = (named or fits)[0]
        text = f"counts {span}; by the data sheet of {sensor} {middle / scale + zero:.1f} degC at the median"
        return TemperatureUnit(
            "count",
            scale,
            round(-zero * scale, 1),
            text,
            len(named or (fits if of_chip else ())) == 1,
        )
    return TemperatureUnit(
        None, None, None, f"{name} reads {span}, which is no temperature in degC, K or degF", False
    )


def _part_said(hint: str) -> tuple[float, str] | None:
    """How many parts make a degree by a column's words, and what they are called."""
    return next(((n, said) for n, said, words in _PARTS if re.search(words, hint)), None)


def _names(log: RawLog, sensors: str) -> bool:
    """Whether the lines above the header name one of some sensors: "MPU6050" is "MPU-6050"."""
    bare = lambda text: re.sub(r"[^a-z0-9]", "", text.lower())
    above = bare(" ".join(log.preamble))
    return any(bare(s).rstrip("x") in above for s in sensors.split(","))
