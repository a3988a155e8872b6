"""How the gyro triad sits against the accelerometer triad.

Where the gyros were calibrated in the accelerometers' frame (by gravity's rotation, or on a rig with the
mounting as unknown), the rotation that Θ holds is the triads' misalignment:

    E + Θ = S R,   S symmetric (scale factors and non-orthogonality), R = exp([ρ]×)

To first order ρ is the skew part of Θ; this is the exact polar factor.
"""

import numpy as np
from jaxtyping import Float

from .._jax import Array, jax, jnp
from .._records import Module
from .._typing import AnyArray, Mat3


class Alignment(Module):
    """Rotation vector from the accelerometers' frame to the gyros', and what remains."""

    # ρ, rad: a vector of the one triad is exp([ρ]×) of it in the other
    rotation: Float[AnyArray, "3"]
    covariance: Float[AnyArray, "3 3"]  # rad²
    symmetric: Float[AnyArray, "3 3"]  # S − E: scale-factor errors, and non-orthogonality off it


def inter_triad(
    matrix: Mat3,
    covariance: Float[AnyArray, "entries entries"] | None = None,
    *,
    accel: Mat3 | None = None,
) -> Alignment:
    """Parts the gyros' Θ into the triads' misalignment and their own symmetric errors.

    **Arguments:** `covariance` is that of Θ by rows. Where both triads were calibrated against one reference
    (a table), `accel` is the accelerometers' full Γ: then the rotation is that of the gyros' polar factor
    against the accelerometers', and `covariance` (18 × 18) that of Θ and Γ together.

    Raises `ValueError` where E + Θ holds a reflection or more than a quarter turn: an axis has the wrong
    sign, or axes are swapped.
    """
    matrix = jnp.asarray(matrix)
    given = matrix.reshape(9)
    if accel is not None:
        given = jnp.concatenate([given, jnp.asarray(accel).reshape(9)])
    rotation = _between(given)
    if not np.all(np.isfinite(np.asarray(rotation))):
        raise ValueError(
            "`inter_triad(matrix)`: E + matrix is not near a rotation by less than a quarter turn; look "
            "for an axis of the wrong sign or swapped axes."
        )
    spread = jnp.zeros((3, 3), matrix.dtype)
    if covariance is not None:
        jacobian = _derivative(given)
        spread = jacobian @ jnp.asarray(covariance) @ jacobian.T
    return Alignment(rotation, spread, _symmetric(matrix))


@jax.jit
def _symmetric(matrix: Float[Array, "3 3"]) -> Float[Array, "3 3"]:
    product = jnp.eye(3, dtype=matrix.dtype) + matrix
    return product @ _polar(product).T - jnp.eye(3, dtype=matrix.dtype)


@jax.jit
def _between(matrices: Float[Array, " entries"]) -> Float[Array, "3"]:
    """Rotation vector of Θ's polar factor, against that of Γ where it follows Θ."""
    factors = [_polar(jnp.eye(3, dtype=m.dtype) + m) for m in matrices.reshape(-1, 3, 3)]
    return _rotation(factors[0] if len(factors) == 1 else factors[0] @ factors[1].T)


@jax.jit
def _derivative(matrices: Float[Array, " entries"]) -> Float[Array, "3 entries"]:
    return jax.jacfwd(_between)(matrices)


def _rotation(turn: Float[Array, "3 3"]) -> Float[Array, "3"]:
    """Rotation vector of a rotation matrix by less than a quarter turn; NaN of any other matrix."""
    skew = 0.5 * jnp.stack(
        [turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]
    )
    cosine = 0.5 * (jnp.trace(turn) - 1.0)
    sine2 = jnp.vdot(skew, skew)
    # angle / sin(angle) as a series where the quotient is 0/0.
    small = sine2 < 1e-6
    sine = jnp.sqrt(jnp.where(small, jnp.ones_like(sine2), sine2))
    ratio = jnp.where(small, 1.0 + sine2 / 6.0, jnp.arctan2(sine, cosine) / sine)
    fine = (cosine > 0.0) & (jnp.abs(cosine**2 + sine2 - 1.0) < 1e-6)
    return jnp.where(fine, ratio * skew, jnp.full_like(skew, jnp.nan))


def _polar(product: Float[Array, "3 3"]) -> Float[Array, "3 3"]:
    """Orthogonal polar factor by Newton's iteration X ← (X + X⁻ᵀ)/2, quadratic near a rotation.

    **Reference:** Higham, *Functions of matrices* (2008), section 8.3.
    """
    x = product
    for _ in range(8):
        a, b, c = x[0], x[1], x[2]
        cofactors = jnp.stack([jnp.cross(b, c), jnp.cross(c, a), jnp.cross(a, b)])
        x = 0.5 * (x + cofactors / jnp.vdot(a, cofactors[0]))
    return x
