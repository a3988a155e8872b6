"""What was recorded of a device, for its protocol."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from .moments import UNIX
from .recording import Recording


_ALIKE = 0.01  # of a rate


class Recorded(NamedTuple):
    """One device's recordings in numbers, and what the plausibility checks warn of."""

    recordings: int
    samples: int  # of all recordings together
    seconds: float  # likewise
    experiments: int  # runs of the programme
    begin: float | None = None  # s since 1970, of the first row; None: the clock does not say
    end: float | None = None  # s since 1970, of the last row
    sample_rate: float | None = None  # Hz, the usual one; None: recordings differ by more than 1 %
    warnings: tuple[str, ...] = ()


def recorded(recordings: Sequence[Recording], warnings: Sequence[str] = ()) -> Recorded:
    """The numbers of one device's recordings; where none has a column `experiment`, each is a run."""
    days = moments_since_1970(recordings)
    found = [np.unique(r.experiment) for r in recordings if r.experiment is not None]
    return Recorded(
        recordings=len(recordings),
        samples=sum(r.num_samples for r in recordings),
        seconds=float(sum(r.time[-1] - r.time[0] for r in recordings)),
        experiments=len(np.unique(np.concatenate(found))) if found else len(recordings),
        begin=None if days is None else days[0],
        end=None if days is None else days[1],
        sample_rate=_usual_rate(recordings),
        warnings=tuple(warnings),
    )


def moments_since_1970(recordings: Sequence[Recording]) -> tuple[float, float] | None:
    """The first and the last stamp of recordings, s since 1970; `None` where a clock counts from somewhere else.

    A clock between 0.9e9 and 2.5e9 s, years 1998 to 2049, is Unix time: no device is on for as long.
    """
    ends = np.array([(r.time[0], r.time[-1]) for r in recordings])
    if not len(ends) or ends.min() < UNIX[0] or ends.max() > UNIX[1]:
        return None
    return float(ends.min()), float(ends.max())


def _usual_rate(recordings: Sequence[Recording]) -> float | None:
    """Samples a second of all recordings, Hz, by their median step."""
    steps = [float(np.median(np.diff(r.time))) for r in recordings if r.num_samples > 1]
    if not steps or max(steps) > (1.0 + _ALIKE) * min(steps):
        return None
    return 1.0 / float(np.median(steps))
