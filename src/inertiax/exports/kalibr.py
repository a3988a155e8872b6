"""Kalibr's `imu.yaml`: its scale-misalignment model, true to measured, at one temperature.

Kalibr's model is a' = M C_i_b a_b + b and ω' = M_g C_gyro_b ω_b + A C_gyro_b a_b + b_g, with C_gyro_b =
C_gyro_i C_i_b and lower triangular M, M_g. A full E + Γ is M C_i_b, so the case frame is kept in `T_i_b`;
E + Θ = M_g C_gyro_b, and A = (D / g) C_gyro_bᵀ is not multiplied by M_g. Biases have no place in the
file: Kalibr and its readers estimate them as states. They stand in a comment.

**Reference:** Rehder et al., *Extending kalibr: calibrating the extrinsics of multiple IMUs and of
individual axes*, ICRA 2016; Kalibr's `IccSensors.py`.
"""

import numpy as np
from jaxtyping import Float

from ..calibration.calibration import Calibration
from ..storage.wrong_value import WrongValue
from .export import Export, OneTemperature
from .noise import stated_noise
from .parameters import chosen_temperature, constants_loss, parameters_at
from .triangular import lower_times_rotation


NAME = "kalibr"
TITLE = "Kalibr's imu.yaml (scale-misalignment model)"
SUFFIX = ".imu.yaml"
KEEPS = "full matrices, g-sensitivity, the case frame; one temperature"
LOSES = "biases (in a comment only), temperature dependence, uncertainties"

NOISE = {  # triad and term of IEEE Std 952 of each
    "accelerometer_noise_density": ("accel", "N"),
    "accelerometer_random_walk": ("accel", "K"),
    "gyroscope_noise_density": ("gyro", "N"),
    "gyroscope_random_walk": ("gyro", "K"),
}
RATE = "update_rate"
TOPIC = "rostopic"


class Settings(OneTemperature, frozen=True, kw_only=True):
    """Continuous-time noise, which Kalibr needs and a calibration does not know; from an Allan plot."""

    accelerometer_noise_density: float | None = None  # m/s²/√Hz
    accelerometer_random_walk: float | None = None  # m/s³/√Hz
    gyroscope_noise_density: float | None = None  # rad/s/√Hz
    gyroscope_random_walk: float | None = None  # rad/s²/√Hz
    update_rate: float = 100.0  # Hz
    rostopic: str = "/imu0"


def write(calibration: Calibration, settings: Settings) -> Export:
    """Kalibr's file of the parameters at `settings.temperature`, °C."""
    temperature = chosen_temperature(calibration, settings.temperature)
    p = parameters_at(calibration, temperature)
    m, body_to_imu = lower_times_rotation(p.accel_matrix)
    m_g, body_to_gyro = lower_times_rotation(p.gyro_matrix)
    a = p.gyro_by_force @ body_to_gyro.T
    transform = np.eye(4)
    transform[:3, :3] = body_to_imu
    noise = _noise_lines(settings)
    lines = [
        f"# inertiax, parameters at {temperature:g} degC; Kalibr estimates biases itself, these were:",
        f"# accelerometer bias {_row(p.accel_bias)} m/s^2",
        f"# gyroscope bias {_row(p.gyro_bias)} rad/s",
        "imu0:",
        *_block("  ", "T_i_b", transform),
        *(f"  {line}" for line in noise),
        "  model: scale-misalignment",
        "  time_offset: 0.0",
        "  accelerometers:",
        *_block("    ", "M", m),
        "  gyroscopes:",
        *_block("    ", "M", m_g),
        *_block("    ", "A", a),
        *_block("    ", "C_gyro_i", body_to_gyro @ body_to_imu.T),
    ]

    def applied(accel: np.ndarray, gyro: np.ndarray, _: np.ndarray):
        force = accel @ np.linalg.inv(m @ body_to_imu).T
        by_force = force @ (a @ body_to_gyro).T
        return force, (gyro - by_force) @ np.linalg.inv(m_g @ body_to_gyro).T

    return Export(
        files=(("", "\n".join(lines).encode() + b"\n"),),
        applied=applied,
        losses=(
            "biases: Kalibr and readers of its files estimate them as states (they are in a comment)",
            *constants_loss(calibration, temperature),
        ),
    )


def write_noise(settings: Settings) -> bytes:
    """Kalibr's input `imu.yaml` of noise, topic and rate alone, for data that are calibrated already.

    Raises `WrongValue` where a noise figure is missing or not above zero.
    """
    head = "# inertiax, noise alone: what Kalibr's --imu wants, and readers of an uncalibrated IMU"
    return "\n".join([head, *_noise_lines(settings)]).encode() + b"\n"


def _noise_lines(settings: Settings) -> list[str]:
    return [
        *(f"{key}: {value!r}" for key, value in stated_noise(NAME, NOISE, settings).items()),
        f"rostopic: {_quoted(settings.rostopic)}",
        f"update_rate: {float(settings.update_rate)!r}",
    ]


def _quoted(text: str) -> str:
    if not text.isprintable() or any(c in "\"'\\" for c in text):
        raise WrongValue(f"kalibr: rostopic {text!r} must be a plain topic name such as /imu0.")
    return f"'{text}'"


def _block(indent: str, key: str, matrix: Float[np.ndarray, "rows columns"]) -> list[str]:
    return [f"{indent}{key}:", *(f"{indent}- {_row(row)}" for row in matrix)]


def _row(numbers: Float[np.ndarray, " n"]) -> str:
    return "[" + ", ".join(repr(float(x)) for x in numbers) + "]"
