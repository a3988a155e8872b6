"""Motions between rests, and what the gyros make of a direction fixed in the room.

Between samples the rate is taken as linear in time; each step is then one rotation vector, exact to the
fourth order of the step for that rate. The noise of hand-held motion at 100 Hz is far above what that
leaves out.
"""

from jaxtyping import Bool, Float

from .._jax import Array, jax, jnp
from .._records import Module
from .._typing import AnyArray, Scalar, Vec3


class Motions(Module):
    """The motions that led to each of a number of rests. The leading axis counts rests.

    All have the same number of samples: shorter ones repeat their last sample at steps of no
    duration, which turn nothing. A rest that no usable motion led to has `valid` False.
    """

    gyro: Float[AnyArray, "*dwell sample 3"]  # rad/s, from the last sample of the rest before
    step: Float[AnyArray, "*dwell step"]  # s, between those samples
    # m/s², compensated, at the rest before, turned with the Earth for the motion's time where a reference tells
    start_force: Float[AnyArray, "*dwell 3"]
    start_covariance: Float[AnyArray, "*dwell 3 3"]  # of that mean, (m/s²)²
    noise: Float[AnyArray, " *dwell"]  # rad², of the integrated rate about each axis
    valid: Bool[AnyArray, " *dwell"]
    force: Float[AnyArray, "*dwell sample 3"] | None = None  # m/s², compensated, while it moves
    # rad/s, 1 sigma of the bias between rests, which is within `noise` and the rests' covariances.
    wander: Float[AnyArray, " *dwell"] | None = None


def step_angle(first: Vec3, second: Vec3, step: Scalar | float) -> Float[Array, "3"]:
    """Rotation vector of one step over which the rate goes linearly from `first` to `second`, rad.

        φ = h (ω₀ + ω₁) / 2 + h² ω₀ × ω₁ / 12

    The second term is the coning correction ½ ∫ (∫ω) × ω dt of that rate; what is left is of order h⁵.

    **Reference:** Bortz, IEEE Trans. AES-7 (1971), 61-66.
    """
    first, second, h = jnp.asarray(first), jnp.asarray(second), jnp.asarray(step)
    return 0.5 * h * (first + second) + h**2 / 12.0 * jnp.cross(first, second)


def carry(
    direction: Vec3, rate: Float[AnyArray, "sample 3"], step: Float[AnyArray, " step"]
) -> Float[Array, "3"]:
    """A direction fixed in the room, given in the case frame before a motion, in that frame after it.

    The case turns by φ in each step, so the direction turns by −φ in the case: u ← exp(−[φ]×) u.
    `rate` (rad/s) has one sample more than `step` (s).
    """
    rate = jnp.asarray(rate)
    # Nothing is kept from step to step but the vector: with derivatives to a dozen parameters, arrays of
    # all steps' rotations would take far longer to move than to make.
    turn = lambda u, now: (rotate(-step_angle(*now), u), None)
    end, _ = jax.lax.scan(turn, jnp.asarray(direction), (rate[:-1], rate[1:], jnp.asarray(step)))
    return end


def rotate(angle: Vec3, vector: Vec3) -> Float[Array, "3"]:
    """A vector turned by a rotation vector of less than a radian, rad; without branches or roots.

    Rodrigues' formula with its two functions of θ² = |φ|² as series, whose first left-out terms are
    under 2e-11 of the vector at the half radian that a step may turn.
    """
    angle, vector = jnp.asarray(angle), jnp.asarray(vector)
    s = jnp.vdot(angle, angle)
    sine = 1.0 + s / -6.0 * (1.0 + s / -20.0 * (1.0 + s / -42.0 * (1.0 + s / -72.0)))
    cosine = 0.5 * (1.0 + s / -12.0 * (1.0 + s / -30.0 * (1.0 + s / -56.0 * (1.0 + s / -90.0))))
    once = jnp.cross(angle, vector)
    return vector + sine * once + cosine * jnp.cross(angle, once)
