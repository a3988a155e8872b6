"""Rows that a logger held or filled in: no channel changes for far longer than anywhere else in the recording."""

import numpy as np

from .._typing import Mask
from ..data.recording import Recording


_LONGER = 20.0  # times the other runs of equal rows: a coarse converter repeats rows everywhere
_MOST = 0.3  # of the recording; where more stands still, that is how this converter reads at rest


def held_rows(recording: Recording, width: int) -> Mask:
    """Rows within runs of `width` equal rows or more, equal in all channels of both triads, that no noise explains.

    They say nothing of the sensor: neither its noise, nor its bias, nor that it lay still. Without gyros none are
    told, since accelerometers that are coarse for their noise are constant at rest.
    """
    none = np.zeros(recording.num_samples, bool)
    if recording.accel is None or recording.gyro is None or recording.num_samples < 2:
        return none
    same = np.all(recording.accel[1:] == recording.accel[:-1], axis=1)
    same &= np.all(recording.gyro[1:] == recording.gyro[:-1], axis=1)
    edge = np.flatnonzero(np.diff(np.concatenate([[False], same, [False]]).astype(np.int8)))
    start, stop = edge[::2], edge[1::2] + 1
    long = stop - start >= width
    if not long.any():
        return none
    others = (stop - start)[~long]
    usual = float(others.mean()) if len(others) else 1.0
    for a, b in zip(start[long], stop[long], strict=True):
        none[a:b] = b - a > _LONGER * usual
    return none if none.mean() <= _MOST else np.zeros(recording.num_samples, bool)
