"""The triads that a protocol states, magnetometers among them."""

from ..calibration.calibration import Calibration, TriadCalibration


def calibrated_triads(calibration: Calibration) -> dict[str, TriadCalibration]:
    """Parameters over temperature by triad: "accel", "gyro" and "mag", those that were calibrated."""
    mag = None if calibration.mag is None else calibration.mag.triad
    all_of_them = {"accel": calibration.accel, "gyro": calibration.gyro, "mag": mag}
    return {name: triad for name, triad in all_of_them.items() if triad is not None}
