"""A calibration's matrices over temperature, as plain arrays for the foreign formats."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ..calibration.calibration import Calibration
from ..physics.temperature import Constant


NOMINAL_TEMPERATURE = 20.0  # °C, where a calibration has no temperatures; nothing depends on it


class Parameters(NamedTuple):
    """a' = accel_matrix a + accel_bias; ω' = gyro_matrix ω + gyro_bias + gyro_by_force a."""

    accel_matrix: Float[np.ndarray, "*temperature 3 3"]  # E + Γ
    accel_bias: Float[np.ndarray, "*temperature 3"]  # m/s²
    gyro_matrix: Float[np.ndarray, "*temperature 3 3"]  # E + Θ
    gyro_bias: Float[np.ndarray, "*temperature 3"]  # rad/s
    gyro_by_force: Float[np.ndarray, "*temperature 3 3"]  # D / g, rad/s per m/s²


def parameters_over(
    calibration: Calibration, temperature: Float[np.ndarray, " temperature"]
) -> Parameters:
    """The parameters at each temperature, °C; an ideal triad where one is not calibrated."""
    t = jnp.asarray(temperature, float)
    accel = jax.vmap(calibration.accel_errors)(t)
    gyro = jax.vmap(calibration.gyro_errors)(t)
    identity = np.eye(3)
    spread = lambda x, shape: np.broadcast_to(np.asarray(x, float), (len(temperature), *shape))
    return Parameters(
        identity + spread(accel.matrix, (3, 3)),
        spread(accel.bias, (3,)),
        identity + spread(gyro.matrix, (3, 3)),
        spread(gyro.bias, (3,)),
        spread(gyro.g_sensitivity, (3, 3)) / float(calibration.gravity),
    )


def parameters_at(calibration: Calibration, temperature: float) -> Parameters:
    """The parameters at one temperature, °C."""
    return Parameters(*(x[0] for x in parameters_over(calibration, np.array([temperature]))))


def varies(calibration: Calibration) -> bool:
    """Whether any parameter depends on temperature."""
    triads = (calibration.accel, calibration.gyro)
    return any(t is not None and not isinstance(t.curve.basis, Constant) for t in triads)


def temperature_span(calibration: Calibration) -> tuple[float, float]:
    """Temperatures over which the calibration holds, °C; one nominal value where there are none.

    Raises `ValueError` for a calibration that depends on temperature and does not say its range.
    """
    if calibration.temperature_range is not None:
        low, high = calibration.temperature_range  # leaves: arrays, NumPy's numbers or floats
        return float(low), float(high)
    if varies(calibration):
        raise ValueError(
            "the calibration depends on temperature but has no temperature_range; write the range "
            "that its data covered, [low, high] in °C."
        )
    return NOMINAL_TEMPERATURE, NOMINAL_TEMPERATURE


def chosen_temperature(calibration: Calibration, asked: float | None) -> float:
    """The temperature for a format of constants, °C: the one asked for, or the middle of the range.

    Raises `ValueError` where the one asked for is outside the calibrated range.
    """
    low, high = temperature_span(calibration)
    if asked is None:
        return 0.5 * (low + high)
    if calibration.temperature_range is not None and not low <= asked <= high:
        raise ValueError(
            f"temperature = {asked:g} °C is outside the calibrated {low:g} to {high:g} °C."
        )
    return asked


def constants_loss(calibration: Calibration, temperature: float) -> tuple[str, ...]:
    """What a format of constants loses, in words."""
    if not varies(calibration):
        return ()
    return (f"dependence on temperature: the parameters are those at {temperature:g} °C",)


def has_g_sensitivity(calibration: Calibration) -> bool:
    """Whether the gyros' matrix D is part of the calibration."""
    gyro = calibration.gyro
    return gyro is not None and any("g_sensitivity" in name for name in gyro.names)


def g_sensitivity_loss(calibration: Calibration) -> tuple[str, ...]:
    """What a format without the matrix D loses, in words."""
    return ("the gyros' g-sensitivity",) if has_g_sensitivity(calibration) else ()


def axis_by_axis_loss(calibration: Calibration) -> tuple[str, ...]:
    """What a flight controller's axis by axis correction with a cubic bias loses, in words."""
    thermal = (
        "temperature dependence of the scale factors",
        "what a cubic bias in temperature cannot follow",
    )
    return (
        "misalignments, and the gyros' scale factors",
        *(thermal if varies(calibration) else ()),
        *g_sensitivity_loss(calibration),
    )
