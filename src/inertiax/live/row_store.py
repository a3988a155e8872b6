"""Rows of one recording in memory: as they came, and at a rate at which rests are looked for.

Rests last seconds: 100 rows a second show them as well as thousands. Every so many rows one is kept as it is, for what
looks at samples, and the mean of all of them, for means over rests.
"""

from typing import Any

import numpy as np
from jaxtyping import Float

from ..data.recording import Recording


RATE = 100.0  # Hz, at which rests are looked for
RATED = 1.0  # s of rows that tell the rate
_COLUMNS = ("accel", "gyro", "temperature", "reference_accel", "reference_gyro")
_LABELS = ("experiment", "position")


class RowStore:
    """Rows of one recording, thinned to about `RATE`."""

    def __init__(self, name: str):
        self.name = name
        self._factor: int | None = None
        self._picked: dict[str, np.ndarray] = {}
        self._means: dict[str, np.ndarray] = {}
        self._count = 0
        self._waiting: dict[str, np.ndarray] = {}
        self.last: float | None = None  # s, stamp of the last row

    @property
    def count(self) -> int:
        """Thinned rows that there are."""
        return self._count

    @property
    def factor(self) -> int:
        """Rows as they came for each that is kept."""
        return self._factor or 1

    def add(self, rows: Recording, time: Float[np.ndarray, " time"]) -> None:
        """Further rows with their stamps, which come after those before."""
        if not len(time):
            return
        self.last = float(time[-1])
        fresh = {key: getattr(rows, key) for key in (*_COLUMNS, *_LABELS)}
        fresh = {key: value for key, value in fresh.items() if value is not None}
        fresh["time"] = time
        if self._waiting:
            fresh = {key: np.concatenate([self._waiting[key], x]) for key, x in fresh.items()}
        self._waiting = fresh
        if self._factor is None:
            span = float(fresh["time"][-1] - fresh["time"][0])
            if span < RATED:
                return
            # Of the first second alone, so that it does not matter how many rows come at once; a clock that runs a
            # little slow is none of another rate.
            first = int(np.searchsorted(fresh["time"], fresh["time"][0] + RATED))
            rate = max(first, 1) / float(fresh["time"][first] - fresh["time"][0])
            self._factor = max(int(1.02 * rate / RATE), 1)
        self._thin(self._factor)

    def _thin(self, factor: int) -> None:
        whole = len(self._waiting["time"]) // factor
        rows = whole * factor
        for key, value in self._waiting.items():
            part = value[:rows].reshape(whole, factor, *value.shape[1:])
            self._picked[key] = _appended(self._picked.get(key), self._count, part[:, 0])
            if key not in _LABELS:
                self._means[key] = _appended(self._means.get(key), self._count, part.mean(axis=1))
        self._waiting = {key: value[rows:] for key, value in self._waiting.items()}
        self._count += whole

    def recording(
        self, start: int = 0, stop: int | None = None, *, means: bool = False
    ) -> Recording:
        """Thinned rows `[start, stop)` as a recording; with `means`, means of the rows that each stands for, stamps
        too."""
        stop = self._count if stop is None else stop
        made: dict[str, Any] = {key: value[start:stop] for key, value in self._picked.items()}
        if means:
            made |= {key: value[start:stop] for key, value in self._means.items()}
        return Recording(**made, name=self.name)


def _appended(values: np.ndarray | None, count: int, further: np.ndarray) -> np.ndarray:
    """`values[:count]` with further rows behind, in an array that has room for more."""
    need = count + len(further)
    if values is None or len(values) < need:
        size = max(2 * need, 4096)
        room = np.empty((size, *further.shape[1:]), further.dtype)
        if values is not None:
            room[:count] = values[:count]
        values = room
    values[count:need] = further
    return values
