"""Whether a recording has what a calibration needs: the device, the temperature, the triads."""

from ..calibration.calibration import Calibration
from ..data.recording import Recording
from ..physics.temperature import Constant


def require_fit(
    calibration: Calibration, recording: Recording, name: str, *, any_device: bool = False
) -> None:
    """Raises `ValueError` where a recording is another device's, or lacks what the calibration needs."""
    _check_device(calibration, recording, name, any_device)
    _check_columns(calibration, recording, name)


def _check_device(
    calibration: Calibration, recording: Recording, name: str, any_device: bool
) -> None:
    ours, theirs = calibration.device.strip(), recording.device
    if ours and theirs and ours != theirs and not any_device:
        raise ValueError(
            f"{name}: recorded by device '{theirs}', but the calibration is of '{ours}'; give the "
            f"calibration of '{theirs}', or --any-device to apply it all the same."
        )


def _check_columns(calibration: Calibration, recording: Recording, name: str) -> None:
    triads = [t for t in (calibration.accel, calibration.gyro) if t is not None]
    if calibration.mag is not None and recording.mag is not None:
        triads.append(calibration.mag.triad)
    by_temperature = any(not isinstance(t.curve.basis, Constant) for t in triads)
    if by_temperature and recording.temperature is None:
        raise ValueError(
            f"{name}: no temperature column, but the calibration depends on temperature; record it, "
            f"or map it with --campaign."
        )
    gyro = calibration.gyro
    by_force = gyro is not None and any("g_sensitivity" in n for n in gyro.names)
    if by_force and recording.gyro is not None and recording.accel is None:
        raise ValueError(
            f"{name}: no accelerometer columns, but the gyros' g-sensitivity was calibrated and needs "
            f"them to be compensated."
        )
    usable = [(getattr(calibration, t), getattr(recording, t)) for t in ("accel", "gyro", "mag")]
    if not any(c is not None and r is not None for c, r in usable):
        raise ValueError(
            f"{name}: the calibration is of the {_named(calibration)}, which it does not hold."
        )


def _named(calibration: Calibration) -> str:
    """The first triad that is calibrated."""
    if calibration.accel is None and calibration.gyro is None:
        return "magnetometers"
    return "gyros" if calibration.accel is None else "accelerometers"
