"""HDF5 files, through h5py: datasets of one length, or one table of named fields.

`[recordings] group` names the group (or table) to read where it is not the root. Links and virtual data
that lead to other files are not followed, and only numbers and fixed text are read.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from ..recording import Recording
from .array_notes import array_notes, ArrayNotes
from .arrays import choose_group, columns_by_length, to_table
from .columns import AS_FOUND, ColumnMap, Layout
from .expansion import require_plausible
from .optional import load
from .table import to_recordings


NAME = "hdf5"
SUFFIXES = (".h5", ".hdf5", ".hdf")
KEYS = ("group",)
MAGIC = b"\x89HDF\r\n\x1a\n"


def read(path: Path, columns: ColumnMap, layout: Layout = AS_FOUND) -> tuple[Recording, ...]:
    """Recordings in an HDF5 file, one per device. Raises `ValueError` naming file and dataset."""
    arrays = read_arrays(path, layout.group)
    return to_recordings(to_table(arrays, columns, path.name), columns, layout, name=path.name)


def decode(path: Path) -> pl.DataFrame:
    """The columns of an HDF5 file under their own names, of the length that most have.

    Raises `ValueError` naming the file.
    """
    return described(path)[0][0]


def described(path: Path) -> tuple[list[pl.DataFrame], ArrayNotes]:
    """The columns of each length, and a rate that the file states in a dataset of one number.

    Raises `ValueError` naming the file.
    """
    arrays = read_arrays(path)
    return columns_by_length(arrays, path.name), array_notes(arrays, {})


def read_arrays(
    path: Path, group: str | None = None, *, matlab: bool = False
) -> dict[str, np.ndarray]:
    """Arrays under a group by name; `matlab` undoes MATLAB's order of axes."""
    h5py = load("h5py", "hdf5", path)
    try:
        with h5py.File(path, "r") as file:
            start = file
            if group is not None:
                choose_group(_names(h5py, file), group.strip("/"), path.name)
                start = file[group]
            require_plausible(_claimed(h5py, start), path.stat().st_size, path.name)
            if isinstance(start, h5py.Dataset):
                return {group or "": _values(start, path, matlab)}
            return _walk(h5py, start, path, matlab)
    # All that h5py makes of HDF5's errors; UnicodeDecodeError (a name) is a ValueError.
    except (OSError, RuntimeError, KeyError, ValueError, TypeError) as error:
        if isinstance(error, ValueError) and str(error).startswith(f"{path.name}: "):
            raise
        reason = (str(error).splitlines() or [type(error).__name__])[0]
        raise ValueError(
            f"{path.name}: the HDF5 file is damaged or cut off: {reason[:200]}."
        ) from None


def _names(h5py, group) -> list[str]:
    """Groups and tables in it that the campaign may name."""
    return [
        name
        for name, item in _members(h5py, group)
        if isinstance(item, h5py.Group) or item.dtype.names is not None
    ]


def _members(h5py, group) -> Iterator[tuple[str, Any]]:
    """Groups and datasets below a group that are in this file itself, with their paths from it.

    A group that several links reach is entered by the first of them alone: links in circles, or from every group to
    every other one, would never end.
    """
    waiting, entered = [("", group)], {_address(h5py, group)}
    while waiting:
        prefix, here = waiting.pop()
        for name in here:
            hard = isinstance(here.get(name, getlink=True), h5py.HardLink)
            if not hard or name.startswith("#"):
                continue
            item = here[name]
            if isinstance(item, h5py.Group):
                if _address(h5py, item) in entered:
                    continue
                entered.add(_address(h5py, item))
                waiting.append((f"{prefix}{name}/", item))
            if isinstance(item, h5py.Group | h5py.Dataset):
                yield f"{prefix}{name}", item


def _address(h5py, item) -> int:
    """Where an object lies in the file: one number for it, whatever links lead there."""
    return h5py.h5o.get_info(item.id).addr


def _walk(h5py, group, path: Path, matlab: bool) -> dict[str, np.ndarray]:
    return {
        name: _values(item, path, matlab)
        for name, item in _members(h5py, group)
        if isinstance(item, h5py.Dataset) and _readable(h5py, item)
    }


def _claimed(h5py, item) -> int:
    """Bytes of everything that would be read: a few bytes of a file can claim any size."""
    items = [item] if isinstance(item, h5py.Dataset) else [i for _, i in _members(h5py, item)]
    return sum(int(i.nbytes) for i in items if isinstance(i, h5py.Dataset) and _readable(h5py, i))


def _readable(h5py, dataset) -> bool:
    """Numbers, fixed text, or rows of those; MATLAB's text and references are neither."""
    if dataset.attrs.get("MATLAB_class", b"double") in (b"char", b"cell", b"function_handle"):
        return False
    text = h5py.check_string_dtype(dataset.dtype) is not None
    return (text or dataset.dtype.kind in "fiubV") and 1 <= dataset.ndim <= 2


def _values(dataset, path: Path, matlab: bool) -> np.ndarray:
    if dataset.is_virtual or dataset.external:
        raise ValueError(
            f"{path.name}: dataset '{dataset.name}' lies in another file; copy it into this one."
        )
    if dataset.dtype.kind == "O":  # text of any length
        return np.char.encode(np.asarray(dataset.asstr()[()], str), "utf-8")
    values = np.asarray(dataset[()])
    return values.T if matlab else values
