"""The segments of all recordings of one device: their positions' numbers, and what the recordings together lack."""

import dataclasses
from collections.abc import Sequence

import numpy as np

from ..data.recording import Recording
from .known_moves import with_known_moves
from .segments import segment_each, Segments


def segment_all(
    recordings: Sequence[Recording],
    *,
    window: float = 1.0,
    handling: bool = True,
    held: bool = False,
) -> tuple[Segments, ...]:
    """The segments of each recording; positions that no recording states are numbered through all of them."""
    found = segment_each(recordings, window=window, handling=handling, held=held)
    return of_one_device(recordings, found)


def of_one_device(
    recordings: Sequence[Recording], segments: Sequence[Segments], *, moves: bool = True
) -> tuple[Segments, ...]:
    """Segments of which positions that no recording states are numbered through all recordings; with the moves between
    rests where plateaus do not tell the gyros' matrix (`known_moves`), unless `moves` is `False`."""
    made, first = [], 0
    for recording, found in zip(recordings, segments, strict=True):
        if recording.position is None:  # numbers of our own: no two recordings share a position
            position = np.where(found.position >= 0, found.position + first, found.position)
            first = max(first, int(position.max(initial=-1)) + 1)
            found = dataclasses.replace(found, position=position)
        made.append(found)
    return with_known_moves(recordings, made) if moves else tuple(made)
