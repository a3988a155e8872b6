"""A part of a log that is larger than the memory should be: its columns are on the disk until they are asked for.

A log of ten million rows takes a gigabyte as arrays, and every step of a calculation as much again. Its columns are
written to files without a name as it is read, and the log becomes parts, each a recording like any other whose columns
are read when they are used. The files are gone when nobody uses them any more, also after a kill.
"""

import tempfile
import threading
import weakref
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from .._records import field
from .recording import COLUMNS, Recording


_HELD = 640_000_000  # bytes of columns in memory: those of some ten million rows


class _Files(NamedTuple):
    """Where a column is: a file for each of its axes, so that they are read as they lie in a `Recording`."""

    files: tuple[Any, ...]
    kind: np.dtype
    shape: tuple[int, ...]  # of a row


class ColumnStore:
    """Columns of one log in unnamed files, in the folder for temporary files (`TMPDIR`)."""

    def __init__(self) -> None:
        self.rows = 0
        self._files: dict[str, _Files] = {}
        weakref.finalize(self, _close, self._files)
        self._lock = threading.Lock()  # parts are looked at side by side
        self._held: dict[tuple[str, int, int], np.ndarray] = {}
        self._free = _HELD

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
            values = getattr(recording, name)
            if name not in self._files:
                width = int(np.prod(values.shape[1:], dtype=int))
                made = tuple(tempfile.TemporaryFile() for _ in range(width))
                self._files[name] = _Files(made, values.dtype, values.shape[1:])
            files, kind, shape = self._files[name]
            if values.shape[1:] != shape:
                raise ValueError("the pieces of a log have different columns.")
            for file, column in zip(files, values.reshape(len(values), -1).T, strict=True):
                file.seek(0, 2)
                np.ascontiguousarray(column, kind).tofile(file)
        self.rows += recording.num_samples

    def read(self, name: str, first: int, stop: int, *, keep: bool = True) -> np.ndarray | None:
        """Rows of a column, which are kept in memory while there is room; `None` where it was not recorded."""
        if name not in self._files:
            return None
        key = (name, first, stop)
        with self._lock:
            if key in self._held:
                return self._held[key]
            files, kind, shape = self._files[name]
            read = np.empty((len(files), stop - first), kind)
            for row, file in zip(read, files, strict=True):
                file.seek(first * kind.itemsize)
                file.readinto(row.view(np.uint8))
            values = read.T if shape else read[0]
            # Each step of a calculation goes from the first part to the last: what came first is asked for again
            # before what came after it, and stays.
            if keep and values.nbytes <= self._free:
                self._held[key] = values
                self._free -= values.nbytes
            return values


def _close(stored: "dict[str, _Files]") -> None:
    for each in stored.values():
        for file in each.files:
            file.close()


class StoredRecording(Recording):
    """Rows `[first, stop)` of a stored log as a recording; its columns are read anew when they are used.

    `whole` names the log: parts of the same are one run of the programme. `quietest` are the least
    levels of motion of the accelerometers and the gyros in all of it: variances within a second, summed over axes, in
    (m/s²)² and (rad/s)².
    """

    # Again without the conversion of `Recording`, which would keep what it converts; the store has them so already.
    accel: Float[np.ndarray, "time 3"] | None = None
    gyro: Float[np.ndarray, "time 3"] | None = None
    temperature: Float[np.ndarray, "time probes"] | None = None
    reference_accel: Float[np.ndarray, "time 3"] | None = None
    reference_gyro: Float[np.ndarray, "time 3"] | None = None
    mag: Float[np.ndarray, "time 3"] | None = None
    store: ColumnStore | None = field(static=True, default=None)
    first: int = field(static=True, default=0)
    stop: int = field(static=True, default=0)
    whole: str = field(static=True, default="")
    quietest: tuple[float, float] = field(static=True, default=(np.inf, np.inf))

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


def log_numbers(recordings: Sequence[Recording]) -> Int[np.ndarray, " recording"]:
    """Number of the log that each recording is of, from 0: parts of one log share theirs.

    ```python
    import numpy as np
    from inertiax import Recording
    from inertiax.data.stored_recording import log_numbers

    one = Recording.from_arrays(accel=np.ones((10, 3)), sample_rate=100.0)
    print(log_numbers([one, one]))    # [0 1]
    ```
    """
    whole = [r.whole if isinstance(r, StoredRecording) else "" for r in recordings]
    fresh = [not w or w != before for w, before in zip(whole, ["", *whole], strict=False)]
    return np.cumsum(fresh) - 1
