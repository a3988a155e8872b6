"""imu_tk's `.calib`: one text file a triad, x = T K (x' − B), at one temperature.

T is upper triangular with a unit diagonal for accelerometers, full with a unit diagonal for gyros, K
is diagonal. The output frame is therefore the accelerometers' own, its z axis along theirs.

**Reference:** Tedaldi, Pretto, Menegatti, *A robust and easy to implement method for IMU calibration
without external equipments*, ICRA 2014; the `imu_tk` library's files.
"""

from typing import Literal

import numpy as np
from jaxtyping import Float

from ..calibration.calibration import Calibration
from .export import Export, frame_note, OneTemperature
from .imported import calibration as imported, triad
from .parameters import chosen_temperature, constants_loss, g_sensitivity_loss, parameters_at
from .triangular import upper_times_rotation


NAME = "imu_tk"
TITLE = "imu_tk's .calib, one file for each triad (_acc, _gyro)"
SUFFIX = ".calib"
KEEPS = "bias, full matrices (in the accelerometers' frame); one temperature"
LOSES = "temperature dependence, g-sensitivity, the case frame, uncertainties"

Settings = OneTemperature


def write(calibration: Calibration, settings: OneTemperature) -> Export:
    """imu_tk's files of the parameters at `settings.temperature`, °C; of the triads there are."""
    temperature = chosen_temperature(calibration, settings.temperature)
    p = parameters_at(calibration, temperature)
    upper, frame = upper_times_rotation(p.accel_matrix)
    accel = _split(np.linalg.inv(upper)), p.accel_bias
    gyro = _split(frame @ np.linalg.inv(p.gyro_matrix)), p.gyro_bias
    files = []
    if calibration.accel is not None:
        files.append(("_acc", _text(*accel[0], accel[1])))
    if calibration.gyro is not None:
        files.append(("_gyro", _text(*gyro[0], gyro[1])))
    one = lambda x, triad: (x - triad[1]) @ (triad[0][0] @ np.diag(triad[0][1])).T
    return Export(
        files=tuple(files),
        applied=lambda a, w, _: (one(a, accel), one(w, gyro)),
        losses=(*constants_loss(calibration, temperature), *g_sensitivity_loss(calibration)),
        notes=frame_note(frame),
        frame=frame,
    )


def _split(
    matrix: Float[np.ndarray, "3 3"],
) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, "3"]]:
    """M = T K with ones on the diagonal of T."""
    scale = np.diag(matrix)
    return matrix / scale, scale.copy()


def _text(
    misalignment: Float[np.ndarray, "3 3"],
    scale: Float[np.ndarray, "3"],
    bias: Float[np.ndarray, "3"],
) -> bytes:
    row = lambda numbers: " ".join(repr(float(x)) for x in numbers)
    blocks = [map(row, misalignment), map(row, np.diag(scale)), map(row, bias[:, None])]
    return "\n\n".join("\n".join(block) for block in blocks).encode() + b"\n"


def read(content: bytes, *, kind: Literal["accel", "gyro"] = "accel") -> Calibration:
    """The calibration in one `.calib`; `kind` says of which triad, "accel" or "gyro".

    The numbers must take SI units to SI units; factors of raw counts (far from 1) are refused.
    """
    try:
        values = np.array(content.decode().split(), float)
    except ValueError:
        values = np.empty(0)
    if values.shape != (21,) or not np.isfinite(values).all():
        raise ValueError(
            "imu_tk: a .calib holds 21 numbers: 3 × 3 misalignment, 3 × 3 scale, 3 biases; found "
            f"{len(values)}."
        )
    matrix = values[:9].reshape(3, 3) @ values[9:18].reshape(3, 3)
    if abs(np.linalg.det(matrix)) < 0.1 or abs(np.linalg.det(matrix)) > 10:
        raise ValueError(
            f"imu_tk: scales {np.diag(values[9:18].reshape(3, 3)).tolist()} convert raw counts; a file "
            "made from data in m/s² or rad/s is needed."
        )
    one = triad(kind, np.linalg.inv(matrix), values[18:], source=NAME)
    return imported(one if kind == "accel" else None, one if kind == "gyro" else None)
