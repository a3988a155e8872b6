"""TOML lines for `[columns]` that mend a unit, exchanged axes or a clock, given what the campaign says now."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from ..data.formats.columns import (
    ACCEL_UNITS,
    ColumnMap,
    GYRO_UNITS,
    TIME_UNITS,
    TimeColumn,
    TriadColumns,
)
from .turns import order_and_signs


_NEAR = 0.2  # relative; a unit's factor that is within this of what is asked for
# Usual ranges of 16-bit converters, counts per unit; mdps.
_COUNTS_PER_G = (16384, 8192, 4096, 2048, 1024, 256)
COUNTS_PER_DPS = (1000, 131, 65.5, 32.8, 16.4, 114.2857, 57.142857, 28.571429, 14.285714, 14.375)
ANOTHER_SCALE = "another scale"
_PLAIN = ("s", "ms", "us", "ns")


def known_unit(kind: str, si_factor: float) -> str | None:
    """The unit whose SI value is nearest `si_factor`, where one is near."""
    units = ACCEL_UNITS if kind.endswith("accel") else GYRO_UNITS
    return next((u for u, si in units.items() if _near(si, si_factor)), None)


def usual_counts(kind: str, si_factor: float) -> tuple[float, str] | None:
    """Counts per g (deg/s) of a data sheet that make `si_factor` m/s² (rad/s) per count."""
    accel = kind.endswith("accel")
    base = 9.80665 if accel else np.pi / 180
    for counts in _COUNTS_PER_G if accel else COUNTS_PER_DPS:
        if abs(base / counts / si_factor - 1.0) < 0.1:
            return float(counts), "count per g" if accel else "count per deg/s"
    return None


def is_usual(columns: ColumnMap, factor: float) -> bool:
    """Whether the gyros' counts, times `factor`, have the scale of a usual converter."""
    said = columns.gyro or TriadColumns()
    if not (said.scale_unit or "").startswith("count per deg/s"):
        return True  # not known to be unusual
    scales = np.ravel(np.asarray(said.scale, float)) / factor
    return any(abs(scales[0] / usual - 1.0) < 0.1 for usual in COUNTS_PER_DPS)


def rate(columns: ColumnMap) -> float | None:
    """Hz at which the campaign counts rows; `None` where it reads stamps."""
    return columns.time.rate if isinstance(columns.time, TimeColumn) else None


def rescaled(kind: str, columns: ColumnMap, factor: float) -> tuple[str | None, str | None]:
    """Remedy and unit in words for a triad whose values have to be multiplied by `factor`; `None` for unknown."""
    said: TriadColumns = getattr(columns, kind) or TriadColumns()
    if said.unit == "count":
        return _rescaled_counts(kind, said, factor), ANOTHER_SCALE
    units = ACCEL_UNITS if kind.endswith("accel") else GYRO_UNITS
    now = units.get(said.unit or next(iter(units)), 1.0)
    unit = known_unit(kind, now * factor)
    if (
        unit is not None and units[unit] == now
    ):  # near enough to what it is: the unit is not the cause
        return None, None
    if unit is not None:
        return _line(kind, said, f'unit = "{unit}"'), f'unit "{unit}"'
    counts = usual_counts(kind, now * factor)
    if counts is not None:
        keys = f'unit = "count", scale = {counts[0]:g}, scale_unit = "{counts[1]}"'
        return _line(kind, said, keys), f"raw counts, {counts[0]:g} {counts[1]}"
    return None, None


def axes_rescaled(kind: str, columns: ColumnMap, axes: Sequence[int], factor: float) -> str:
    """Remedy that multiplies the values of some axes of a triad by `factor` and leaves the others."""
    said: TriadColumns = getattr(columns, kind) or TriadColumns()
    by = np.ones(3)
    by[list(axes)] = factor
    if said.unit == "count":
        inverse = (said.scale_unit or "").startswith("count per")
        scale = np.broadcast_to(np.asarray(said.scale, float), (3,)) * (1.0 / by if inverse else by)
        return _line(kind, said, _count_keys(said, scale, np.arange(3)))
    unit = said.unit or next(iter(ACCEL_UNITS if kind == "accel" else GYRO_UNITS))
    keys = f'unit = "count", scale = {_list(by)}, scale_unit = "{unit} per count"'
    return _line(kind, said, keys)


def with_unit(kind: str, said: TriadColumns, unit: str) -> str:
    """Remedy that reads a triad's values in another unit."""
    return _line(kind, said, f'unit = "{unit}"')


def _rescaled_counts(kind: str, said: TriadColumns, factor: float) -> str:
    inverse = (said.scale_unit or "").startswith("count per")
    scale = np.broadcast_to(np.asarray(said.scale, float), (3,)) * (
        1 / factor if inverse else factor
    )
    return _line(kind, said, _count_keys(said, scale, np.arange(3)))


def exchanged(kind: str, columns: ColumnMap, p: Float[np.ndarray, "3 3"]) -> str:
    """Remedy that reads a triad's axes as the signed permutation `p` of what they are now."""
    said: TriadColumns = getattr(columns, kind) or TriadColumns()
    order, signs = order_and_signs(p)
    names = said.names or tuple(f"{kind}_{axis}" for axis in "xyz")
    moved = TriadColumns(names=(names[order[0]], names[order[1]], names[order[2]]))
    if said.unit == "count":
        scale = np.broadcast_to(np.asarray(said.scale, float), (3,))[order] * signs
        return _line(kind, moved, _count_keys(said, scale, order))
    if np.all(signs > 0):
        return _line(kind, moved, "" if said.unit is None else f'unit = "{said.unit}"')
    units = ACCEL_UNITS if kind.endswith("accel") else GYRO_UNITS
    unit = said.unit or next(iter(units))
    keys = f'unit = "count", scale = {_list(signs)}, scale_unit = "{unit} per count"'
    return _line(kind, moved, keys)


def _count_keys(said: TriadColumns, scale: Float[np.ndarray, "3"], order: np.ndarray) -> str:
    same = np.all(scale == scale[0])
    keys = f'unit = "count", scale = {float(scale[0]):.10g}' if same else ""
    keys = keys or f'unit = "count", scale = {_list(scale)}'
    keys += f', scale_unit = "{said.scale_unit}"' if said.scale_unit else ""
    if said.offset is not None:
        keys += f", offset = {_list(np.broadcast_to(np.asarray(said.offset, float), (3,))[order])}"
    return keys


def _list(values: np.ndarray) -> str:
    return "[" + ", ".join(f"{float(v):.10g}" for v in values) + "]"


def _line(kind: str, said: TriadColumns, keys: str) -> str:
    names = "" if said.names is None else "names = [" + ", ".join(map(_text, said.names)) + "]"
    inside = ", ".join(k for k in (names, keys) if k)
    return f"[columns]\n{kind} = {{ {inside} }}"


def time_unit(columns: ColumnMap, factor: float) -> str | None:
    """Remedy for stamps that have to be multiplied by `factor`; `None` where no unit does it."""
    said = TimeColumn(name=columns.time) if isinstance(columns.time, str) else columns.time
    said = said or TimeColumn()
    if said.rate is not None:
        return f"[columns]\ntime = {{ rate = {said.rate / factor:.6g} }}"
    now = TIME_UNITS.get(said.unit, 1.0)
    unit = next((u for u in _PLAIN if _near(TIME_UNITS[u], now * factor)), None)
    name = "" if said.name is None else f"name = {_text(said.name)}, "
    return None if unit is None else f'[columns]\ntime = {{ {name}unit = "{unit}" }}'


def rows_at(rate: float) -> str:
    """Remedy that counts rows at `rate` (Hz) in place of the stamps."""
    return f"[columns]\ntime = {{ rate = {rate:.6g} }}"


def temperature(columns: ColumnMap, keys: str) -> str:
    """Remedy with other `keys` for the temperature's column."""
    said = columns.temperature
    if isinstance(said, str):
        names = f"name = {_text(said)}"
    elif said is not None and said.names is not None:
        names = "names = [" + ", ".join(map(_text, said.names)) + "]"
    elif said is not None and said.name is not None:
        names = f"name = {_text(said.name)}"
    else:
        names = ""
    inside = ", ".join(k for k in (names, keys) if k)
    return f"[columns]\ntemperature = {{ {inside} }}"


def _text(name: str) -> str:
    """A TOML string."""
    escaped = name.replace("\\", "\\\\").replace('"', '\\"')
    return f'"{escaped}"'


def _near(a: float, b: float) -> bool:
    return abs(a / b - 1.0) < _NEAR
