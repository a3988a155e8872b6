"""Project Aria's device calibration JSON: an entry of `ImuCalibrations`, at one temperature.

Aria rectifies as x = R⁻¹ (x' − offset): in spite of its name `RectificationMatrix` is the forward matrix,
upper triangular for accelerometers and full for gyros, in the IMU's frame. The rotation from there to the
case is `T_Device_Imu` (its translation is not known here and is zero).

**Reference:** Project Aria tools, *IMU intrinsics* and the device calibration's JSON.
"""

import json

import numpy as np
from jaxtyping import Float

from ..calibration.calibration import Calibration
from .export import Export, OneTemperature
from .imported import calibration as imported, numbers, triad
from .parameters import chosen_temperature, constants_loss, g_sensitivity_loss, parameters_at
from .triangular import quaternion, upper_times_rotation


NAME = "aria"
TITLE = "Project Aria's device calibration JSON (ImuCalibrations)"
SUFFIX = ".aria.json"
KEEPS = "bias, full matrices, the case frame; one temperature"
LOSES = "temperature dependence, g-sensitivity, uncertainties"


class Settings(OneTemperature, frozen=True, kw_only=True):
    """`label` is the IMU's name in the file."""

    label: str = "imu-right"


def write(calibration: Calibration, settings: Settings) -> Export:
    """Aria's file of the parameters at `settings.temperature`, °C."""
    temperature = chosen_temperature(calibration, settings.temperature)
    p = parameters_at(calibration, temperature)
    upper, frame = upper_times_rotation(p.accel_matrix)
    gyro = p.gyro_matrix @ frame.T
    w, x, y, z = quaternion(frame.T).tolist()
    constant = lambda offset: {"Name": "Constant", "Offset": offset.tolist()}
    entry = {
        "Label": settings.label,
        "SerialNumber": calibration.device,
        "Calibrated": True,
        "T_Device_Imu": {"Translation": [0.0, 0.0, 0.0], "UnitQuaternion": [w, [x, y, z]]},
        "Accelerometer": {
            "Model": {"Name": "UpperTriagonalLinear", "RectificationMatrix": upper.tolist()},
            "Bias": constant(p.accel_bias),
            "TimeOffsetSec_Device_Accel": 0.0,
        },
        "Gyroscope": {
            "Model": {"Name": "Linear", "RectificationMatrix": gyro.tolist()},
            "Bias": constant(p.gyro_bias),
            "TimeOffsetSec_Device_Gyro": 0.0,
        },
    }

    def applied(accel: np.ndarray, output: np.ndarray, _: np.ndarray):
        to_device = lambda x, matrix, bias: (x - bias) @ np.linalg.inv(matrix).T @ frame
        return to_device(accel, upper, p.accel_bias), to_device(output, gyro, p.gyro_bias)

    return Export(
        files=(("", json.dumps({"ImuCalibrations": [entry]}, indent=2).encode() + b"\n"),),
        applied=applied,
        losses=(*constants_loss(calibration, temperature), *g_sensitivity_loss(calibration)),
        notes=(
            "put the entry into the device's own file, which has the cameras",
            "the device frame is the case; time offsets and the lever arm are written as zero",
        ),
    )


def read(content: bytes, *, label: str | None = None) -> Calibration:
    """The calibration of one IMU of Aria's file (the only one, or that of the label), in the device's
    frame."""
    said = json.loads(content).get("ImuCalibrations", [])
    chosen = [e for e in said if label in (None, e.get("Label"))]
    if len(chosen) != 1:
        labels = [e.get("Label") for e in said]
        raise ValueError(f"aria: {len(chosen)} IMUs for label {label!r}; the file has {labels}.")
    entry = chosen[0]
    where = f"aria: {entry.get('Label')}"
    w, xyz = entry["T_Device_Imu"]["UnitQuaternion"]
    device_from_imu = _matrix(numbers([w, *xyz], (4,), f"{where}: UnitQuaternion"))

    def one(kind: str, key: str):
        part = entry[key]
        matrix = numbers(part["Model"]["RectificationMatrix"], (3, 3), f"{where}: {key} matrix")
        bias = numbers(part["Bias"]["Offset"], (3,), f"{where}: {key} Offset")
        return triad(kind, matrix @ device_from_imu.T, bias, source=NAME)

    return imported(
        one("accel", "Accelerometer"),
        one("gyro", "Gyroscope"),
        device=str(entry.get("SerialNumber", "")),
    )


def _matrix(wxyz: Float[np.ndarray, "4"]) -> Float[np.ndarray, "3 3"]:
    from scipy.spatial.transform import Rotation

    return Rotation.from_quat(np.roll(wxyz, -1)).as_matrix()
