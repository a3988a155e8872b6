"""Rates that a station states through a ramp, or does not state at all."""

from .evidence import DeviceLogs
from .finding import Finding, finding
from .thresholds import Thresholds


def check_stated_rates(device: DeviceLogs, limits: Thresholds) -> list[Finding]:
    """Notes: ends of plateaus at which the gyros still change, and a table whose rates are not used.

    A programmed rate may be written while the table still speeds up. See `reduction.plateaus.without_unsaid_ramps`.
    """
    del limits
    found = [
        finding(
            "ramps", "note", "reference_gyro",
            f"{log.name}: {ramps_sentence(log.ramps)}", seconds=log.ramps,
        )
        for log in device.logs
        if log.ramps
    ]  # fmt: skip
    first = device.logs[0].recording
    unused = device.columns.table_angles is not None and first.reference_gyro is None
    if unused and first.gyro is not None and "gyro" not in device.left_alone:
        text = (
            "No rates of the table are used, and gyros have no reference: [columns] table_rates names them; or give "
            "[table] azimuth, and the change of the angles is taken."
        )
        found.append(finding("ramps", "note", "reference_gyro", text))
    return found


def ramps_sentence(seconds: float) -> str:
    """What is left out of plateaus, in one sentence."""
    return (
        f"{seconds:.1f} s at ends of plateaus are left out, in which the gyros still change while reference_gyro is "
        "constant, as a programmed rate is while the table speeds up."
    )
