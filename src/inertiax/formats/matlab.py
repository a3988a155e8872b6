"""MATLAB files: v5 to v7 through SciPy, v7.3 (which is HDF5) through h5py.

Columns are the numeric variables, or with `[recordings] group` the fields of that struct. A matrix
of n × 3 named `accel` is three columns. Only arrays of numbers are taken; MATLAB objects, cells and
functions are left alone.
"""

import warnings
from pathlib import Path

import numpy as np
import scipy.io

from ..recordings import Recording
from .arrays import choose_group, to_table
from .columns import AS_FOUND, ColumnMap, Layout
from .hdf5 import MAGIC, read_arrays
from .table import to_recordings


NAME = "matlab"
SUFFIXES = (".mat",)
KEYS = ("group",)


def is_matlab(head: bytes) -> bool:
    """Whether a file's first bytes are those of a MATLAB v5 to v7.3 file."""
    return head.startswith((b"MATLAB 5.0", b"MATLAB 7.3"))


def read(path: Path, columns: ColumnMap, layout: Layout = AS_FOUND) -> tuple[Recording, ...]:
    """Recordings in a MATLAB file. Raises `ValueError` naming file and variable."""
    with path.open("rb") as file:
        head = file.read(520)
    if MAGIC in head:
        arrays = read_arrays(path, layout.group, matlab=True)
    else:
        arrays = _version_5(path, layout.group)
    return to_recordings(to_table(arrays, columns, path.name), columns, layout, name=path.name)


def _version_5(path: Path, group: str | None) -> dict[str, np.ndarray]:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of variables that are no numbers
            content = scipy.io.loadmat(path, struct_as_record=True, chars_as_strings=False)
    # SciPy meets a damaged file with whatever its parsing runs into (MatReadError,
    # zlib.error, TypeError, ValueError, IndexError, KeyError, OverflowError, MemoryError), and promises none of it.
    except Exception as error:
        reason = (str(error).splitlines() or [type(error).__name__])[0]
        raise ValueError(
            f"{path.name}: the MATLAB file is damaged or cut off: {reason[:200]}."
        ) from None
    content = {k: v for k, v in content.items() if not k.startswith("__")}
    if group is not None:
        structs = [k for k, v in content.items() if _is_struct(v)]
        choose_group(structs, group, path.name)
        return _fields(content[group], "")
    arrays: dict[str, np.ndarray] = {}
    for name, value in content.items():
        arrays |= _fields(value, f"{name}/") if _is_struct(value) else {name: value}
    return {k: v for k, v in arrays.items() if _numeric(v)}


def _is_struct(value: object) -> bool:
    return isinstance(value, np.ndarray) and value.dtype.names is not None and value.size == 1


def _numeric(value: object) -> bool:
    return isinstance(value, np.ndarray) and value.dtype.kind in "fiub"


def _fields(struct: np.ndarray, prefix: str) -> dict[str, np.ndarray]:
    record = struct.reshape(-1)[0]
    arrays: dict[str, np.ndarray] = {}
    for name in struct.dtype.names or ():
        value = record[name]
        if _is_struct(value):
            arrays |= _fields(value, f"{prefix}{name}/")
        elif _numeric(value):
            arrays[f"{prefix}{name}"] = value
    return arrays
