"""A log in which the device never lies still, so that gravity tells nothing of its triads."""

from .evidence import DeviceLogs
from .finding import Finding, finding
from .thresholds import Thresholds


def check_no_rest(device: DeviceLogs, limits: Thresholds) -> list[Finding]:
    """Accelerometers or gyros without any rest or plateau; magnetometers need none."""
    del limits
    inertial = [
        n for n in ("accel", "gyro") if any(getattr(r, n) is not None for r in device.recordings)
    ]
    seen = sum(log.num_rests + len(log.plateau_start) for log in device.logs)
    if seen or not inertial:
        return []
    names = ", ".join(log.name for log in device.logs[:3])
    return [
        finding(
            "no_rest",
            "warning",
            " and ".join(inertial),
            f"{names}: the device never lies still, so that gravity tells nothing of its "
            f"{'accelerometers' if inertial[0] == 'accel' else 'gyros'}; let it lie for seconds in each of nine "
            "orientations or more.",
            recordings=len(device.logs),
        )
    ]
