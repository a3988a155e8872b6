"""A calibration's matrices over temperature, as plain arrays for the foreign formats."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..calibration.calibration import Calibration
from ..calibration.over_rows import row_parameters
from ..physics.temperature import Constant
from ..storage.wrong_value import WrongValue
from .cubic import cubic_misfit, moves, nodes, ROUNDING


HELD = "outside the calibrated temperatures {name} holds the correction of the nearer end"  # they clamp
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
    accel = row_parameters(calibration.accel, temperature)
    gyro = row_parameters(calibration.gyro, temperature)
    identity, count = np.eye(3), len(temperature)
    spread = lambda x: np.broadcast_to(np.moveaxis(x, -1, 0), (count, *x.shape[:-1]))
    return Parameters(
        identity + spread(accel.matrix),
        spread(accel.bias),
        identity + spread(gyro.matrix),
        spread(gyro.bias),
        spread(gyro.further.reshape(3, 3, -1)) / float(calibration.gravity),
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

    Raises `WrongValue` where the one asked for is outside the calibrated range.
    """
    low, high = temperature_span(calibration)
    if asked is None:
        return 0.5 * (low + high)
    if calibration.temperature_range is not None and not low <= asked <= high:
        raise WrongValue(
            f"temperature = {asked:g} °C is outside the calibrated {low:g} to {high:g} °C."
        )
    return asked


def constants_loss(calibration: Calibration, temperature: float) -> tuple[str, ...]:
    """What a format of constants loses, in words."""
    if not any(moves(values) for values in _over_range(calibration)):
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
    """What a flight controller's axis by axis correction with a cubic bias loses of this calibration, in words."""
    p, losses = _over_range(calibration), []
    turned = [
        name
        for name, matrix in (("accelerometers'", p.accel_matrix), ("gyros'", p.gyro_matrix))
        if np.abs(matrix * (1.0 - np.eye(3))).max() > ROUNDING
    ]
    if turned:
        losses.append(f"the {' and '.join(turned)} misalignments")
    if np.abs(_diagonal(p.gyro_matrix) - 1.0).max() > ROUNDING:
        losses.append("the gyros' scale factors")
    if moves(_diagonal(p.accel_matrix)):
        losses.append("the change of the accelerometers' scale factors with temperature")
    left = [(cubic_misfit(p.accel_bias), "m/s²"), (cubic_misfit(p.gyro_bias), "rad/s")]
    if any(size for size, _ in left):
        sizes = " and ".join(f"{size:.2g} {unit}" for size, unit in left if size)
        losses.append(
            f"the part of the biases that no cubic in temperature follows (up to {sizes})"
        )
    return (*losses, *g_sensitivity_loss(calibration))


def _over_range(calibration: Calibration) -> Parameters:
    """The parameters at `nodes` of the calibration's range."""
    return parameters_over(calibration, nodes(*temperature_span(calibration)))


def _diagonal(
    matrix: Float[np.ndarray, "temperature 3 3"],
) -> Float[np.ndarray, "temperature 3"]:
    return np.diagonal(matrix, axis1=1, axis2=2)
