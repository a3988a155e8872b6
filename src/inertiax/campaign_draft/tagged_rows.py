"""Rows of one sensor each, told by a word or a number in a column of its own: no triad stands in every row."""

import re
import shlex
from typing import NoReturn

import numpy as np
from jaxtyping import Float

from .column_words import means
from .converters import G
from .raw_log import RawLog, unnamed


_KINDS = ("accel", "gyro", "mag")
_IN_A_COMMAND = re.compile(r"[\w .:-]+")  # what needs no care between an awk's quotes
_GRAVITY = (1.0, G, 1000.0)
_MOST_SENSORS = 8  # of one log
_FIRST_COLUMNS = 4  # a label stands beside the stamp, before the values
_MOST_VALUES = 5  # columns behind a sensor's number: an axis each, an accuracy, a second stamp; an IMU's row has six
_FEWEST_ROWS = 20
_ALTERNATES = 0.3  # of the rows differ in their number from the one before; a pose's or a chamber's number stays
_RISES = 0.9  # of a stamp's steps do not go back, though each sensor may be stamped by itself
_APART = 2.0  # between the largest and the smallest median norm: devices side by side have one size
_CONTINUES = 0.5  # from a sensor's row to its next one, to what it is from row to row


def refuse_tagged_rows(log: RawLog) -> None:
    """Raise `ValueError` where each row holds one sensor: `acc 2060 0.03 0.00 0.97`, or `2060 1 0.03 0.00 0.97`."""
    for name, words in log.texts.items():
        kinds = {w: k for w in words for k in _KINDS if means(k, w) and _IN_A_COMMAND.fullmatch(w)}
        imu = next((w for w in words if w.lower() == "imu"), None)
        if len(words) > _MOST_SENSORS:
            continue
        if imu is not None and len(words) > 1:
            command = _rows(log, name, f'"{imu}"', "imu.csv")
            cure = f"write the IMU's rows into a file of its own ({command}), then `inertiax init imu.csv`."
            _refuse(log, name, ", ".join(map(repr, words)), cure)
        if len(set(kinds.values())) > 1:
            first = min(kinds, key=lambda w: _KINDS.index(kinds[w]))
            _refuse(log, name, ", ".join(map(repr, sorted(kinds))), _each(log, name, f'"{first}"'))
    for name in log.names[:_FIRST_COLUMNS]:
        norms = _norms_of_sensors(log, name)
        if norms:
            first = min(norms, key=lambda n: min(abs(norms[n] / g - 1.0) for g in _GRAVITY))
            told = "; ".join(f"{n}: vectors of {size:.3g}" for n, size in norms.items())
            _refuse(log, name, told, _each(log, name, str(first)))


def _refuse(log: RawLog, name: str, tags: str, cure: str) -> NoReturn:
    raise ValueError(
        f"{log.path.name}: each row is of one sensor, named in {name} ({tags}): {cure}"
    )


def _each(log: RawLog, name: str, first: str) -> str:
    return (
        f"write the rows of each into a file of its own ({_rows(log, name, first, 'accel.txt')}, and so on), then "
        "`inertiax init accel.txt --gyro gyro.txt`."
    )


def _rows(log: RawLog, name: str, label: str, to: str) -> str:
    """The command that takes the rows of one sensor, with the names above them."""
    assert log.layout is not None  # only a text has rows of several sensors
    layout = log.layout
    column = (layout.names or unnamed(layout.width)).index(name) + 1
    delimiter = {"\t": "\\t"}.get(layout.delimiter, layout.delimiter)
    between = "" if delimiter == " " else f"-F'[ \"]*{delimiter}[ \"]*' "
    names = "" if layout.header_line is None else f"NR == {layout.header_line} || "
    return f"awk {between}'{names}${column} == {label}' {shlex.quote(log.path.name)} > {to}"


def _norms_of_sensors(log: RawLog, name: str) -> dict[int, float]:
    """The median norm of each sensor's rows, by the number in a column; empty where it numbers no sensors.

    A number of a sensor changes from row to row. Values continue from a sensor's row to its next one, and leap from
    row to row; and they are of several sizes, which those of devices side by side are not.
    """
    numbers = log.numbers[name]
    if log.layout is None or len(numbers) < _FEWEST_ROWS or means("device", name):
        return {}
    if not np.all(numbers == np.round(numbers)) or np.mean(np.diff(numbers) != 0) < _ALTERNATES:
        return {}
    sensors = np.unique(numbers)
    values = [
        v for n, v in log.numbers.items() if n != name and np.mean(np.diff(v) >= 0.0) < _RISES
    ]
    if not 2 <= len(sensors) <= _MOST_SENSORS or not 2 <= len(values) <= _MOST_VALUES:
        return {}
    rows = np.nan_to_num(np.stack(values[:3], axis=1))
    each = [rows[numbers == s] for s in sensors]
    if min(map(len, each)) < 2:
        return {}
    norms = [float(np.median(np.linalg.norm(r, axis=1))) for r in each]
    own = np.median([_leap(r) for r in each])
    if max(norms) < _APART * min(norms) or own > _CONTINUES * _leap(rows):
        return {}
    return {int(s): size for s, size in zip(sensors, norms, strict=True)}


def _leap(rows: Float[np.ndarray, "rows values"]) -> float:
    return float(np.median(np.linalg.norm(np.diff(rows, axis=0), axis=1)))
