"""What was recorded of a device, for its protocol."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from .recording import Recording


class Recorded(NamedTuple):
    """One device's recordings in numbers, and what the plausibility checks warn of."""

    recordings: int
    samples: int  # of all recordings together
    seconds: float  # likewise
    experiments: int  # runs of the programme
    warnings: tuple[str, ...] = ()


def recorded(recordings: Sequence[Recording], warnings: Sequence[str] = ()) -> Recorded:
    """The numbers of one device's recordings; where none has a column `experiment`, each is a run."""
    found = [np.unique(r.experiment) for r in recordings if r.experiment is not None]
    return Recorded(
        recordings=len(recordings),
        samples=sum(r.num_samples for r in recordings),
        seconds=float(sum(r.time[-1] - r.time[0] for r in recordings)),
        experiments=len(np.unique(np.concatenate(found))) if found else len(recordings),
        warnings=tuple(warnings),
    )
