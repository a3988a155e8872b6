"""Both triads in one residual vector: what one tells of the other is used, and the covariance is of both.

    r = [ r_accel(a' − s(R, ω_ref)) ;  r_gyro(ω' | a = (E + Γ)⁻¹ (a' − s − a⁰)) ]

r_accel and r_gyro are the residuals of the two triads' own estimators. The gyros' holds the specific force
(g-sensitivity, and gravity's direction before and after a motion) as the *present* accelerometer parameters
give it, so that their uncertainty passes into the gyros'.

s is the **size effect** (IEEE Std 1293): accelerometer i sits a lever arm R_i away from the point that the
reference is for, and adds s_i = [(E + Γ) (ω × (ω × R_i))]_i, as the catalogue's `size_effect` has it: the force at its
place along its own axis, which a device that stands a degree askew has a degree from the case's. A plateau of
constant rate has no angular acceleration.

**Gauge.** That of the accelerometers' estimator. In it Θ holds the gyros' rotation, which with `Invariant` is the
*inter-triad misalignment* (`alignment.inter_triad`); with `misalignment` False it is held at zero: Θ is symmetric.
Lever arms need the reference of both triads on plateaus about axes that lie in no case plane: turning about
a case axis tells, of each other accelerometer, the arm along its own sensitive axis only.
Rests tell none, and hand motion none without the hand's own acceleration.

**Reference:** IEEE Std 1293-2018, size effect.
"""

from typing import ClassVar

import numpy as np
from jaxtyping import Float

from .._jax import Array, eqx, jax, jnp
from .._typing import AnyArray, Mat3, Scalar, Vec3
from ..physics.composition import compose_imu
from ..physics.error_model import AccelerometerErrors, compensate_accel, GyroErrors
from ..reduction.dwells import Dwells, is_told
from .base import AbstractEstimator
from .gravity_rotation import GravityRotation
from .invariant import Invariant
from .reference_accel import ReferenceAccel
from .reference_gyro import ReferenceGyro


ImuErrors = tuple[AccelerometerErrors, GyroErrors]


class JointImu(AbstractEstimator[ImuErrors]):
    """Parameters of the accelerometers' estimator, then the gyros', then lever arms (9). See the module.

    Dwells hold *raw* outputs of both triads; with `GravityRotation` their motions hold raw forces too.
    """

    triad: ClassVar[str] = "imu"
    scatter: ClassVar[Scalar] = np.zeros(())  # none in common: each triad's estimator has its own

    accel: Invariant | ReferenceAccel
    gyro: ReferenceGyro | GravityRotation
    lever_arms: bool = eqx.field(static=True, default=False)
    misalignment: bool = eqx.field(static=True, default=True)

    def __check_init__(self):
        both = isinstance(self.accel, ReferenceAccel) and isinstance(self.gyro, ReferenceGyro)
        if self.lever_arms and not both:
            raise ValueError(
                "`JointImu(lever_arms=True)`: lever arms show while the rate and the specific force are "
                "known from a reference; it needs the estimators ReferenceAccel and ReferenceGyro."
            )

    @property
    def names(self) -> tuple[str, ...]:
        free = [n for n in self.gyro.names if self.misalignment or n not in _UPPER]
        arms = [f"accel.lever_arm[{i},{j}]" for i in range(3) for j in range(3)]
        return (*self.accel.names, *free, *(arms if self.lever_arms else ()))

    @property
    def _gyro_map(self) -> Float[np.ndarray, "all free"]:
        """The gyros' own parameters from the free ones: Θ's upper triangle repeats the lower."""
        names = self.gyro.names
        if self.misalignment:
            return np.eye(len(names))
        free = [n for n in names if n not in _UPPER]
        return np.array([[float(_UPPER.get(n, n) == f) for f in free] for n in names])

    def triad_map(self, triad: str) -> Float[np.ndarray, "own parameters"]:
        """The matrix that takes the vector to one triad's own parameters, "accel" or "gyro"."""
        accel, own = self.accel.num_parameters, self._gyro_map
        result = np.zeros((accel if triad == "accel" else len(own), self.num_parameters))
        if triad == "accel":
            result[:, :accel] = np.eye(accel)
        else:
            result[:, accel : accel + own.shape[1]] = own
        return result

    def arms(self, vector: Float[AnyArray, " parameters"]) -> Float[Array, "3 3"]:
        """Lever arms by rows, m: row i is the place of accelerometer i."""
        vector = jnp.asarray(vector)
        if not self.lever_arms:
            return jnp.zeros((3, 3), vector.dtype)
        return vector[-9:].reshape(3, 3)

    def unpack(self, vector: Float[AnyArray, " parameters"]) -> ImuErrors:
        accel, gyro = self._split(vector)
        return self.accel.unpack(accel), self.gyro.unpack(gyro)

    def pack(self, errors: ImuErrors) -> Float[Array, " parameters"]:
        """Inverse of `unpack`, with lever arms of zero; of Θ the lower triangle where it is symmetric."""
        gyro = self.gyro.pack(errors[1])
        if not self.misalignment:
            gyro = gyro[np.array([n not in _UPPER for n in self.gyro.names])]
        arms = jnp.zeros(9 if self.lever_arms else 0, gyro.dtype)
        return jnp.concatenate([self.accel.pack(errors[0]), gyro, arms])

    def residual(
        self, vector: Float[AnyArray, " parameters"], dwell: Dwells
    ) -> Float[Array, " rows"]:
        accel, gyro = self._split(vector)
        seen, refined = self.seen_by(vector, dwell)
        rows = self.accel.residual(accel, seen)
        rows = jnp.where(self._has_accel_rows(dwell), rows, jnp.zeros_like(rows))
        return jnp.concatenate([rows, self.gyro.residual(gyro, refined)])

    def misfit(
        self, vector: Float[AnyArray, " parameters"], dwell: Dwells
    ) -> tuple[Float[Array, " rows"], Float[Array, " rows"]]:
        """Both triads' misfits one after the other, each in its own unit."""
        accel, gyro = self._split(vector)
        seen, refined = self.seen_by(vector, dwell)
        first, first_sigma = self.accel.misfit(accel, seen)
        second, second_sigma = self.gyro.misfit(gyro, refined)
        return jnp.concatenate([first, second]), jnp.concatenate([first_sigma, second_sigma])

    def seen_by(
        self, vector: Float[AnyArray, " parameters"], dwell: Dwells
    ) -> tuple[Dwells, Dwells]:
        """The dwell as the accelerometers' estimator gets it (without the size effect), and as the gyros'
        does (with compensated forces)."""
        dwell = self._without_size_effect(vector, dwell)
        return dwell, self._with_force(self._split(vector)[0], dwell)

    def compensate(self, vector: Float[AnyArray, " parameters"], dwell: Dwells) -> Dwells:
        return self.gyro.compensate(self._split(vector)[1], self.seen_by(vector, dwell)[1])

    def compose(
        self, first: Float[AnyArray, " parameters"], second: Float[AnyArray, " parameters"]
    ) -> Float[Array, " parameters"]:
        """Equation (6) of both triads; lever arms add, which is exact but for their share of Γ."""
        composed = self.pack(
            compose_imu(self.unpack(first), self.unpack(second), self.gyro.gravity)
        )
        if not self.lever_arms:
            return composed
        return composed.at[-9:].set(jnp.asarray(first)[-9:] + jnp.asarray(second)[-9:])

    @classmethod
    def usable(cls, dwells: Dwells) -> Dwells:
        """All dwells: `residual` takes each triad's own."""
        return dwells

    def start(self, dwells: Dwells) -> Float[Array, " parameters"]:
        accel = self.accel.unpack(self.accel.start(self.accel.usable(dwells)))
        return self.pack((accel, self.gyro.unpack(self.gyro.start(dwells))))

    def _split(self, vector: AnyArray) -> tuple[Array, Array]:
        vector, accel = jnp.asarray(vector), self.accel.num_parameters
        own = jnp.asarray(self._gyro_map, vector.dtype)
        return vector[:accel], own @ vector[accel : accel + own.shape[1]]

    def _has_accel_rows(self, dwell: Dwells) -> Array:
        """Where there is a reference, or, for an estimator without one, at rest."""
        if isinstance(self.accel, ReferenceAccel):
            return jnp.asarray(is_told(jnp.asarray(dwell.reference_accel)))
        return jnp.asarray(dwell.position) >= 0

    def _without_size_effect(self, vector: AnyArray, dwell: Dwells) -> Dwells:
        if not self.lever_arms:
            return dwell
        matrix = self.accel.unpack(self._split(vector)[0]).matrix
        added = size_effect(self.arms(vector), jnp.asarray(dwell.reference_gyro), matrix)
        return eqx.tree_at(lambda d: d.accel, dwell, jnp.asarray(dwell.accel) - added)

    def _with_force(self, accel: Array, dwell: Dwells) -> Dwells:
        """The dwell with compensated accelerometer outputs, of its motion too.

        Weights are those of the present parameters: their derivative is no information. What the
        accelerometers' model leaves at a rest is an error of that rest's force too.
        """
        left = jnp.square(self.accel.scatter)
        widen = lambda c: c + left * jnp.eye(3, dtype=jnp.asarray(c).dtype)
        fixed = self.accel.compensate(jax.lax.stop_gradient(accel), dwell)
        refined = self.accel.compensate(accel, dwell)
        weights = widen(fixed.accel_covariance)
        refined = eqx.tree_at(lambda d: d.accel_covariance, refined, weights)
        if dwell.motion is None:
            return refined
        errors, motion = self.accel.unpack(accel), dwell.motion
        start = compensate_accel(errors, motion.start_force)
        refined = eqx.tree_at(
            lambda d: (d.motion.start_force, d.motion.start_covariance),
            refined,
            (start, widen(jnp.asarray(motion.start_covariance))),
        )
        if motion.force is None:
            return refined
        force = jax.vmap(lambda a: compensate_accel(errors, a))(jnp.asarray(motion.force))
        return eqx.tree_at(lambda d: d.motion.force, refined, force)


_UPPER = {
    f"gyro.matrix[{i},{j}]": f"gyro.matrix[{j},{i}]" for i in range(3) for j in range(i + 1, 3)
}


def size_effect(arms: Mat3, rate: Vec3, matrix: Mat3 | None = None) -> Float[Array, "3"]:
    """s_i = [(E + Γ) (ω × (ω × R_i))]_i, m/s², of lever arms by rows (m) at a constant rate (rad/s).

    `matrix` is Γ of the accelerometers, without which their axes are the case's.

    **Reference:** IEEE Std 1293-2018.
    """
    arms, w = jnp.asarray(arms), jnp.asarray(rate)
    pull = (arms @ w)[:, None] * w[None, :] - jnp.vdot(w, w) * arms
    along = jnp.diagonal(pull)
    return along if matrix is None else along + jnp.sum(jnp.asarray(matrix) * pull, axis=1)
