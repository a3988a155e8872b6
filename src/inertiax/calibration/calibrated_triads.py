"""All triads of a calibration, magnetometers among them."""

from typing import Protocol, runtime_checkable

from .magnetometers import MagnetometerCalibration
from .triad import TriadCalibration


@runtime_checkable
class OfTriads(Protocol):
    """What of a `Calibration` is needed here."""

    @property
    def accel(self) -> TriadCalibration | None:
        """The accelerometers."""
        ...

    @property
    def gyro(self) -> TriadCalibration | None:
        """The gyros."""
        ...

    @property
    def mag(self) -> MagnetometerCalibration | None:
        """The magnetometers."""
        ...


def calibrated_triads(calibration: OfTriads) -> dict[str, TriadCalibration]:
    """Parameters over temperature by triad: "accel", "gyro" and "mag", those that were calibrated."""
    mag = None if calibration.mag is None else calibration.mag.triad
    all_of_them = {"accel": calibration.accel, "gyro": calibration.gyro, "mag": mag}
    return {name: triad for name, triad in all_of_them.items() if triad is not None}
