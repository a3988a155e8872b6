"""Basalt's calibration JSON: (I + S) x' − b, lower triangular S for accelerometers, at one temperature.

`calib_accel_bias` is b (3), column 0 of S (3), then S₁₁, S₂₁, S₂₂; `calib_gyro_bias` is b (3) and all of S
by columns. The output frame is the accelerometers' own, its x axis along theirs.

**Reference:** Basalt's `CalibAccelBias` and `CalibGyroBias` (basalt-headers, `calib_bias.hpp`).
"""

import json

import numpy as np

from ..calibration.calibration import Calibration
from .export import Export, frame_note, OneTemperature
from .imported import calibration as imported, numbers, triad
from .noise import stated_noise
from .parameters import chosen_temperature, constants_loss, g_sensitivity_loss, parameters_at
from .triangular import lower_times_rotation


NAME = "basalt"
TITLE = "Basalt's calibration JSON (IMU part)"
SUFFIX = ".basalt.json"
KEEPS = "bias, full matrices (in the accelerometers' frame); one temperature"
LOSES = "temperature dependence, g-sensitivity, the case frame, uncertainties"

NOISE = {  # triad and term of IEEE Std 952 of each
    "accel_noise_std": ("accel", "N"),
    "gyro_noise_std": ("gyro", "N"),
    "accel_bias_std": ("accel", "K"),
    "gyro_bias_std": ("gyro", "K"),
}
RATE = "imu_update_rate"


class Settings(OneTemperature, frozen=True, kw_only=True):
    """Continuous-time noise, which Basalt needs and a calibration does not know; from an Allan plot."""

    accel_noise_std: float | None = None  # m/s²/√Hz
    gyro_noise_std: float | None = None  # rad/s/√Hz
    accel_bias_std: float | None = None  # m/s³/√Hz
    gyro_bias_std: float | None = None  # rad/s²/√Hz
    imu_update_rate: float = 200.0  # Hz


def write(calibration: Calibration, settings: Settings) -> Export:
    """Basalt's file of the parameters at `settings.temperature`, °C; the cameras' part is empty."""
    temperature = chosen_temperature(calibration, settings.temperature)
    p = parameters_at(calibration, temperature)
    lower, frame = lower_times_rotation(p.accel_matrix)
    accel = np.linalg.inv(lower)
    gyro = frame @ np.linalg.inv(p.gyro_matrix)
    accel_bias, gyro_bias = accel @ p.accel_bias, gyro @ p.gyro_bias
    s, s_g = accel - np.eye(3), gyro - np.eye(3)
    noise = {key: [value] * 3 for key, value in stated_noise(NAME, NOISE, settings).items()}
    value = {
        "T_imu_cam": [],
        "intrinsics": [],
        "resolution": [],
        "calib_accel_bias": [*accel_bias, *s[:, 0], s[1, 1], s[2, 1], s[2, 2]],
        "calib_gyro_bias": [*gyro_bias, *s_g.T.reshape(-1)],
        "imu_update_rate": settings.imu_update_rate,
        **noise,
        "cam_time_offset_ns": 0,
        "vignette": [],
    }
    return Export(
        files=(("", json.dumps({"value0": value}, indent=4).encode() + b"\n"),),
        applied=lambda a, w, _: (a @ accel.T - accel_bias, w @ gyro.T - gyro_bias),
        losses=(*constants_loss(calibration, temperature), *g_sensitivity_loss(calibration)),
        notes=("copy the IMU's keys into the file that has the cameras", *frame_note(frame)),
        frame=frame,
    )


def read(content: bytes) -> Calibration:
    """The calibration in Basalt's file, in Basalt's IMU frame."""
    said = json.loads(content)
    said = said.get("value0", said)
    a = numbers(said.get("calib_accel_bias"), (9,), "basalt: calib_accel_bias")
    g = numbers(said.get("calib_gyro_bias"), (12,), "basalt: calib_gyro_bias")
    s = np.array([[a[3], 0, 0], [a[4], a[6], 0], [a[5], a[7], a[8]]])
    one = lambda kind, s, b: triad(
        kind, np.linalg.inv(np.eye(3) + s), np.linalg.solve(np.eye(3) + s, b), source=NAME
    )
    return imported(one("accel", s, a[:3]), one("gyro", g[3:].reshape(3, 3).T, g[:3]))
