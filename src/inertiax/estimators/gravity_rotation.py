"""Gyros without a rate table: between two rests they must turn gravity as the accelerometers saw it.

    r = W tilt(C(ω) u₁, u₂),    ω = (E + Θ)⁻¹ (ω' − ν⁰ − D a / g);    r₀ = W₀ (ω'₂ − ν⁰ − D a₂ / g)

u₁, u₂ are the directions of the *compensated* specific force at the rests before and after a motion, C
the rotation that the compensated rates integrate to (`motions.carry`), tilt the two angles across u₂,
rad. r₀ holds the mean gyro outputs at the rest after it (of every rest, also one that no motion led to).

W whitens with the covariance of both directions and of the integrated rate together, and `scatter`, rad.
Neighbouring motions share a rest, and that they share its direction's error is left out.

**Gauge.** The frame is the accelerometers' (for `invariant`: its lower-triangular frame), and in it all
of Θ is determined, the gyros' common rotation against the accelerometers included. One motion gives two
equations only: a rotation about gravity at its end is unseen, so a turn about the vertical tells no
scale factor, and a single tilt axis only what concerns it. Bias, Θ and D all need tilts about at least
three axes that do not lie in a plane, five motions or more. Earth rate is part of the bias, although it
changes with attitude (7e-5 rad/s at most). A common error of the clock looks like a common scale factor,
with the opposite sign.

**Reference:** Tedaldi, Pretto, Menegatti, *A robust and easy to implement method for IMU calibration
without external equipments*, ICRA 2014 (who take the bias from the first rest alone, and no D).
"""

from jaxtyping import Float

from .._jax import Array, eqx, jax, jnp
from .._typing import AnyArray, Mat3, Scalar, Vec3
from ..physics.error_model import GyroErrors, solve3
from ..physics.leaves import as_array
from ..reduction.dwells import Dwells
from ..reduction.motions import carry, Motions
from .base import soften, whiten
from .reference_gyro import ReferenceGyro
from .triads import dwell_force, GyroEstimator


class GravityRotation(GyroEstimator):
    """Gravity's rotation between rests; bias (3), full Θ (9), optionally D (9). See the module.

    Dwells are rests with their `motion`, as `rotations_between_rests.with_motions` makes them;
    `calibrate.pipeline.calibrate` does it for a recording, `ix.fit` cannot.
    """

    gravity: Scalar = eqx.field(converter=as_array)  # m/s², makes D's force dimensionless
    scatter: Scalar = eqx.field(converter=as_array, default=0.0)  # rad, 1 sigma
    g_sensitivity: bool = eqx.field(static=True, default=False)
    robust: float | None = eqx.field(static=True, default=None)  # pseudo-Huber threshold, sigmas

    @property
    def _form(self) -> ReferenceGyro:
        # The same parameters in the same order.
        return ReferenceGyro(gravity=self.gravity, g_sensitivity=self.g_sensitivity)

    @property
    def names(self) -> tuple[str, ...]:
        return self._form.names

    def unpack(self, vector: Float[AnyArray, " parameters"]) -> GyroErrors:
        return self._form.unpack(vector)

    def pack(self, errors: GyroErrors) -> Float[Array, " parameters"]:
        return self._form.pack(errors)

    def residual(
        self, vector: Float[AnyArray, " parameters"], dwell: Dwells
    ) -> Float[Array, " rows"]:
        errors = self.unpack(vector)
        by_force = jnp.asarray(errors.g_sensitivity) @ (dwell_force(dwell) / self.gravity)
        at_rest = jnp.asarray(dwell.gyro) - jnp.asarray(errors.bias) - by_force
        tilt = _whiten2(_covariance(dwell), self.scatter, self._tilt(errors, dwell))
        tilt = jnp.where(_motion(dwell).valid, tilt, jnp.zeros_like(tilt))
        rows = jnp.concatenate([whiten(dwell.gyro_covariance, 0.0, at_rest), tilt])
        return soften(rows, self.robust)

    def misfit(
        self, vector: Float[AnyArray, " parameters"], dwell: Dwells
    ) -> tuple[Float[Array, " rows"], Float[Array, " rows"]]:
        """The two tilts, rad; meaningless for a rest that no motion led to."""
        sigma = jnp.sqrt(jnp.diagonal(_covariance(dwell)))
        return self._tilt(self.unpack(vector), dwell), jax.lax.stop_gradient(sigma)

    def _tilt(self, errors: GyroErrors, dwell: Dwells) -> Float[Array, "2"]:
        motion = _motion(dwell)
        predicted = carry(_direction(motion.start_force), self._rates(errors, motion), motion.step)
        return tilt(predicted, _direction(jnp.asarray(dwell.accel)))

    def _rates(self, errors: GyroErrors, motion: Motions) -> Float[Array, "sample 3"]:
        """Compensated rates while the device moves, rad/s: equation (3) with one inverse for all."""
        identity = jnp.eye(3, dtype=jnp.asarray(errors.matrix).dtype)
        m = identity + jnp.asarray(errors.matrix)
        inverse = jax.vmap(lambda column: solve3(m, column), in_axes=1, out_axes=1)(identity)
        at_rest = jnp.asarray(errors.bias)
        if motion.force is None:
            return jax.vmap(lambda w: inverse @ (w - at_rest))(jnp.asarray(motion.gyro))
        d = jnp.asarray(errors.g_sensitivity) / self.gravity
        one = lambda w, a: inverse @ (w - at_rest - d @ a)
        return jax.vmap(one)(jnp.asarray(motion.gyro), jnp.asarray(motion.force))

    def compensate(self, vector: Float[AnyArray, " parameters"], dwell: Dwells) -> Dwells:
        """The rest, and the rates of the motion that led to it."""
        refined = super().compensate(vector, dwell)
        rates = self._rates(self.unpack(vector), _motion(dwell))
        return eqx.tree_at(lambda d: d.motion.gyro, refined, rates)

    def start(self, dwells: Dwells) -> Float[Array, " parameters"]:
        gyro = jnp.asarray(dwells.gyro)
        weight = jnp.asarray(dwells.valid, gyro.dtype)
        bias = weight @ gyro / jnp.sum(weight)
        return jnp.zeros(self.num_parameters, gyro.dtype).at[:3].set(bias)


def tilt(predicted: Vec3, measured: Vec3) -> Float[Array, "2"]:
    """The two angles (rad) across `measured` by which a unit vector `predicted` is off.

    2 e·p / (1 + m·p), which is 2 tan(θ/2) long: the angle itself to second order, and growing all the
    way to half a turn, where a plain projection e·p would come back to zero.
    """
    p, m = jnp.asarray(predicted), jnp.asarray(measured)
    return 2.0 * (across(m) @ p) / (1.0 + jnp.vdot(m, p))


def across(direction: Vec3) -> Float[Array, "2 3"]:
    """Two unit vectors that are perpendicular to a unit vector and to each other."""
    u = jnp.asarray(direction)
    axis = jax.nn.one_hot(jnp.argmin(jnp.abs(u)), 3, dtype=u.dtype)
    first = jnp.cross(u, axis)
    first = first / jnp.linalg.norm(first)
    return jnp.stack([first, jnp.cross(u, first)])


def _direction(force: Vec3) -> Float[Array, "3"]:
    force = jnp.asarray(force)
    return force / jnp.linalg.norm(force)


def _covariance(dwell: Dwells) -> Float[Array, "2 2"]:
    """Of the tilt, rad²: both directions and the integrated rate.

    The first direction's part is taken as the same about all axes (its mean over the two across it), so
    that the motion need not be known to weigh it.
    """
    motion = _motion(dwell)
    end = _across_covariance(jnp.asarray(dwell.accel), dwell.accel_covariance)
    start = 0.5 * jnp.trace(_across_covariance(motion.start_force, motion.start_covariance))
    return end + (start + motion.noise) * jnp.eye(2, dtype=end.dtype)


def _across_covariance(force: Vec3, covariance: Mat3 | None) -> Float[Array, "2 2"]:
    force = jnp.asarray(force)
    if covariance is None:
        return jnp.zeros((2, 2), force.dtype)
    basis = across(_direction(force))
    return basis @ jnp.asarray(covariance) @ basis.T / jnp.vdot(force, force)


def _whiten2(
    covariance: Float[Array, "2 2"], scatter: Scalar, residual: Float[Array, "2"]
) -> Float[Array, "2"]:
    """L⁻¹ r with L Lᵀ = covariance + scatter² E, in scalars."""
    extra = jnp.square(scatter)
    l00 = jnp.sqrt(covariance[0, 0] + extra)
    l10 = covariance[1, 0] / l00
    l11 = jnp.sqrt(covariance[1, 1] + extra - l10**2)
    first = residual[0] / l00
    return jnp.stack([first, (residual[1] - l10 * first) / l11])


def _motion(dwell: Dwells) -> Motions:
    # Dwells for this estimator carry motions; `with_motions` says so where they cannot.
    assert dwell.motion is not None
    return dwell.motion
