"""One pose or rests alone: bias only (and D, for gyros with the force known).

    r = W (a' − a_ref − a⁰)                 accelerometers
    r = W (ω' − ω_ref − ν⁰ − D a / g)       gyros

Where the plan gives no reference, `nominal` stands in for it: for accelerometers the mean output over
the recording (the bias is then an offset from that mean, good for its change with temperature only);
for gyros zero, so that Earth rate is part of the bias.

**Gauge.** Scale factors and misalignments are not seen at all; a constant offset of the reference is
indistinguishable from bias.
"""

from jaxtyping import Float

from .._jax import Array, jnp
from .._records import field
from .._typing import AnyArray, Scalar, Vec3
from ..physics.error_model import AccelerometerErrors, GyroErrors
from ..physics.leaves import as_array
from ..reduction.dwells import Dwells
from .base import diagonal_sigmas, soften, whiten
from .triads import AccelEstimator, dwell_force, GyroEstimator


class StaticAccel(AccelEstimator):
    """Accelerometer bias against a known or mean output; 3 parameters. See the module."""

    nominal: Vec3 = field(converter=as_array)  # m/s², used where there is no reference_accel
    scatter: Scalar = field(converter=as_array, default=0.0)  # m/s², 1 sigma
    robust: float | None = field(static=True, default=None)  # pseudo-Huber threshold, sigmas

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(f"accel.bias[{i}]" for i in range(3))

    def unpack(self, vector: Float[AnyArray, " parameters"]) -> AccelerometerErrors:
        vector = jnp.asarray(vector)
        return AccelerometerErrors(vector, jnp.zeros((3, 3), vector.dtype))

    def pack(self, errors: AccelerometerErrors) -> Float[Array, " parameters"]:
        return jnp.asarray(errors.bias)

    def residual(
        self, vector: Float[AnyArray, " parameters"], dwell: Dwells
    ) -> Float[Array, " rows"]:
        misfit, _ = self.misfit(vector, dwell)
        return soften(whiten(dwell.accel_covariance, self.scatter, misfit), self.robust)

    def misfit(
        self, vector: Float[AnyArray, " parameters"], dwell: Dwells
    ) -> tuple[Float[Array, " rows"], Float[Array, " rows"]]:
        known = self.nominal if dwell.reference_accel is None else dwell.reference_accel
        misfit = jnp.asarray(dwell.accel) - jnp.asarray(known) - jnp.asarray(vector)
        return misfit, diagonal_sigmas(dwell.accel_covariance)

    def start(self, dwells: Dwells) -> Float[Array, " parameters"]:
        return jnp.zeros(3, jnp.asarray(dwells.accel).dtype)


class StaticGyro(GyroEstimator):
    """Gyro bias, optionally with D, from rests; 3 or 12 parameters. See the module."""

    gravity: Scalar = field(converter=as_array)  # m/s², makes D's force dimensionless
    scatter: Scalar = field(converter=as_array, default=0.0)  # rad/s, 1 sigma
    g_sensitivity: bool = field(static=True, default=False)  # estimate D, too
    robust: float | None = field(static=True, default=None)  # pseudo-Huber threshold, sigmas

    @property
    def names(self) -> tuple[str, ...]:
        names = [f"gyro.bias[{i}]" for i in range(3)]
        if self.g_sensitivity:
            names += [f"gyro.g_sensitivity[{i},{j}]" for i in range(3) for j in range(3)]
        return tuple(names)

    def unpack(self, vector: Float[AnyArray, " parameters"]) -> GyroErrors:
        vector = jnp.asarray(vector)
        zero = jnp.zeros((3, 3), vector.dtype)
        d = vector[3:].reshape(3, 3) if self.g_sensitivity else zero
        return GyroErrors(vector[:3], zero, d)

    def pack(self, errors: GyroErrors) -> Float[Array, " parameters"]:
        if self.g_sensitivity:
            d = jnp.asarray(errors.g_sensitivity).reshape(9)
            return jnp.concatenate([jnp.asarray(errors.bias), d])
        return jnp.asarray(errors.bias)

    def _drift(self, vector: Float[AnyArray, " parameters"], dwell: Dwells) -> Float[Array, "3"]:
        errors = self.unpack(vector)
        d = jnp.asarray(errors.g_sensitivity)
        return jnp.asarray(errors.bias) + d @ (dwell_force(dwell) / self.gravity)

    def residual(
        self, vector: Float[AnyArray, " parameters"], dwell: Dwells
    ) -> Float[Array, " rows"]:
        misfit, _ = self.misfit(vector, dwell)
        return soften(whiten(dwell.gyro_covariance, self.scatter, misfit), self.robust)

    def misfit(
        self, vector: Float[AnyArray, " parameters"], dwell: Dwells
    ) -> tuple[Float[Array, " rows"], Float[Array, " rows"]]:
        misfit = jnp.asarray(dwell.gyro) - self._drift(vector, dwell)
        if dwell.reference_gyro is not None:
            misfit = misfit - jnp.asarray(dwell.reference_gyro)
        return misfit, diagonal_sigmas(dwell.gyro_covariance)

    def start(self, dwells: Dwells) -> Float[Array, " parameters"]:
        return jnp.zeros(self.num_parameters, jnp.asarray(dwells.gyro).dtype)
