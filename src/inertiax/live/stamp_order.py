"""Which rows of a log in the making go on, which are out of order, and which begin another recording.

A clock that began anew stays back, and a row that was late, or whose stamp was garbled, stands alone: so the batch
reader tells them apart (`mended_stamps`), by the rows on both sides. Those behind are not there yet, so a row whose
stamp is not within a few usual steps of the one before waits for them.
"""

from collections import deque
from enum import auto, Enum

import numpy as np
from jaxtyping import Float

from ..data.formats.mended_stamps import BESIDE, LATE


LEAP = 60.0  # s; a clock that goes forward by more begins another recording, since one is one continuous log
_KEPT = 100  # stamps that tell the usual step (convention)


class Place(Enum):
    """Where a row belongs."""

    GOES_ON = auto()
    AGAIN = auto()  # it repeats the stamp before
    ASIDE = auto()  # out of order: it came late, or its stamp is far off alone
    BEGINS = auto()  # the first row of another recording


class StampOrder:
    """Judges the stamps of one log, which come some at a time."""

    def __init__(self) -> None:
        self._kept: deque[float] = deque(maxlen=_KEPT)  # of the present recording, s
        self._usual = 0.0  # s, between rows

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
            if place is Place.BEGINS:
                self._kept.clear()
            if place in (Place.GOES_ON, Place.BEGINS):
                self._kept.append(float(time[k]))
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
            return Place.BEGINS if stays else Place.ASIDE
        if now < ahead[0]:
            return Place.ASIDE
        if step > LEAP:
            return Place.BEGINS if whole else Place.ASIDE
        return Place.GOES_ON
