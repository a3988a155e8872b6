"""A device that is laid down in many directions, each time for less than a rest takes."""

import numpy as np
from jaxtyping import Float

from ..data.stored_recording import StoredRecording
from ..physics.directions import FEWEST_DIRECTIONS, num_directions
from ..reduction.rests import find_rests
from .evidence import DeviceLogs, Log
from .finding import Finding, finding
from .thresholds import Thresholds


# s over which stillness is judged here, one after the other: a hand's tremor has two periods or one and a half in it.
_BRIEF = (0.25, 0.15)
# Samples of that at least: their variance over three axes is known to a third, far below the factor of `_APART`.
_SAMPLES = 8
# Directions in which rests tell all that |a| does, bias and lower triangle; more of them are no need.
_ALL = 9
_ENOUGH = (
    1.5  # s, a rest that is found: the second over which motion is judged, and what its ends lose
)
_LEAST = 0.25  # s; where one turn ends and the next begins a device is as still for up to 0.23 s
# Thresholds, highest to lowest, that find the same stretches: a factor of 2 between the deviations of rest and motion.
_APART = 4.0
# rad, 0.3°, from its first third to its last: what lies turns by less, and what is turned on stops for a moment between
# two turns, in which it still goes by 0.6° and more; and standard deviations of that.
_TURNS, _SURE = 0.005, 2.0
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
    if lies >= _ALL:
        return []
    enough = max(FEWEST_DIRECTIONS, _MORE * lies)
    told = (_brief(logs, window) for window in _BRIEF)
    brief, lasts, directions = next((x for x in told if x[2] >= enough), ([], [], 0))
    if not directions:
        return []
    usual = float(np.median(lasts))
    if not _LEAST <= usual < _ENOUGH:
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


def _brief(
    logs: list[Log], window: float
) -> tuple[list[Float[np.ndarray, "1 3"]], list[float], int]:
    """Mean outputs, seconds and number of directions of stretches that are still over windows of so many seconds."""
    brief, lasts = [], []
    for log in logs:
        accel = log.recording.accel
        found = find_rests(log.recording, window=window, fewest=_SAMPLES)
        if accel is None or found.apart < _APART:
            continue
        ranges = [(a, b) for a, b in zip(found.start, found.stop, strict=True) if _lies(accel[a:b])]
        brief += [accel[a:b].mean(axis=0)[None] for a, b in ranges]
        lasts += [(b - a) * log.step for a, b in ranges]
    return brief, lasts, _directions(brief)


def _lies(accel: Float[np.ndarray, "time 3"]) -> bool:
    """Whether gravity does not turn from the first third to the last, beyond what noise makes of their means."""
    third = max(len(accel) // 3, 1)
    first, last = accel[:third].mean(axis=0), accel[-third:].mean(axis=0)
    noise = 0.5 * np.mean(np.sum(np.diff(accel, axis=0) ** 2, axis=1))  # over three axes
    most = (_TURNS * np.linalg.norm(first)) ** 2 + _SURE**2 * 2.0 * noise / third
    return bool(np.sum((last - first) ** 2) < most)


def _can_be_searched(log: Log) -> bool:
    """Whether a log's rests were searched, and it moves for most of the time."""
    if log.labelled or log.turning or log.recording.accel is None:
        return False
    return not isinstance(log.recording, StoredRecording) and bool(log.at_rest.mean() < _MOSTLY)


def _directions(means: list[Float[np.ndarray, "some 3"]]) -> int:
    return num_directions(np.concatenate(means)) if means and sum(map(len, means)) else 0
