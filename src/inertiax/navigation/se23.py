"""The group SE₂(3): attitude, velocity and position as one element; exponential, logarithm, Jacobians.

An element X = (R, v, p) is the 5 × 5 matrix [[R, v, p], [0, 1, 0], [0, 0, 1]]; its vector ξ = (φ, ν, ρ) holds a
rotation (rad), a velocity (m/s) and a position (m). With J the left Jacobian of SO(3),

    exp ξ = (exp φ, J(φ) ν, J(φ) ρ),     Ad_X = [[R, 0, 0], [v× R, R, 0], [p× R, 0, R]]
    exp(ξ + δ) ≈ exp(J_l(ξ) δ) exp ξ ≈ exp ξ exp(J_r(ξ) δ),     J_r(ξ) = J_l(−ξ)

All coefficients are series below 1 rad and closed forms above it, so that values keep their precision in
single precision too, and gradients are finite at zero.

**References:** Barrau and Bonnabel, "The invariant extended Kalman filter as a stable observer", IEEE TAC 62
(2017) 1797-1812; Barfoot, *State Estimation for Robotics*, Cambridge 2017, section 7.1.5 and equation (7.86).
"""

from math import factorial

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._typing import AnyArray, Vec3
from ..physics import rotation


# The largest term left out of each series below, at 1 rad, is under 1e-17.
_TERMS = 9
_SINE_2 = [(-1) ** n / factorial(2 * n + 2) for n in range(_TERMS)]  # (1 − cos θ)/θ²
_SINE_3 = [(-1) ** n / factorial(2 * n + 3) for n in range(_TERMS)]  # (θ − sin θ)/θ³
_SINE_4 = [(-1) ** n / factorial(2 * n + 4) for n in range(_TERMS)]  # (θ²/2 + cos θ − 1)/θ⁴
# (2θ − 3 sin θ + θ cos θ)/(2θ⁵)
_SINE_5 = [(-1) ** n * (n + 1) / factorial(2 * n + 5) for n in range(_TERMS)]
# (1 − (θ/2) cot(θ/2))/θ² = Σ |B_2n| θ^(2n−2)/(2n)!, with Bernoulli's numbers.
_BERNOULLI = [1 / 6, 1 / 30, 1 / 42, 1 / 30, 5 / 66, 691 / 2730, 7 / 6, 3617 / 510, 43867 / 798]
_COTANGENT = [b / factorial(2 * n + 2) for n, b in enumerate(_BERNOULLI)]


class ExtendedPose(eqx.Module):
    """An element of SE₂(3): case-to-level attitude, velocity and position; leading axes are times."""

    attitude: Float[AnyArray, "*time 3 3"]
    velocity: Float[AnyArray, "*time 3"]  # m/s
    position: Float[AnyArray, "*time 3"]  # m

    def matrix(self) -> Float[Array, "5 5"]:
        """The element as a 5 × 5 matrix; the group's product is the matrices'."""
        top = jnp.column_stack([jnp.asarray(self.attitude), self.velocity, self.position])
        return jnp.concatenate([top, jnp.eye(5, dtype=top.dtype)[3:]])


def _angle(vector: Array) -> tuple[Array, Array, Array]:
    """Square of the angle, whether it is below 1 rad, and the angle (1 there, for the gradient's sake)."""
    square = jnp.vdot(vector, vector)
    small = square < 1.0
    return square, small, jnp.sqrt(jnp.where(small, jnp.ones_like(square), square))


def _series(coefficients: list[float], square: Array) -> Array:
    value = jnp.full_like(square, coefficients[-1])
    for c in reversed(coefficients[:-1]):
        value = value * square + c
    return value


def so3_left_jacobian(vector: Vec3) -> Float[Array, "3 3"]:
    """J(φ) = E + (1 − cos θ)/θ² φ× + (θ − sin θ)/θ³ φ×², for a rotation vector φ (rad), θ = |φ|."""
    v = jnp.asarray(vector)
    square, small, theta = _angle(v)
    second = jnp.where(small, _series(_SINE_2, square), 2.0 * jnp.sin(0.5 * theta) ** 2 / theta**2)
    third = jnp.where(small, _series(_SINE_3, square), (theta - jnp.sin(theta)) / theta**3)
    cross = rotation.skew(v)
    return jnp.eye(3, dtype=v.dtype) + second * cross + third * (cross @ cross)


def so3_left_jacobian_inverse(vector: Vec3) -> Float[Array, "3 3"]:
    """J(φ)⁻¹ = E − ½ φ× + (1 − (θ/2) cot(θ/2))/θ² φ×², for |φ| below 2π rad."""
    v = jnp.asarray(vector)
    square, small, theta = _angle(v)
    closed = (1.0 - 0.5 * theta / jnp.tan(0.5 * theta)) / theta**2
    second = jnp.where(small, _series(_COTANGENT, square), closed)
    cross = rotation.skew(v)
    return jnp.eye(3, dtype=v.dtype) - 0.5 * cross + second * (cross @ cross)


def _coupling(phi: Array, nu: Array) -> Float[Array, "3 3"]:
    """Q(φ, ν), the lower block of the left Jacobian: Barfoot's equation (7.86b)."""
    square, small, theta = _angle(phi)
    sine, cosine = jnp.sin(theta), jnp.cos(theta)
    third = jnp.where(small, _series(_SINE_3, square), (theta - sine) / theta**3)
    fourth = jnp.where(small, _series(_SINE_4, square), (0.5 * theta**2 + cosine - 1.0) / theta**4)
    closed = 0.5 * (2.0 * theta - 3.0 * sine + theta * cosine) / theta**5
    fifth = jnp.where(small, _series(_SINE_5, square), closed)
    p, n = rotation.skew(phi), rotation.skew(nu)
    pn, np_, pp = p @ n, n @ p, p @ p
    pnp = pn @ p
    return (
        0.5 * n
        + third * (pn + np_ + pnp)
        + fourth * (pp @ n + n @ pp - 3.0 * pnp)
        + fifth * (pnp @ p + p @ pnp)
    )


def _blocks(diagonal: Array, velocity: Array, position: Array) -> Float[Array, "9 9"]:
    """[[a, 0, 0], [b, a, 0], [c, 0, a]]: the form of adjoints and Jacobians."""
    o = jnp.zeros((3, 3), diagonal.dtype)
    return jnp.block([[diagonal, o, o], [velocity, diagonal, o], [position, o, diagonal]])


def exp(xi: Float[AnyArray, "9"]) -> ExtendedPose:
    """The element of a vector ξ = (φ, ν, ρ): rad, m/s, m."""
    xi = jnp.asarray(xi)
    jacobian = so3_left_jacobian(xi[:3])
    return ExtendedPose(rotation.exp(xi[:3]), jacobian @ xi[3:6], jacobian @ xi[6:])


def log(pose: ExtendedPose) -> Float[Array, "9"]:
    """The vector of an element turned by less than π; the inverse of `exp`."""
    phi = rotation.log(jnp.asarray(pose.attitude))
    inverse = so3_left_jacobian_inverse(phi)
    return jnp.concatenate(
        [phi, inverse @ jnp.asarray(pose.velocity), inverse @ jnp.asarray(pose.position)]
    )


def compose(left: ExtendedPose, right: ExtendedPose) -> ExtendedPose:
    """The product of two elements: (R₁R₂, v₁ + R₁v₂, p₁ + R₁p₂)."""
    turn = jnp.asarray(left.attitude)
    return ExtendedPose(
        turn @ jnp.asarray(right.attitude),
        left.velocity + turn @ jnp.asarray(right.velocity),
        left.position + turn @ jnp.asarray(right.position),
    )


def inverse(pose: ExtendedPose) -> ExtendedPose:
    """The inverse element: (Rᵀ, −Rᵀv, −Rᵀp)."""
    turn = jnp.asarray(pose.attitude).T
    return ExtendedPose(
        turn, -(turn @ jnp.asarray(pose.velocity)), -(turn @ jnp.asarray(pose.position))
    )


def adjoint(pose: ExtendedPose) -> Float[Array, "9 9"]:
    """Ad_X, with X exp(ξ) X⁻¹ = exp(Ad_X ξ)."""
    turn = jnp.asarray(pose.attitude)
    return _blocks(turn, rotation.skew(pose.velocity) @ turn, rotation.skew(pose.position) @ turn)


def left_jacobian(xi: Float[AnyArray, "9"]) -> Float[Array, "9 9"]:
    """J_l(ξ), with exp(ξ + δ) = exp(J_l(ξ) δ) exp ξ to first order in δ."""
    xi = jnp.asarray(xi)
    phi = xi[:3]
    return _blocks(so3_left_jacobian(phi), _coupling(phi, xi[3:6]), _coupling(phi, xi[6:]))
