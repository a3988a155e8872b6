"""One channel of a log that is longer than the memory should hold, in a file without a name.

It has a length and slices like an array, and each slice is read when it is taken. What works on a channel takes slices,
so that one code serves both. The file vanishes with the process, however it ends.
"""

import tempfile
import weakref
from collections.abc import Iterable, Iterator

import numpy as np
from jaxtyping import Float


BLOCK = 1 << 18  # samples that are read at a time


class StoredChannel:
    """Samples on the disk, in the folder for temporary files (`TMPDIR`)."""

    def __init__(self, pieces: Iterable[Float[np.ndarray, " row"]]):
        self._file = tempfile.TemporaryFile()
        weakref.finalize(self, self._file.close)
        self._count = 0
        for piece in pieces:
            np.ascontiguousarray(piece, float).tofile(self._file)
            self._count += len(piece)

    def __len__(self) -> int:
        return self._count

    def __getitem__(self, rows: slice) -> Float[np.ndarray, " row"]:
        first, stop, step = rows.indices(self._count)
        assert step == 1
        self._file.seek(8 * first)
        return np.fromfile(self._file, float, max(stop - first, 0))


Log = Float[np.ndarray, " time"] | StoredChannel


def blocks_of(log: Log, length: int = BLOCK) -> Iterator[Float[np.ndarray, " row"]]:
    """The samples in order, `length` at a time."""
    for first in range(0, len(log), length):
        yield log[first : first + length]


def is_constant(log: Log) -> bool:
    """Whether all samples are equal."""
    start = log[0:1]
    return all(bool(np.all(block == start)) for block in blocks_of(log))
