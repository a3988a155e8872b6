"""Whether the device moves now, how long it has rested, and the rests among the rows of one recording so far."""

import dataclasses

import numpy as np

from ..data.recording import Recording
from ..reduction.rests import Rests, STILL
from .rest_ledger import found_rests, labelled, WINDOW
from .row_store import RowStore


_STEADY = 2000  # thinned rows that tell the usual step
LONGEST = 180_000  # thinned rows, half an hour, in which rests are searched


@dataclasses.dataclass(eq=False)
class RestWatch:
    """Of one recording. Rows are those of its store, thinned."""

    store: RowStore
    looked: int = 0  # rows that were looked at
    moved: int | None = None  # last row of a window in which the device moved
    asked: float | None = None  # when rests were last asked for, s
    held: float = 0.0  # s of the present rest at which it was last told
    _finder: Rests | None = None  # the finder's last answer
    _step: float | None = None  # s, between rows

    @property
    def moving(self) -> bool:
        """Whether the device moved in the newest window."""
        return self.moved is not None and self.moved == self.looked

    @property
    def asked_before(self) -> bool:
        """Whether the finder has answered yet."""
        return self._finder is not None

    @property
    def step(self) -> float:
        """From row to row, s: the median over the first rows."""
        if self._step is None or self.store.count < _STEADY:
            stamps = self.store.recording(0, min(self.store.count, _STEADY)).time
            self._step = float(np.median(np.diff(stamps))) if len(stamps) > 1 else 0.01
        return self._step

    @property
    def slack(self) -> int:
        """Rows by which an end may move without a rest's being another one: a window."""
        return round(WINDOW / self.step)

    def search(self, row: int) -> list[tuple[int, int, int]]:
        """Rests among the rows before `row`: first row, row behind the last, label."""
        first = max(row - LONGEST, 0)
        found, finder = found_rests(self.store.recording(first, row))
        self._finder = finder or self._finder
        return [(first + a, first + b, label) for a, b, label in found]

    def moves(self, window: Recording) -> bool:
        """Whether the device moved within the newest window, as the finder judged it when it was last asked."""
        if window.position is not None:
            return bool(window.position[-1] < 0 or window.position[-1] != window.position[-2])
        if self._finder is None or self._finder.levels is None:
            return False
        return self._finder.levels.motion_of(window) > (self._finder.threshold or STILL)

    def begins_with(self, found: list[tuple[int, int, int]], width: int) -> None:
        """The present rest begins where the finder says: before, the device moved, which a session that begins with
        motion could not know. `width` is the window's, in rows."""
        if found and found[-1][0] > 0:
            self.moved = max(self.moved or 0, found[-1][0] + width // 2)

    def rested(self, row: int) -> float:
        """How long the device has rested up to `row`, s; a rest that the finder finds is a window shorter."""
        return (row - (self.moved or 0)) * self.step - WINDOW * (self.moved is not None)

    def is_over(self, rest: tuple[int, int, int], row: int) -> bool:
        """Whether a rest that was found ended before `row`."""
        if labelled(self.store.recording(row - 1, row)):
            return rest[1] < row
        return self.moved is not None and rest[1] <= self.moved
