"""What a station cannot tell by its own measurements and nobody stated: named, so that no reader takes it for zero."""

from ..calibration.calibrated_triads import calibrated_triads
from ..calibration.calibration import Calibration, TriadCalibration
from ..calibration.magnetometers import MagnetometerCalibration
from ..physics.temperature import Constant
from .record import Record
from .sources_at import BY_GRAVITY


def not_known(
    calibration: Calibration, record: Record, gravity_uncertainty: float | None
) -> tuple[str, ...]:
    """One line each; the first words name the source."""
    station, said = record.station, []
    triads = calibrated_triads(calibration).values()
    thermal = [t for t in triads if not isinstance(t.curve.basis, Constant)]
    if thermal and not station.temperature_uncertainty:
        said.append(
            "probe offset: an error that all temperatures share shifts every curve along the temperature axis; the "
            "campaign states none ([rig] temperature_uncertainty), so none is in the budget."
        )
    if calibration.temperature_range is None:
        said.append("temperature: none was recorded; the results hold at that of the measurement.")
    accel, gyro = calibration.accel, calibration.gyro
    if any(t.estimator == "static" for t in calibration.triads):
        said.append(
            "truth of a static bias: it is the offset from the recording's reference, or where that has none from the "
            "output's own mean, and then says nothing of the true one."
        )
    if accel is not None:
        said += _of_gravity(accel, gravity_uncertainty)
        said += _of_frame(accel)
    if gyro is not None and gyro.estimator == "reference" and not station.rate_uncertainty:
        said.append(
            "rate of the table: an error common to all rates is a common scale factor of the gyros; the campaign "
            "states none ([rig] rate_uncertainty), so none is in the budget."
        )
    if gyro is not None and gyro.estimator == "gravity":
        said.append(
            "clock: the gyros' angles are compared with those of gravity, so a relative error of the recording's clock "
            "is a common scale factor of the gyros, and is not in the budget."
        )
    referenced = any(t.estimator == "reference" for t in calibration.triads)
    if referenced and not station.position_uncertainty:
        said.append(
            "positions of the table: the campaign states no uncertainty ([rig] position_uncertainty); what differs "
            "from one position to the next is in re-positioning, what is common to all is not."
        )
    if referenced and not station.level_uncertainty:
        said.append(
            "level of the table: a base that leans all along shifts misalignments and biases of accelerometers; the "
            "campaign states no uncertainty ([rig] level_uncertainty), so none is in the budget."
        )
    if calibration.mag is not None:
        said += _of_field(calibration.mag)
    said.append(
        "stability: biases of one recording are those of its mean; what changes after the measurement (slow noise, "
        "ageing, shocks, from one turn-on to the next) is not in these uncertainties."
    )
    return tuple(said)


def _of_gravity(accel: TriadCalibration, uncertainty: float | None) -> list[str]:
    if uncertainty is not None and accel.estimator in BY_GRAVITY:
        return []
    why = (
        "no uncertainty of it is stated ([station] gravity_uncertainty), so none is in the budget."
        if accel.estimator in BY_GRAVITY
        else "from one pose it cannot be told from the bias along the vertical, and is not in the budget."
    )
    return [f"reference g: an error of it is a common scale factor of the accelerometers; {why}"]


def _of_field(mag: MagnetometerCalibration) -> list[str]:
    said = [
        "field of the place: iron and currents that stay in place belong to the field; what moves with the device is "
        "taken for its hard and soft iron."
    ]
    if not mag.field_given:
        said.append(
            "magnitude of the field: nobody states it, so that the magnetometers' common scale is by convention, and "
            "its error is not in the budget."
        )
    return said


def _of_frame(accel: TriadCalibration) -> list[str]:
    if accel.estimator == "invariant":
        return [
            "rotation of the triad: only the magnitude of the specific force is compared, so the frame is the triad's "
            "own: accelerometer x is its x axis, accelerometer y lies in its xy plane."
        ]
    if accel.estimator == "reference":
        return [
            "mounting: a constant rotation of the device on the table is part of the misalignments; the references "
            "cannot tell one from the other."
        ]
    return []
