"""A part of a log that is larger than the memory should be: its columns are on the disk until they are asked for.

A log of ten million rows takes a gigabyte as arrays, and every step of a calculation as much again. Its columns are
written to files without a name as it is read, and the log becomes parts, each a recording like any other whose columns
are read when they are used. The files are gone when nobody uses them any more, also after a kill.
"""

import tempfile
import weakref
from collections import OrderedDict
from typing import Any, BinaryIO

import equinox as eqx
import numpy as np

from .recording import COLUMNS, Recording


_HELD = 8  # columns of parts in memory


class ColumnStore:
    """Columns of one log in unnamed files, in the folder for temporary files (`TMPDIR`)."""

    def __init__(self) -> None:
        self.rows = 0
        self._files: dict[str, tuple[Any, np.dtype, tuple[int, ...]]] = {}
        weakref.finalize(self, _close, self._files)
        self._held: OrderedDict[tuple[str, int, int], np.ndarray] = OrderedDict()

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of those that were recorded."""
        return tuple(self._files)

    def append(self, recording: Recording) -> None:
        """Further rows. Raises `ValueError` where they have other columns than those before."""
        given = [c for c in COLUMNS if getattr(recording, c) is not None]
        if self.rows and set(given) != set(self._files):
            raise ValueError("the pieces of a log have different columns.")
        for name in given:
            values = np.ascontiguousarray(getattr(recording, name))
            if name not in self._files:
                file: BinaryIO = tempfile.TemporaryFile()  # type: ignore[assignment]
                self._files[name] = file, values.dtype, values.shape[1:]
            file, kind, shape = self._files[name]
            if values.shape[1:] != shape:
                raise ValueError("the pieces of a log have different columns.")
            file.seek(0, 2)
            values.astype(kind, copy=False).tofile(file)
        self.rows += recording.num_samples

    def read(self, name: str, first: int, stop: int) -> np.ndarray | None:
        """Rows of a column; `None` where it was not recorded."""
        if name not in self._files:
            return None
        key = (name, first, stop)
        if key in self._held:
            self._held.move_to_end(key)
            return self._held[key]
        file, kind, shape = self._files[name]
        width = int(np.prod(shape, dtype=int))
        file.seek(first * width * kind.itemsize)
        values = np.fromfile(file, kind, (stop - first) * width).reshape(-1, *shape)
        self._held[key] = values
        if len(self._held) > _HELD:
            self._held.popitem(last=False)
        return values


def _close(files: dict[str, tuple[Any, np.dtype, tuple[int, ...]]]) -> None:
    for file, _, _ in files.values():
        file.close()


class StoredRecording(Recording):
    """Rows `[first, stop)` of a stored log as a recording; its columns are read anew when they are used.

    `whole` names the log: parts of the same are one run of the programme. `quietest` are the least
    levels of motion of the accelerometers and the gyros in all of it: variances within a second, summed over axes, in
    (m/s²)² and (rad/s)².
    """

    store: ColumnStore | None = eqx.field(static=True, default=None)
    first: int = eqx.field(static=True, default=0)
    stop: int = eqx.field(static=True, default=0)
    whole: str = eqx.field(static=True, default="")
    quietest: tuple[float, float] = eqx.field(static=True, default=(np.inf, np.inf))

    def __getattribute__(self, name: str) -> Any:
        if name in COLUMNS:
            of = super().__getattribute__
            store = of("store")
            return store.read(name, of("first"), of("stop"))
        return super().__getattribute__(name)

    @property
    def num_samples(self) -> int:
        """Number of rows."""
        return self.stop - self.first

    @classmethod
    def part(
        cls,
        store: ColumnStore,
        first: int,
        stop: int,
        *,
        device: str,
        name: str,
        whole: str,
        quietest: tuple[float, float] = (np.inf, np.inf),
    ) -> "StoredRecording":
        """Rows of a stored log, checked as those of any recording."""
        return cls(
            time=np.zeros(0), device=device, name=name, store=store, first=first, stop=stop,
            whole=whole, quietest=quietest,
        )  # fmt: skip
