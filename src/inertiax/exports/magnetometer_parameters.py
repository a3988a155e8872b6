"""A magnetometer calibration as flight controllers hold it: offsets, a symmetric matrix, a current's field.

They compute M (m' − b − c I) with M symmetric. Of our (E + S)⁻¹ = R M that keeps the magnitude of the field exactly,
and leaves the rotation R to the accelerometers out.
"""

import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ..calibration.magnetometers import MagnetometerCalibration
from ..physics.temperature import CubicSpline, Polynomial
from .cubic import moves, ROUNDING


GAUSS = 1e4  # in a T


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
    errors = jax.vmap(mag.errors)(jnp.asarray(temperature, float))
    middle = mag.errors(0.5 * float(temperature.min() + temperature.max()))
    left, sizes, right = np.linalg.svd(np.linalg.inv(np.eye(3) + np.asarray(middle.matrix)))
    cosine = 0.5 * (float(np.trace(left @ right)) - 1.0)
    turned = math.acos(min(max(cosine, -1.0), 1.0))
    losses = []
    if mag.frame == "accel" and turned > ROUNDING:
        losses.append(
            f"the magnetometers' rotation of {math.degrees(turned):.2g}° against the accelerometers"
        )
    if moves(np.eye(3) + np.asarray(errors.matrix)):
        losses.append("temperature dependence of the soft iron")
    if moves(np.asarray(errors.current)):
        losses.append("temperature dependence of the current's field")
    return SymmetricField(
        np.asarray(errors.bias, float),
        right.T @ np.diag(sizes) @ right,
        np.asarray(middle.current, float),
        turned,
        tuple(losses),
    )
