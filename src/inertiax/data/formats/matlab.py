"""MATLAB files: v5 to v7, and v7.3 (which is HDF5) through h5py.

Columns are the numeric variables, or with `[recordings] group` the fields of that struct. A matrix
of n × 3 named `accel` is three columns. Only arrays of numbers are taken, and texts as notes on them; MATLAB
objects, cells and functions are left alone.
"""

from pathlib import Path

import numpy as np
import polars as pl

from ..recording import Recording
from .array_notes import array_notes, ArrayNotes
from .arrays import choose_group, columns_by_length, to_table
from .columns import AS_FOUND, ColumnMap, Layout
from .hdf5 import MAGIC, read_arrays
from .matlab5 import Content, objects, parse
from .table import to_recordings


NAME = "matlab"
SUFFIXES = (".mat",)
KEYS = ("group",)


def read(path: Path, columns: ColumnMap, layout: Layout = AS_FOUND) -> tuple[Recording, ...]:
    """Recordings in a MATLAB file. Raises `ValueError` naming file and variable."""
    arrays, _ = _arrays(path, layout.group)
    return to_recordings(to_table(arrays, columns, path.name), columns, layout, name=path.name)


def decode(path: Path) -> pl.DataFrame:
    """The columns of a MATLAB file under their own names, of the length that most have.

    Raises `ValueError` naming the file.
    """
    return described(path)[0][0]


def described(path: Path) -> tuple[list[pl.DataFrame], ArrayNotes]:
    """The columns of each length, and what the file says of them; texts of v5 to v7 alone.

    Raises `ValueError` naming the file.
    """
    arrays, texts = _arrays(path, None)
    return columns_by_length(arrays, path.name), array_notes(arrays, texts)


def _arrays(path: Path, group: str | None) -> tuple[dict[str, np.ndarray], dict[str, str]]:
    with path.open("rb") as file:
        head = file.read(520)
    return (read_arrays(path, group, matlab=True), {}) if MAGIC in head else _version_5(path, group)


def _version_5(path: Path, group: str | None) -> tuple[dict[str, np.ndarray], dict[str, str]]:
    stored = path.read_bytes()
    content = parse(stored, path.name)
    arrays, texts = _flat(content, "")
    if not arrays and (held := objects(stored)):
        raise ValueError(f"{path.name}: {_of_objects(held)}")
    if group is not None:
        choose_group([k for k, v in content.items() if isinstance(v, dict)], group, path.name)
        inside = content[group]
        return _flat(inside, "") if isinstance(inside, dict) else ({}, {})
    return arrays, texts


def _of_objects(held: dict[str, str]) -> str:
    """What is to be done with a file of MATLAB objects, such as those that MATLAB Mobile records."""
    text = (
        f"it holds MATLAB objects alone ({', '.join(f'{n}: {c}' for n, c in list(held.items())[:6])}), which MATLAB "
        "alone can read"
    )
    if "timetable" not in held.values():
        return f"{text}; there save their numbers as arrays."
    first = "Acceleration" if "Acceleration" in held else next(iter(held))
    return (
        f"{text}. There write each as text: T = timetable2table({first}); T.Timestamp = posixtime(T.Timestamp); "
        "writetable(T, 'accelerometer.csv'), and AngularVelocity likewise as gyroscope.csv beside it; then run "
        "`inertiax init accelerometer.csv`."
    )


def _flat(content: Content, prefix: str) -> tuple[dict[str, np.ndarray], dict[str, str]]:
    """Arrays and texts by name, those of structs behind the struct's own."""
    arrays: dict[str, np.ndarray] = {}
    texts: dict[str, str] = {}
    for name, value in content.items():
        full = f"{prefix}{name}"
        if isinstance(value, dict):
            inside, words = _flat(value, f"{full}/")
            arrays |= inside
            texts |= words
        elif isinstance(value, str):
            texts[full] = value
        else:
            arrays[full] = value
    return arrays, texts
