"""The error model of a magnetometer triad and its compensation, for one sample.

    m' = (E + S) m + b + c I

m is the field in the device's frame (T), m' what the triad reads, S the soft iron with the triad's own scale-factor
errors and misalignments, b the hard iron with the triad's own bias, and c I the field of a current I (A) in wires that
move with the device. The affine part is equation (1), its compensation equation (3).

**Reference:** Gebre-Egziabher, Elkaim, Powell, Parkinson, *Calibration of strapdown magnetometers in magnetic field
domain*, J. Aerospace Eng. 19 (2006) 87; Renaudin, Afzal, Lachapelle, *Complete triaxis magnetometer calibration in
the magnetic domain*, J. Sensors (2010) 967245.
"""

from jaxtyping import Float

from .._jax import Array, jnp
from .._records import Module
from .._typing import Mat3, Scalar, Vec3
from .error_model import AccelerometerErrors, compensate_accel, distort_accel
from .shapes import check_ends


class MagnetometerErrors(Module):
    """Parameters of a magnetometer triad at one temperature.

    Raises `ValueError` for other shapes.
    """

    bias: Vec3  # b, T: hard iron
    matrix: Mat3  # S: soft iron, scale-factor errors and misalignments
    current: Vec3  # c, T/A: field of the current

    def __check_init__(self):
        check_ends("MagnetometerErrors(bias=...)", self.bias, (3,))
        check_ends("MagnetometerErrors(matrix=...)", self.matrix, (3, 3))
        check_ends("MagnetometerErrors(current=...)", self.current, (3,))

    @staticmethod
    def zero() -> "MagnetometerErrors":
        """An ideal triad far from iron."""
        return MagnetometerErrors(jnp.zeros(3), jnp.zeros((3, 3)), jnp.zeros(3))


def distort_mag(
    errors: MagnetometerErrors, field: Vec3, current: Scalar | float = 0.0
) -> Float[Array, "3"]:
    """Outputs m' = (E + S) m + b + c I, T, in a field m, T, beside a current I, A.

    Raises `ValueError` for more than one sample, as its companion does.
    """
    return distort_accel(_affine(errors, current), field)


def compensate_mag(
    errors: MagnetometerErrors, output: Vec3, current: Scalar | float = 0.0
) -> Float[Array, "3"]:
    """The field m = (E + S)⁻¹ (m' − b − c I), T, from the outputs m', T, beside a current I, A.

    ```python
    import jax.numpy as jnp
    from inertiax.physics.magnetic_model import compensate_mag, MagnetometerErrors

    errors = MagnetometerErrors(jnp.array([1e-5, 0.0, 0.0]), 0.25 * jnp.eye(3), jnp.zeros(3))
    assert jnp.allclose(compensate_mag(errors, jnp.array([3e-5, 0.0, 0.0])), jnp.array([1.6e-5, 0.0, 0.0]))
    ```
    """
    return compensate_accel(_affine(errors, current), output)


def _affine(errors: MagnetometerErrors, current: Scalar | float) -> AccelerometerErrors:
    """At one current the model is the accelerometers': a bias and a matrix."""
    bias = jnp.asarray(errors.bias) + jnp.asarray(errors.current) * current
    return AccelerometerErrors(bias, errors.matrix)
