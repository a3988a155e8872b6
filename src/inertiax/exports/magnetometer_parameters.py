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
from ..physics.temperature import Constant


GAUSS = 1e4  # in a T


class SymmetricField(NamedTuple):
    """What a flight controller holds, over temperatures."""

    bias: Float[np.ndarray, "temperature 3"]  # b, T
    scale: Float[np.ndarray, "3 3"]  # M, in the middle of the temperatures
    current: Float[np.ndarray, "3"]  # c, T/A
    turned: float  # rad, the angle of R
    losses: tuple[str, ...]  # in words


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
    if mag.frame == "accel":
        losses.append(
            f"the magnetometers' rotation of {math.degrees(turned):.2g}° against the accelerometers"
        )
    if not isinstance(mag.triad.curve.basis, Constant):
        losses.append("temperature dependence of the soft iron")
    return SymmetricField(
        np.asarray(errors.bias, float),
        right.T @ np.diag(sizes) @ right,
        np.asarray(middle.current, float),
        turned,
        tuple(losses),
    )
