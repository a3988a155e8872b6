"""Nominal scales of common converters, and the middle of an unsigned range."""

import numpy as np
from jaxtyping import Float

from ..data.formats.columns import ACCEL_UNITS, GYRO_UNITS


G = ACCEL_UNITS["g"]
DEGREE = GYRO_UNITS["deg/s"]
PER_G_OF_HUNDREDTHS = 980.665  # counts per g where one is 0.01 m/s²: Bosch's BNO055
# Counts per g: InvenSense and Bosch (2 to 16 g in 16 bits), ST's 0.061 to 0.732 mg rounded onto them, ADXL345, MMA and
# LIS of 8 to 14 bits.
ACCEL_SCALES = (
    64.0, 128.0, 256.0, 512.0, PER_G_OF_HUNDREDTHS, 1024.0, 1365.0, 2048.0, 4096.0, 8192.0, 16384.0
)  # fmt: skip
# Counts per deg/s: InvenSense and Bosch (250 to 2000 deg/s in 16 bits), ITG-3200, ST's 4.375 to 70 mdps per count.
GYRO_SCALES = (262.4, 228.57, 131.0, 114.29, 65.5, 57.14, 32.8, 28.57, 16.4, 14.375, 14.29)
# Raw temperatures: °C = count / scale + zero.
TEMPERATURE_SCALES = (
    (340.0, 36.53, "MPU-6050"),
    (333.87, 21.0, "MPU-6500, MPU-9250"),
    (256.0, 25.0, "LSM6DSO"),
    (16.0, 25.0, "LSM6DS3"),
    (132.48, 25.0, "ICM-426xx"),
)


def whole(values: Float[np.ndarray, "time 3"]) -> bool:
    """Whether a triad's outputs are counts: whole numbers, and not small ones."""
    return bool(np.all(values == np.round(values))) and float(np.abs(values).max()) > 50.0


def middle(values: Float[np.ndarray, "time 3"]) -> float:
    """Half of the range of an unsigned converter whose counts these are; 0 where they are signed."""
    low, high = float(values.min()), float(values.max())
    if low < 0.0 or high < 100.0 or float(np.median(values)) < 0.3 * high:
        return 0.0
    return float(2 ** (int(np.ceil(np.log2(high + 1.0))) - 1))


def wraps(values: Float[np.ndarray, "time 3"]) -> bool:
    """Whether signed 16-bit readings were written as unsigned: 65535 stands for −1, and small motions go end to end.

    Taken as signed an eighth of the steps that are longer than half of the range are left, or fewer.
    """
    low, high = float(values.min()), float(values.max())
    if not whole(values) or low < 0.0 or not 60000.0 < high < 65536.0:
        return False
    signed = np.where(values >= 32768.0, values - 65536.0, values)
    long = lambda x: int(np.sum(np.abs(np.diff(x, axis=0)) > 32768.0))
    return long(values) >= 3 and 8 * long(signed) <= long(values)


def nearest(scale: float, nominal: tuple[float, ...], tolerance: float) -> float | None:
    """The nominal scale within a relative tolerance of a measured one."""
    best = min(nominal, key=lambda n: abs(np.log(scale / n)))
    return best if abs(scale / best - 1.0) < tolerance else None


def rounded(value: float) -> float:
    """Four digits: more are not in a first look."""
    return float(f"{value:.4g}")
