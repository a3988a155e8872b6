"""A device that is laid down in many directions, each time for less than a rest takes."""

import numpy as np
from jaxtyping import Float

from ..data.stored_recording import StoredRecording
from ..physics.directions import FEWEST_DIRECTIONS, num_directions
from ..reduction.rests import find_rests
from .evidence import DeviceLogs, Log
from .finding import Finding, finding
from .thresholds import Thresholds


_BRIEF = 0.25  # s over which stillness is judged here: a hand's tremor has a period or two in it
_ENOUGH = (
    1.5  # s, a rest that is found: the second over which motion is judged, and what its ends lose
)
# Thresholds, highest to lowest, that find the same stretches: a factor of 2 between the deviations of rest and motion.
_APART = 4.0
_MORE = 2.0  # times as many directions as rests lie in; fewer were no gain
_MOSTLY = 0.5  # of the rows at rest: a device that lies for long is not laid down briefly


def check_brief_rests(device: DeviceLogs, limits: Thresholds) -> list[Finding]:
    """Rests that were searched and lie in too few directions, beside stillness in many."""
    del limits
    logs = [log for log in device.logs if _can_be_searched(log)]
    if not logs or len(logs) < len(device.logs):
        return []
    means = [m.mean for log in logs if (m := log.over_rests("accel")) is not None]
    lies = _directions(means)
    if lies >= FEWEST_DIRECTIONS:
        return []
    brief, lasts = [], []
    for log in logs:
        accel = log.recording.accel
        found = find_rests(log.recording, window=_BRIEF)
        if accel is None or found.apart < _APART:
            continue
        ranges = list(zip(found.start, found.stop, strict=True))
        brief += [accel[a:b].mean(axis=0)[None] for a, b in ranges]
        lasts += [(b - a) * log.step for a, b in ranges]
    directions = _directions(brief)
    if directions < max(FEWEST_DIRECTIONS, _MORE * lies):
        return []
    usual = float(np.median(lasts))
    if usual >= _ENOUGH:
        return []
    return [
        finding(
            "brief_rests",
            "warning",
            "accel",
            f"{logs[0].name}: the device seems to lie still {len(brief)} times, in {directions} directions, but for "
            f"{usual:.1f} s at a time; rests were found in {lies}. Let it lie for {_ENOUGH:g} s or more each time.",
            times=len(brief),
            directions=directions,
            lasts=usual,
            rests_in=lies,
        )
    ]


def _can_be_searched(log: Log) -> bool:
    """Whether a log's rests were searched, and it moves for most of the time."""
    if log.labelled or log.turning or log.recording.accel is None:
        return False
    return not isinstance(log.recording, StoredRecording) and bool(log.at_rest.mean() < _MOSTLY)


def _directions(means: list[Float[np.ndarray, "some 3"]]) -> int:
    return num_directions(np.concatenate(means)) if means and sum(map(len, means)) else 0
