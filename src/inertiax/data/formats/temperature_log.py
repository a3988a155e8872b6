"""The log of a temperature that was written apart from the device's: by a chamber, or by a probe's own logger."""

from collections.abc import Sequence
from pathlib import Path

import msgspec
import numpy as np

from .columns import ColumnMap, Layout
from .side_log import read_side_log
from .table import temperatures_of
from .temperature_at_stamps import note_on_lines, TemperatureLog


def read_temperature_log(path: Path, columns: ColumnMap, delay: float) -> TemperatureLog:
    """The readings of `[columns] temperature` in a side log, whose clock is `temperature_time`, else `time`.

    Rows that repeat a stamp, and rows without a number, are left out.

    **Arguments:** `delay` in s, by which the stamps are late on the device's clock.

    Raises `ValueError` where fewer than two readings are left, for a missing column, and as `read_side_log` does.
    """
    rows, time, later = read_side_log(
        path, columns, columns.temperature_time, "a temperature's log"
    )
    values = temperatures_of(rows, columns.temperature, path.name, gaps=True)
    if values is None:
        raise ValueError(
            f"{path.name}: no column 'temperature'; name it: [columns] temperature = {{ name = \"...\" }}."
        )
    told = later & np.isfinite(values).all(axis=1)
    if told.sum() < 2:
        raise ValueError(
            f"{path.name}: {told.sum()} readings of the temperature; 2 or more are needed."
        )
    return TemperatureLog(path.name, time[told] - delay, values[told])


def beside_each(
    layouts: list[Layout],
    paths: Sequence[Path],
    delay: float | Sequence[float],
    columns: ColumnMap,
) -> tuple[list[Layout], tuple[str, ...]]:
    """The layout of each file of the device with the log of its temperature, and what a reader should know of it.

    **Arguments:** `paths` and `delay` (s) are one for all files, or one for each.

    Raises `ValueError` for another number of them, and as `read_temperature_log` does.
    """
    delays = (delay,) if isinstance(delay, float | int) else tuple(delay)
    for key, given in (("temperature_files", paths), ("temperature_delay", delays)):
        if len(given) not in (1, len(layouts)):
            raise ValueError(
                f"[recordings] {key} names {len(given)} for {len(layouts)} files; give one for all, or one for each, "
                "in their order."
            )
    count = max(len(paths), len(delays))
    each = [list(x) * (count // len(x)) for x in (paths, delays)]
    logs = [read_temperature_log(p, columns, d) for p, d in zip(*each, strict=True)]
    notes = (note_on_lines(log.name, log.step) for log in logs)
    pairs = zip(layouts, logs * (len(layouts) // count), strict=True)
    made = [msgspec.structs.replace(one, temperature_log=log) for one, log in pairs]
    return made, tuple(dict.fromkeys(notes))
