"""A magnetometer calibration as flight controllers hold it: offsets, a symmetric matrix, a current's field.

They compute M (m' − b − c I) with M symmetric. Of our (E + S)⁻¹ = R M that keeps the magnitude of the field exactly,
and leaves the rotation R to the accelerometers out.
"""

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..calibration.magnetometers import MagnetometerCalibration
from ..calibration.over_rows import row_parameters
from ..physics.temperature import CubicSpline, Polynomial
from .cubic import moves, ROUNDING


GAUSS = 1e4  # in a T


class FieldErrors(NamedTuple):
    """The parameters over temperatures, SI."""

    bias: Float[np.ndarray, "*temperature 3"]
    matrix: Float[np.ndarray, "*temperature 3 3"]
    current: Float[np.ndarray, "*temperature 3"]


def field_errors(
    mag: MagnetometerCalibration, temperature: Float[np.ndarray, " temperature"]
) -> FieldErrors:
    """The parameters at each temperature, °C."""
    own = row_parameters(mag.triad, temperature)
    spread = lambda x: np.broadcast_to(np.moveaxis(x, -1, 0), (len(temperature), *x.shape[:-1]))
    return FieldErrors(spread(own.bias), spread(own.matrix), spread(own.further[:3]))


class SymmetricField(NamedTuple):
    """What a flight controller holds, over temperatures."""

    bias: Float[np.ndarray, "temperature 3"]  # b, T
    scale: Float[np.ndarray, "3 3"]  # M, in the middle of the temperatures
    current: Float[np.ndarray, "3"]  # c, T/A
    turned: float  # rad, the angle of R
    losses: tuple[str, ...]  # in words


def field_span(mag: MagnetometerCalibration, low: float, high: float) -> tuple[float, float]:
    """Temperatures that the magnetometers' curve was fitted over, °C, within those of the calibration.

    A calibration joined with a warm-up covers more than its magnetometers were turned at.
    """
    basis = mag.triad.curve.basis
    if isinstance(basis, Polynomial):
        own = [float(basis.low), float(basis.high)]
    elif isinstance(basis, CubicSpline):
        own = [float(basis.knots[0]), float(basis.knots[-1])]
    else:
        return low, high
    first, last = np.clip(own, low, high)
    return float(first), float(last)


def symmetric_field(
    mag: MagnetometerCalibration, temperature: Float[np.ndarray, " temperature"]
) -> SymmetricField:
    """The parameters at each temperature, °C, with the matrix at their middle."""
    errors = field_errors(mag, temperature)
    middle = 0.5 * float(temperature.min() + temperature.max())
    middle = FieldErrors(*(x[0] for x in field_errors(mag, np.array([middle]))))
    left, sizes, right = np.linalg.svd(np.linalg.inv(np.eye(3) + middle.matrix))
    cosine = 0.5 * (float(np.trace(left @ right)) - 1.0)
    turned = math.acos(min(max(cosine, -1.0), 1.0))
    losses = []
    if mag.frame == "accel" and turned > ROUNDING:
        losses.append(
            f"the magnetometers' rotation of {math.degrees(turned):.2g}° against the accelerometers"
        )
    if moves(np.eye(3) + errors.matrix):
        losses.append("temperature dependence of the soft iron")
    if moves(errors.current):
        losses.append("temperature dependence of the current's field")
    return SymmetricField(
        errors.bias,
        right.T @ np.diag(sizes) @ right,
        middle.current,
        turned,
        tuple(losses),
    )
