"""Outputs that a flight controller had corrected before it logged them, as its log states."""

from .evidence import DeviceLogs
from .finding import Finding, finding
from .thresholds import Thresholds


def check_corrected_outputs(device: DeviceLogs, limits: Thresholds) -> list[Finding]:
    """What a log's reader could not take away: the calibration is of what those corrections leave."""
    del limits
    return [
        finding("corrected", "warning", "outputs", said)
        for recording in device.recordings
        for said in recording.reservations
    ]
