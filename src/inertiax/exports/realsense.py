"""RealSense's `calibration.json`, as `rs-imu-calibration` writes it: S x' − bias, at one temperature.

`scale_and_alignment` holds S by columns: the tool solves for X in [x', −1] X and writes X row by row. Its
axes are those of the depth camera, so calibrate data in that frame.

**Reference:** librealsense, `rs-imu-calibration.py` and `motion-transform.cpp`.
"""

import json

import numpy as np

from ..calibration.calibration import Calibration
from .export import Export, OneTemperature
from .imported import calibration as imported, numbers, triad
from .parameters import chosen_temperature, constants_loss, g_sensitivity_loss, parameters_at


NAME = "realsense"
TITLE = "RealSense's calibration.json"
SUFFIX = ".realsense.json"
KEEPS = "bias, full matrices; one temperature"
LOSES = "temperature dependence, g-sensitivity, uncertainties"


class Settings(OneTemperature, frozen=True, kw_only=True):
    """`device_type` is the camera's name in the file."""

    device_type: str = "D435i"


def write(calibration: Calibration, settings: Settings) -> Export:
    """RealSense's file of the parameters at `settings.temperature`, °C."""
    temperature = chosen_temperature(calibration, settings.temperature)
    p = parameters_at(calibration, temperature)
    accel, gyro = np.linalg.inv(p.accel_matrix), np.linalg.inv(p.gyro_matrix)
    accel_bias, gyro_bias = accel @ p.accel_bias, gyro @ p.gyro_bias
    part = lambda s, b: {"bias": b.tolist(), "scale_and_alignment": s.T.reshape(-1).tolist()}
    content = {
        "device_type": settings.device_type,
        "imus": [{"accelerometer": part(accel, accel_bias), "gyroscope": part(gyro, gyro_bias)}],
    }
    return Export(
        files=(("", json.dumps(content, indent=4, sort_keys=True).encode() + b"\n"),),
        applied=lambda a, w, _: (a @ accel.T - accel_bias, w @ gyro.T - gyro_bias),
        losses=(*constants_loss(calibration, temperature), *g_sensitivity_loss(calibration)),
        notes=("axes must be those of the depth camera, as the librealsense tools give them",),
    )


def read(content: bytes) -> Calibration:
    """The calibration in RealSense's file."""
    said = json.loads(content)
    imus = said.get("imus", [])
    if len(imus) != 1:
        raise ValueError(f"realsense: 'imus' must list one IMU; found {len(imus)}.")

    def one(kind: str, key: str):
        part = imus[0].get(key, {})
        s = numbers(part.get("scale_and_alignment"), (9,), f"realsense: {key} scale_and_alignment")
        bias = numbers(part.get("bias"), (3,), f"realsense: {key} bias")
        inverse = np.linalg.inv(s.reshape(3, 3).T)
        return triad(kind, inverse, inverse @ bias, source=NAME)

    return imported(one("accel", "accelerometer"), one("gyro", "gyroscope"))
