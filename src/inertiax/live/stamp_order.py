"""Which rows of a log in the making go on, which are out of order, and which begin another recording.

A clock that began anew stays back, and a row that was late, or whose stamp was garbled, stands alone: so the batch
reader tells them apart (`mended_stamps`), by the rows on both sides. Those behind are not there yet, so a row whose
stamp is not within a few usual steps of the one before waits for them. A counter that was full goes on, as it does
there.
"""

from collections import deque
from enum import auto, Enum

import numpy as np
from jaxtyping import Float

from ..data.formats.mended_stamps import BESIDE, counter_held, LATE


LEAP = 60.0  # s; a clock that goes forward by more begins another recording, since one is one continuous log
_KEPT = 100  # stamps that tell the usual step (convention)


class Place(Enum):
    """Where a row belongs."""

    GOES_ON = auto()
    AGAIN = auto()  # it repeats the stamp before
    ASIDE = auto()  # out of order: it came late, or its stamp is far off alone
    BEGINS = auto()  # the first row of another recording
    FULL = auto()  # the first row after a counter was full: it goes on, and so do those behind it


class StampOrder:
    """Judges the stamps of one log, which come some at a time."""

    def __init__(self) -> None:
        self._kept: deque[float] = deque(maxlen=_KEPT)  # of the present recording, s
        self._usual = 0.0  # s, between rows
        self._ends = (
            np.inf,
            -np.inf,
        )  # s, earliest and latest stamp of all: whatever began anew, a counter is the device's
        self.counter = 0.0  # s, what the counter holds that was full last

    @property
    def last(self) -> float | None:
        """Stamp of the last row that went on, s."""
        return self._kept[-1] if self._kept else None

    def places(self, time: Float[np.ndarray, " row"], *, end: bool = False) -> list[Place]:
        """Where rows belong, from the first on, as far as it can be told: rows beyond are to be given again, with what
        follows. With `end` nothing does, and all are told.

        ```python
        StampOrder().places(np.array([0.0, 0.01, 0.03, 0.02, 0.04]))  # the fourth is ASIDE, all others GO_ON
        ```
        """
        steps = np.diff(np.append(self._kept, time))
        if (steps > 0.0).any():
            self._usual = float(np.median(steps[steps > 0.0]))
        found = []
        for k in range(len(time)):
            place = self._place(time[k : k + BESIDE], end=end)
            if place is None:
                break
            found.append(place)
            if place in (Place.BEGINS, Place.FULL):
                self._kept.clear()
            if place in (Place.GOES_ON, Place.BEGINS, Place.FULL):
                stamp = float(time[k])
                self._kept.append(stamp)
                self._ends = min(self._ends[0], stamp), max(self._ends[1], stamp)
        return found

    def _place(self, ahead: Float[np.ndarray, " row"], *, end: bool) -> Place | None:
        """Of the first of these rows; `None` while too few follow it."""
        if self.last is None:
            return Place.GOES_ON
        step = float(ahead[0]) - self.last
        if step == 0.0:
            return Place.AGAIN
        if abs(step) <= LATE * self._usual:
            return Place.GOES_ON if step > 0.0 else Place.ASIDE
        whole = len(ahead) == BESIDE
        if not whole and not end:
            return None
        now = float(np.median(ahead))
        if step < 0.0:
            before = float(np.median(list(self._kept)[-BESIDE:]))
            stays = whole and now < before and bool(np.all(np.diff(ahead) >= 0.0))
            if not stays:
                return Place.ASIDE
            held = float(counter_held(np.array([step]), self._usual, self._span(ahead))[0])
            self.counter = held or self.counter
            return Place.FULL if held else Place.BEGINS
        if now < ahead[0]:
            return Place.ASIDE
        if step > LEAP:
            return Place.BEGINS if whole else Place.ASIDE
        return Place.GOES_ON

    def _span(self, ahead: Float[np.ndarray, " row"]) -> float:
        """From the earliest stamp to the latest, s, with these rows."""
        return max(self._ends[1], float(ahead.max())) - min(self._ends[0], float(ahead.min()))
