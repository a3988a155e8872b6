"""Gyros against known rates: a rate table's, or Earth's at known attitudes.

    r = W (ω' − (E + Θ) ω_ref − ν⁰ − D a / g),   Θ full (9), D full (9, optional)

The force a is the dwell's `reference_accel` where the plan gives one, else its accelerometer
outputs, which should have been compensated before (equation (3), exact form).

**Gauge.** Nothing is free, but a rotation of the device on the table cannot be told from Θ, a common
scale factor not from an error of the table's rate or clock, and at rest D not from the Earth rate's
dependence on attitude unless the reference contains it.
"""

from typing import ClassVar

from jaxtyping import Float

from .._jax import Array, jnp
from .._records import field
from .._typing import AnyArray, Scalar
from ..physics.error_model import distort_gyro, GyroErrors
from ..physics.leaves import as_array
from ..reduction.dwells import Dwells
from .base import diagonal_sigmas, soften, whiten
from .triads import dwell_force, GyroEstimator


class ReferenceGyro(GyroEstimator):
    """Outputs against `reference_gyro`; bias (3), full Θ (9), optionally D (9). See the module."""

    by_reference: ClassVar[bool] = True

    gravity: Scalar = field(converter=as_array)  # m/s², makes D's force dimensionless
    scatter: Scalar = field(converter=as_array, default=0.0)  # rad/s, 1 sigma
    g_sensitivity: bool = field(static=True, default=False)  # estimate D, too
    robust: float | None = field(static=True, default=None)  # pseudo-Huber threshold, sigmas

    @property
    def names(self) -> tuple[str, ...]:
        pairs = [(i, j) for i in range(3) for j in range(3)]
        names = [f"gyro.bias[{i}]" for i in range(3)] + [f"gyro.matrix[{i},{j}]" for i, j in pairs]
        if self.g_sensitivity:
            names += [f"gyro.g_sensitivity[{i},{j}]" for i, j in pairs]
        return tuple(names)

    def unpack(self, vector: Float[AnyArray, " parameters"]) -> GyroErrors:
        vector = jnp.asarray(vector)
        d = vector[12:].reshape(3, 3) if self.g_sensitivity else jnp.zeros((3, 3), vector.dtype)
        return GyroErrors(vector[:3], vector[3:12].reshape(3, 3), d)

    def pack(self, errors: GyroErrors) -> Float[Array, " parameters"]:
        parts = [jnp.asarray(errors.bias), jnp.asarray(errors.matrix).reshape(9)]
        if self.g_sensitivity:
            parts.append(jnp.asarray(errors.g_sensitivity).reshape(9))
        return jnp.concatenate(parts)

    def residual(
        self, vector: Float[AnyArray, " parameters"], dwell: Dwells
    ) -> Float[Array, " rows"]:
        misfit, _ = self.misfit(vector, dwell)
        return soften(whiten(dwell.gyro_covariance, self.scatter, misfit), self.robust)

    def misfit(
        self, vector: Float[AnyArray, " parameters"], dwell: Dwells
    ) -> tuple[Float[Array, " rows"], Float[Array, " rows"]]:
        rate = jnp.asarray(dwell.reference_gyro)
        expected = distort_gyro(self.unpack(vector), rate, dwell_force(dwell), self.gravity)
        misfit = jnp.asarray(dwell.gyro) - expected
        return misfit, diagonal_sigmas(dwell.gyro_covariance)

    def start(self, dwells: Dwells) -> Float[Array, " parameters"]:
        # The residual is linear in the parameters: Gauss-Newton needs no start.
        return jnp.zeros(self.num_parameters, jnp.asarray(dwells.gyro).dtype)
