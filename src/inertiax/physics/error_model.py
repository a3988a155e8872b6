"""The error model, equation (1), and its compensation, equation (3), for one sample.

    a' = (E + Γ) a + a⁰                      accelerometers
    ω' = (E + Θ) ω + ν⁰ + D a / g            gyros

`distort` turns what an ideal triad would read into what the real one reads; `compensate` is its
exact inverse. In the paper's (3) the g-sensitivity term is printed with the *raw* accelerometer
output a' although (1) has the true a; the exact form is the default here, and the printed one is
kept under its own name for study (it leaves an error D (Γ a + a⁰) / g).
"""

from jaxtyping import Float

from .._jax import Array, jnp
from .._records import Module
from .._typing import Mat3, Scalar, Vec3
from .shapes import check_ends, check_one


class AccelerometerErrors(Module):
    """Parameters of an accelerometer triad at one temperature.

    Raises `ValueError` for other shapes.
    """

    bias: Vec3  # a⁰, m/s²
    matrix: Mat3  # Γ: scale-factor errors on the diagonal, misalignments (rad) off it

    def __check_init__(self):
        check_ends("AccelerometerErrors(bias=...)", self.bias, (3,))
        check_ends("AccelerometerErrors(matrix=...)", self.matrix, (3, 3))

    @staticmethod
    def zero() -> "AccelerometerErrors":
        """An ideal triad."""
        return AccelerometerErrors(jnp.zeros(3), jnp.zeros((3, 3)))


class GyroErrors(Module):
    """Parameters of a gyro triad at one temperature.

    Raises `ValueError` for other shapes.
    """

    bias: Vec3  # ν⁰, rad/s
    matrix: Mat3  # Θ: scale-factor errors on the diagonal, misalignments (rad) off it
    g_sensitivity: Mat3  # D, rad/s per g of specific force

    def __check_init__(self):
        check_ends("GyroErrors(bias=...)", self.bias, (3,))
        check_ends("GyroErrors(matrix=...)", self.matrix, (3, 3))
        check_ends("GyroErrors(g_sensitivity=...)", self.g_sensitivity, (3, 3))

    @staticmethod
    def zero() -> "GyroErrors":
        """An ideal triad."""
        return GyroErrors(jnp.zeros(3), jnp.zeros((3, 3)), jnp.zeros((3, 3)))


def solve3(matrix: Float[Array, "3 3"], vector: Float[Array, "3"]) -> Float[Array, "3"]:
    """Solve a 3 × 3 system by Cramer's rule.

    Written out in scalars: no LAPACK call, so it is quick under `vmap` and cannot take part in the
    thread-pool deadlock of some jaxlib versions; E + Γ is within a few percent of the identity (or
    a few times it, for raw counts), where Cramer's rule loses nothing.
    """
    c0, c1, c2 = matrix[:, 0], matrix[:, 1], matrix[:, 2]
    c12 = _cross(c1, c2)
    determinant = jnp.vdot(c0, c12)
    x = jnp.stack(
        [
            jnp.vdot(vector, c12),
            jnp.vdot(c0, _cross(vector, c2)),
            jnp.vdot(c0, _cross(c1, vector)),
        ]
    )
    return x / determinant


def _cross(a: Array, b: Array) -> Array:
    # `jnp.cross` gathers, which devices split over accelerators do not let it.
    return jnp.stack(
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    )


def _times(matrix: Mat3, vector: Float[Array, "3"]) -> Float[Array, "3"]:
    # Column by column: for many devices a compiler makes a slow loop of each small product of matrices.
    m = jnp.asarray(matrix)
    return m[:, 0] * vector[0] + m[:, 1] * vector[1] + m[:, 2] * vector[2]


def _identity_plus(matrix: Mat3) -> Float[Array, "3 3"]:
    matrix = jnp.asarray(matrix)
    return jnp.eye(3, dtype=matrix.dtype) + matrix


def distort_accel(errors: AccelerometerErrors, force: Vec3) -> Float[Array, "3"]:
    """Equation (1): accelerometer outputs a' = (E + Γ) a + a⁰, m/s², of a specific force a, m/s².

    Raises `ValueError` for more than one sample, as its three companions do.
    """
    check_one("distort_accel(errors, force)", force=force)
    force = jnp.asarray(force)
    return force + _times(errors.matrix, force) + errors.bias


def compensate_accel(errors: AccelerometerErrors, output: Vec3) -> Float[Array, "3"]:
    """Equation (3): specific force a = (E + Γ)⁻¹ (a' − a⁰), m/s², from the outputs a', m/s²."""
    check_one("compensate_accel(errors, output)", output=output)
    return solve3(_identity_plus(errors.matrix), jnp.asarray(output) - errors.bias)


def distort_gyro(
    errors: GyroErrors, rate: Vec3, force: Vec3, gravity: Scalar | float
) -> Float[Array, "3"]:
    """Equation (1): gyro outputs ω' = (E + Θ) ω + ν⁰ + D a / g, rad/s.

    `rate` is the absolute angular rate ω (rad/s), `force` the true specific force a (m/s²) and
    `gravity` the reference g (m/s²) that makes a / g dimensionless.
    """
    check_one("distort_gyro(errors, rate, force, gravity)", rate=rate, force=force)
    rate, by_force = jnp.asarray(rate), _times(errors.g_sensitivity, jnp.asarray(force) / gravity)
    return rate + _times(errors.matrix, rate) + errors.bias + by_force


def compensate_gyro(
    errors: GyroErrors, output: Vec3, force: Vec3, gravity: Scalar | float
) -> Float[Array, "3"]:
    """Equation (3), exact: ω = (E + Θ)⁻¹ (ω' − ν⁰ − D a / g), rad/s.

    `force` is the *compensated* specific force a (m/s²), which makes this the inverse of (1).
    """
    check_one("compensate_gyro(errors, output, force, gravity)", output=output, force=force)
    by_force = _times(errors.g_sensitivity, jnp.asarray(force) / gravity)
    return solve3(_identity_plus(errors.matrix), jnp.asarray(output) - errors.bias - by_force)


def compensate_gyro_as_printed(
    errors: GyroErrors, output: Vec3, accel_output: Vec3, gravity: Scalar | float
) -> Float[Array, "3"]:
    """Equation (3) as printed, with the raw accelerometer output a' in the D term. For study only:
    it leaves an error of (E + Θ)⁻¹ D (Γ a + a⁰) / g, rad/s."""
    return compensate_gyro(errors, output, accel_output, gravity)
