"""The gyros' unit in a log without rests: while the device is moved the force turns as the integrated rates do."""

import math

import numpy as np

from ..reduction.gravity_turns import turns_in_motion
from . import remedies
from .dead_channels import is_dead
from .evidence import DeviceLogs, Log
from .finding import Finding, finding
from .thresholds import Thresholds
from .turns import motions_of


_DEGREE = math.pi / 180.0
_MOST_ROWS = 100_000  # of a recording: more say no more


def check_gyro_in_motion(device: DeviceLogs, limits: Thresholds) -> list[Finding]:
    """Recordings whose rests tell nothing of the gyros. What a motion adds to gravity leaves a unit, and no scale."""
    if is_dead(device, "accel", limits) or is_dead(device, "gyro", limits):
        return []
    found: list[Finding] = []
    for log in device.logs:
        motions = motions_of((log,), limits.least_tilt)
        if motions is None or motions.count < limits.fewest_motions:  # else judged by those
            found += unit_in_motion(device, log, limits)
    return found


def unit_in_motion(device: DeviceLogs, log: Log, limits: Thresholds) -> list[Finding]:
    """What the force in motion tells of the gyros' unit in one recording."""
    recording = log.recording
    accel, gyro = recording.accel, recording.gyro
    if accel is None or gyro is None or log.labelled or recording.reference_gyro is not None:
        return []
    rows = slice(0, _MOST_ROWS)
    turns = turns_in_motion(recording.time[rows], gyro[rows], accel[rows])
    if turns is None:
        return []
    given, none = turns.misfit(1.0), turns.misfit(0.0)
    factor = min((_DEGREE, 1.0 / _DEGREE), key=turns.misfit)
    best = turns.misfit(factor)
    if best > limits.turn_agrees or limits.turn_gain * best > min(given, none):
        return []
    remedy, unit = remedies.rescaled("gyro", device.columns, factor)
    likely = "look at their unit" if unit is None else f"likely {unit}"
    return [
        finding(
            "gyro_unit",
            "warning",
            "gyro",
            f"{log.name}: in {turns.num_motions} windows of motion the force turns as the gyros do where their values "
            f"are multiplied by {factor:.4g} (to {np.degrees(best):.2g}°; as given to {np.degrees(given):.2g}°); "
            f"{likely}.",
            remedy=remedy,
            ratio=1.0 / factor,
            windows=turns.num_motions,
        )
    ]
