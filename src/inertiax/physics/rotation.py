"""Rotations as matrices and rotation vectors, with gradients that are finite at zero.

A rotation vector is axis times angle, rad. `exp(v)` is the matrix that turns a vector by it
(active), so `exp(v) @ x` has the sense of the right-hand rule; a matrix `rot_ab` takes components
in b to components in a.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

from .._typing import Mat3, Scalar, Vec3


def skew(vector: Vec3) -> Float[Array, "3 3"]:
    """The matrix of the cross product: `skew(v) @ x` = v × x."""
    x, y, z = jnp.asarray(vector)
    o = jnp.zeros_like(x)
    return jnp.stack([jnp.stack([o, -z, y]), jnp.stack([z, o, -x]), jnp.stack([-y, x, o])])


def unskew(matrix: Mat3) -> Float[Array, "3"]:
    """The vector of a matrix's antisymmetric part: the inverse of `skew`."""
    m = jnp.asarray(matrix)
    return 0.5 * jnp.stack([m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]])


def exp(vector: Vec3) -> Float[Array, "3 3"]:
    """The rotation matrix of a rotation vector (rad), by Rodrigues' formula,

    $$R = E + \\frac{\\sin\\theta}{\\theta} [v]_\\times +
    \\frac{1 - \\cos\\theta}{\\theta^2} [v]_\\times^2, \\qquad \\theta = |v|.$$
    """
    turn = exp_less_identity(vector)
    return jnp.eye(3, dtype=turn.dtype) + turn


def exp_less_identity(vector: Vec3) -> Float[Array, "3 3"]:
    """`exp(vector)` − E, which keeps its relative accuracy for small rotations."""
    v = jnp.asarray(vector)
    square = jnp.vdot(v, v)
    # Below this angle (1e-2 rad in double precision) the series' first left-out terms are under
    # rounding; the inner `where` keeps sqrt(0) and 0/0 out of the gradient.
    tiny = square < 1e-4
    safe = jnp.where(tiny, jnp.ones_like(square), square)
    theta = jnp.sqrt(safe)
    first = jnp.where(
        tiny, 1.0 - square / 6.0 + square**2 / 120.0 - square**3 / 5040.0, jnp.sin(theta) / theta
    )
    # (1 − cos θ) / θ² = 2 sin²(θ/2) / θ², without the cancellation.
    second = jnp.where(
        tiny,
        0.5 - square / 24.0 + square**2 / 720.0 - square**3 / 40320.0,
        2.0 * jnp.sin(0.5 * theta) ** 2 / safe,
    )
    cross = skew(v)
    return first * cross + second * (cross @ cross)


def log(matrix: Mat3) -> Float[Array, "3"]:
    """The rotation vector (rad, length at most π) of a rotation matrix; the inverse of `exp`.

    Goes through the unit quaternion by Shepperd's choice of the largest component, so it keeps its
    accuracy up to half a turn (where the sign of the axis is arbitrary).

    **Reference:** Shepperd, J. Guidance and Control 1 (1978), 223-224.
    """
    q = _quaternion(jnp.asarray(matrix))
    w, v = q[0], q[1:]
    square = jnp.vdot(v, v)
    tiny = square < 1e-6
    safe = jnp.where(tiny, jnp.ones_like(square), square)
    length = jnp.sqrt(safe)
    # θ / sin(θ/2) = 2 asin(s) / s as a series in s = |v|.
    series = 2.0 + square / 3.0 + 3.0 * square**2 / 20.0
    return v * jnp.where(tiny, series, 2.0 * jnp.arctan2(length, w) / length)


def _quaternion(m: Float[Array, "3 3"]) -> Float[Array, "4"]:
    """Unit quaternion (w, x, y, z) with w ≥ 0 of a rotation matrix."""
    x, y, z = 2.0 * unskew(m)
    xy, xz, yz = m[0, 1] + m[1, 0], m[0, 2] + m[2, 0], m[1, 2] + m[2, 1]
    d0, d1, d2 = m[0, 0], m[1, 1], m[2, 2]
    # 4 q qᵀ: every row is a multiple of q; the longest one is at least 2 long.
    rows = jnp.stack(
        [
            jnp.stack([1.0 + d0 + d1 + d2, x, y, z]),
            jnp.stack([x, 1.0 + d0 - d1 - d2, xy, xz]),
            jnp.stack([y, xy, 1.0 - d0 + d1 - d2, yz]),
            jnp.stack([z, xz, yz, 1.0 - d0 - d1 + d2]),
        ]
    )
    row = rows[jnp.argmax(jnp.diagonal(rows))]
    q = row / jnp.sqrt(jnp.vdot(row, row))
    return jnp.where(q[0] < 0.0, -q, q)


def about(axis: Vec3, angle: Scalar | float) -> Float[Array, "3 3"]:
    """The rotation by `angle` (rad) about a unit vector `axis`."""
    return exp(jnp.asarray(axis) * angle)
