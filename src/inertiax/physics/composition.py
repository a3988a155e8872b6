"""Equation (6): two calibrations in succession are one calibration.

A calibration is an affine map from what an ideal triad would read to what the real one reads.
If stage 0 was estimated on raw outputs and stage 1 on the outputs that stage 0 compensated, then

    a' = M₀ (M₁ a + b₁) + b₀,   M = E + Γ,

so the pair equals the single calibration M = M₀ M₁, b = b₀ + M₀ b₁. These maps form a group:
`compose_*` is its product, `inverse_*` its inverse, `zero()` its identity.

The paper prints the bias line with M₀⁻¹ in place of M₀. That cannot follow from its own
substitution (its D line, from the same one, has no inverse); it is off by (M₀ − M₀⁻¹) b₁ ≈ 2 Γ₀ b₁.
Because b₁ → 0 the iteration reaches the same fixed point all the same. The printed form is kept
under its own name for study.
"""

from jaxtyping import Float

from .._jax import Array, jnp
from .._typing import Mat3, Scalar, Vec3
from .error_model import AccelerometerErrors, GyroErrors, solve3


def _compose_matrix(first: Mat3, second: Mat3) -> Float[Array, "3 3"]:
    # Γ = Γ₀ + Γ₁ + Γ₀ Γ₁, without the cancellation of (E + Γ₀)(E + Γ₁) − E.
    first, second = jnp.asarray(first), jnp.asarray(second)
    return first + second + first @ second


def _apply(matrix: Mat3, x: Array) -> Array:
    return x + jnp.asarray(matrix) @ x


def compose_accel(first: AccelerometerErrors, second: AccelerometerErrors) -> AccelerometerErrors:
    """Equation (6), exact: `second` was estimated on outputs compensated with `first`.

    Γ = Γ₁ + Γ₀ + Γ₀ Γ₁,  a⁰ = a⁰₀ + (E + Γ₀) a⁰₁.
    """
    return AccelerometerErrors(
        bias=first.bias + _apply(first.matrix, jnp.asarray(second.bias)),
        matrix=_compose_matrix(first.matrix, second.matrix),
    )


def compose_accel_as_printed(
    first: AccelerometerErrors, second: AccelerometerErrors
) -> AccelerometerErrors:
    """Equation (6) as printed: a⁰ = a⁰₀ + (E + Γ₀)⁻¹ a⁰₁. For study only (see the module)."""
    m0 = jnp.eye(3, dtype=jnp.asarray(first.matrix).dtype) + first.matrix
    return AccelerometerErrors(
        bias=first.bias + solve3(m0, jnp.asarray(second.bias)),
        matrix=_compose_matrix(first.matrix, second.matrix),
    )


def inverse_accel(errors: AccelerometerErrors) -> AccelerometerErrors:
    """The calibration that undoes `errors`: compose(errors, inverse) is the identity."""
    inverse = _inverse_matrix(errors.matrix)
    return AccelerometerErrors(bias=-_apply(inverse, jnp.asarray(errors.bias)), matrix=inverse)


def compose_gyro(first: GyroErrors, second: GyroErrors) -> GyroErrors:
    """Equation (6), exact, for stages that use the same (true) specific force in their D terms.

    Θ = Θ₁ + Θ₀ + Θ₀ Θ₁,  ν⁰ = ν⁰₀ + (E + Θ₀) ν⁰₁,  D = D₀ + (E + Θ₀) D₁.
    """
    return GyroErrors(
        bias=first.bias + _apply(first.matrix, jnp.asarray(second.bias)),
        matrix=_compose_matrix(first.matrix, second.matrix),
        g_sensitivity=first.g_sensitivity + _apply(first.matrix, jnp.asarray(second.g_sensitivity)),
    )


def compose_gyro_as_printed(first: GyroErrors, second: GyroErrors) -> GyroErrors:
    """Equation (6) as printed: the bias line with (E + Θ₀)⁻¹. For study only (see the module)."""
    exact = compose_gyro(first, second)
    m0 = jnp.eye(3, dtype=jnp.asarray(first.matrix).dtype) + first.matrix
    bias = first.bias + solve3(m0, jnp.asarray(second.bias))
    return GyroErrors(bias=bias, matrix=exact.matrix, g_sensitivity=exact.g_sensitivity)


def inverse_gyro(errors: GyroErrors) -> GyroErrors:
    """The calibration that undoes `errors` when both use the same specific force."""
    inverse = _inverse_matrix(errors.matrix)
    return GyroErrors(
        bias=-_apply(inverse, jnp.asarray(errors.bias)),
        matrix=inverse,
        g_sensitivity=-_apply(inverse, jnp.asarray(errors.g_sensitivity)),
    )


def compose_imu(
    first: tuple[AccelerometerErrors, GyroErrors],
    second: tuple[AccelerometerErrors, GyroErrors],
    gravity: Scalar | float,
) -> tuple[AccelerometerErrors, GyroErrors]:
    """Both triads at once, where each stage's D term uses that stage's own specific force.

    Then stage 0's g-sensitivity acts on a₀ = M₁ᵃ a + b₁ᵃ, the force as stage 0 compensated it, and

        D = D₀ (E + Γ₁) + (E + Θ₀) D₁,   ν⁰ = ν⁰₀ + (E + Θ₀) ν⁰₁ + D₀ a⁰₁ / g,

    the product of affine maps of the six readings together. With Γ₁ = 0 and a⁰₁ = 0 it is (6).
    `gravity` in m/s².
    """
    accel = compose_accel(first[0], second[0])
    gyro = compose_gyro(first[1], second[1])
    d0 = jnp.asarray(first[1].g_sensitivity)
    return accel, GyroErrors(
        bias=gyro.bias + d0 @ (jnp.asarray(second[0].bias) / gravity),
        matrix=gyro.matrix,
        g_sensitivity=gyro.g_sensitivity + d0 @ jnp.asarray(second[0].matrix),
    )


def _inverse_matrix(matrix: Mat3) -> Float[Array, "3 3"]:
    # (E + Γ)⁻¹ − E = −(E + Γ)⁻¹ Γ, which keeps its relative accuracy for small Γ.
    matrix = jnp.asarray(matrix)
    m = jnp.eye(3, dtype=matrix.dtype) + matrix
    return jnp.stack([-solve3(m, matrix[:, j]) for j in range(3)], axis=1)


def as_affine(bias: Vec3, matrix: Mat3) -> Float[Array, "4 4"]:
    """The homogeneous 4 × 4 matrix of x ↦ (E + matrix) x + bias; its product is the composition."""
    m = jnp.eye(3, dtype=jnp.asarray(matrix).dtype) + matrix
    top = jnp.concatenate([m, jnp.asarray(bias)[:, None]], axis=1)
    return jnp.concatenate([top, jnp.asarray([[0.0, 0.0, 0.0, 1.0]], top.dtype)], axis=0)
