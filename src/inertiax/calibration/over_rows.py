"""Parameters and compensation of many samples at once, by NumPy.

What `Calibration.__call__` (without named effects) and `MagnetometerCalibration.__call__` compute of one sample under
JAX, for the rows of a log: nothing is compiled. Components stand along the first axis of every array, so that NumPy
runs over long rows, and parameters that do not depend on temperature have one column.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..physics.temperature import Constant, Curve
from .calibration import Calibration, TriadCalibration
from .magnetometers import MagnetometerCalibration
from .triad import refuse_stacked, slot


class RowParameters(NamedTuple):
    """A triad's parameters at temperatures, or one column where they depend on none; zero where not fitted."""

    bias: Float[np.ndarray, "3 *#row"]
    matrix: Float[np.ndarray, "3 3 *#row"]  # without the identity
    further: Float[np.ndarray, "9 *#row"]  # D row by row, or a current's field and zeros


def row_parameters(
    triad: TriadCalibration | None, temperature: Float[np.ndarray, " row"]
) -> RowParameters:
    """`TriadCalibration.parameters` at many temperatures, °C; an ideal triad's of `None`.

    Raises `ValueError` for stacked devices.
    """
    if triad is None:
        return RowParameters(np.zeros((3, 1)), np.zeros((3, 3, 1)), np.zeros((9, 1)))
    refuse_stacked((triad,), "row_parameters(triad, temperature)")
    return curve_parameters(triad.curve, triad.names, temperature)


def curve_parameters(
    curve: Curve, names: Sequence[str], temperature: Float[np.ndarray, " row"]
) -> RowParameters:
    """Parameters of these names over temperature at many temperatures, °C."""
    basis, coefficients = curve.basis, np.asarray(curve.coefficients, float)
    at = np.zeros(1) if isinstance(basis, Constant) else np.asarray(temperature, float)
    values = np.zeros((21, len(at)))
    values[[slot(name) for name in names]] = coefficients.T @ basis.rows(at).T
    return RowParameters(values[:3], values[3:12].reshape(3, 3, -1), values[12:])


def compensated_rows(
    calibration: Calibration,
    accel: Float[np.ndarray, "row 3"],
    gyro: Float[np.ndarray, "row 3"],
    temperature: Float[np.ndarray, " row"],
) -> tuple[Float[np.ndarray, "row 3"], Float[np.ndarray, "row 3"]]:
    """Equation (3) of outputs (m/s², rad/s, °C): specific force (m/s²) and rate (rad/s), without named effects.

    Raises `ValueError` for stacked devices.

    ```python
    import numpy as np
    from inertiax.calibration.calibration import Calibration
    from inertiax.calibration.over_rows import compensated_rows

    force, rate = compensated_rows(Calibration(9.81), np.ones((2, 3)), np.zeros((2, 3)), np.full(2, 20.0))
    assert np.array_equal(force, np.ones((2, 3))) and np.array_equal(rate, np.zeros((2, 3)))
    ```
    """
    own = row_parameters(calibration.accel, temperature)
    force = solved(own.matrix, np.asarray(accel, float).T - own.bias)
    own = row_parameters(calibration.gyro, temperature)
    d = own.further.reshape(3, 3, -1) / float(calibration.gravity)
    by_force = times(d, force) if d.any() else 0.0
    rate = solved(own.matrix, np.asarray(gyro, float).T - own.bias - by_force)
    return np.ascontiguousarray(force.T), np.ascontiguousarray(rate.T)


def compensated_field_rows(
    mag: MagnetometerCalibration,
    outputs: Float[np.ndarray, "row 3"],
    temperature: Float[np.ndarray, " row"],
    current: Float[np.ndarray, " row"],
) -> Float[np.ndarray, "row 3"]:
    """The field (E + S)⁻¹ (m' − b − c I), T, of outputs (T) at temperatures (°C) beside currents (A).

    Raises `ValueError` for stacked devices.
    """
    own = row_parameters(mag.triad, temperature)
    left = np.asarray(outputs, float).T - own.bias - own.further[:3] * current
    return np.ascontiguousarray(solved(own.matrix, left).T)


def distorted_rows(
    calibration: Calibration,
    force: Float[np.ndarray, "row 3"],
    rate: Float[np.ndarray, "row 3"],
    temperature: Float[np.ndarray, " row"],
) -> tuple[Float[np.ndarray, "row 3"], Float[np.ndarray, "row 3"]]:
    """Equation (1) of specific force (m/s²), rate (rad/s) and temperature (°C): outputs (m/s², rad/s), without named
    effects; the inverse of `compensated_rows`.

    Raises `ValueError` for stacked devices.
    """
    a, w = np.asarray(force, float).T, np.asarray(rate, float).T
    own = row_parameters(calibration.accel, temperature)
    accel = a + times(own.matrix, a) + own.bias
    own = row_parameters(calibration.gyro, temperature)
    d = own.further.reshape(3, 3, -1) / float(calibration.gravity)
    gyro = w + times(own.matrix, w) + own.bias + (times(d, a) if d.any() else 0.0)
    return np.ascontiguousarray(accel.T), np.ascontiguousarray(gyro.T)


def solved(
    matrix: Float[np.ndarray, "3 3 *#row"], vector: Float[np.ndarray, "3 row"]
) -> Float[np.ndarray, "3 row"]:
    """(E + matrix)⁻¹ vector by Cramer's rule, as `error_model.solve3`."""
    a, b, c = np.moveaxis(matrix + np.eye(3)[:, :, None], 1, 0)  # columns
    adjugate = np.stack([_cross(b, c), _cross(c, a), _cross(a, b)])
    return times(adjugate / np.sum(a * adjugate[0], axis=0), vector)


def _cross(
    a: Float[np.ndarray, "3 *#row"], b: Float[np.ndarray, "3 *#row"]
) -> Float[np.ndarray, "3 *#row"]:
    return np.stack(
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    )


def times(
    matrix: Float[np.ndarray, "3 3 *#row"], vector: Float[np.ndarray, "3 row"]
) -> Float[np.ndarray, "3 row"]:
    """Products of matrices and vectors, row by row."""
    return matrix[:, 0] * vector[0] + matrix[:, 1] * vector[1] + matrix[:, 2] * vector[2]
