"""The turns between accepted rests that follow each other in one recording."""

import numpy as np

from ..reduction.rests import PAUSE
from .gyro_rows import LONGEST, Turn
from .rest_ledger import Rest
from .row_store import RowStore


FEWEST = 4  # rows of a turn, as in the batch estimate
LARGEST_STEP = 0.5  # rad from row to row, as there


def turns_between(
    rests: list[Rest], stores: list[RowStore], known: dict[tuple[int, int, int], Turn]
) -> list[Turn]:
    """Turns between rests; those of the same rows are kept in `known`, with what was integrated of them."""
    ordered = sorted(rests, key=lambda r: (r.part, r.start))
    found = []
    for before, after in zip(ordered[:-1], ordered[1:]):
        if before.part != after.part or before.gyro is None or before.accel is None:
            continue
        key = before.part, before.stop, after.start
        if key not in known:
            made = _turn(before, after, stores[before.part - 1])
            if made is None:
                continue
            known[key] = made
        found.append(known[key])
    return found


def _turn(before: Rest, after: Rest, store: RowStore) -> Turn | None:
    if after.start - before.stop < FEWEST or after.start > store.count:
        return None
    rows = store.recording(before.stop, after.start, means=True)
    if before.accel is None or after.accel is None or rows.gyro is None:
        return None
    assert before.gyro is not None and after.gyro is not None
    steps = np.diff(rows.time)
    step = float(steps.mean())
    rate = rows.gyro - 0.5 * (before.gyro + after.gyro)
    if steps.max() > PAUSE * np.median(steps) or len(rate) * step > LONGEST:
        return None
    if np.linalg.norm(rate, axis=1).max() * step > LARGEST_STEP:
        return None
    return Turn(rate, step, before.accel, after.accel, _walk(before, after, len(rate) * step))


def _walk(before: Rest, after: Rest, seconds: float) -> float:
    """Variance of the integrated rate: N² T by the noise at rest, and the bias' own times T²."""
    walk = 0.0
    for rest in (before, after):
        assert rest.gyro_covariance is not None
        of_mean = float(np.trace(rest.gyro_covariance)) / 3.0
        lasts = rest.time[1] - rest.time[0]
        walk += 0.5 * of_mean * lasts * seconds + 0.25 * of_mean * seconds**2
    return walk
