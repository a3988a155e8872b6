"""Accelerometers against a known specific force, for example from the table's angles.

    r = W (a' − (E + Γ) a_ref − a⁰),   Γ full; 12 parameters

**Gauge.** Nothing is free: Γ includes the triad's rotation against the reference frame. That rotation
cannot be told from a rotation of the device on the table (`table_misalignment`), and a common scale
factor not from an error of g.
"""

from typing import ClassVar

from jaxtyping import Float

from .._jax import Array, eqx, jnp
from .._typing import AnyArray, Scalar
from ..physics.error_model import AccelerometerErrors, distort_accel
from ..physics.leaves import as_array
from ..reduction.dwells import Dwells, is_told
from .base import diagonal_sigmas, soften, whiten
from .triads import AccelEstimator


class ReferenceAccel(AccelEstimator):
    """Outputs against `reference_accel`; bias (3) and full Γ (9). See the module."""

    by_reference: ClassVar[bool] = True

    scatter: Scalar = eqx.field(converter=as_array, default=0.0)  # m/s², 1 sigma
    robust: float | None = eqx.field(static=True, default=None)  # pseudo-Huber threshold, sigmas

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(f"accel.bias[{i}]" for i in range(3)) + tuple(
            f"accel.matrix[{i},{j}]" for i in range(3) for j in range(3)
        )

    def unpack(self, vector: Float[AnyArray, " parameters"]) -> AccelerometerErrors:
        vector = jnp.asarray(vector)
        return AccelerometerErrors(vector[:3], vector[3:].reshape(3, 3))

    def pack(self, errors: AccelerometerErrors) -> Float[Array, " parameters"]:
        return jnp.concatenate([jnp.asarray(errors.bias), jnp.asarray(errors.matrix).reshape(9)])

    def residual(
        self, vector: Float[AnyArray, " parameters"], dwell: Dwells
    ) -> Float[Array, " rows"]:
        misfit, _ = self.misfit(vector, dwell)
        return soften(whiten(dwell.accel_covariance, self.scatter, misfit), self.robust)

    def misfit(
        self, vector: Float[AnyArray, " parameters"], dwell: Dwells
    ) -> tuple[Float[Array, " rows"], Float[Array, " rows"]]:
        expected = distort_accel(self.unpack(vector), jnp.asarray(dwell.reference_accel))
        misfit = jnp.asarray(dwell.accel) - expected
        return misfit, diagonal_sigmas(dwell.accel_covariance)

    @classmethod
    def usable(cls, dwells: Dwells) -> Dwells:
        """The dwells whose force the plan tells."""
        dwells = super().usable(dwells)
        if dwells.reference_accel is None:
            return dwells
        told = is_told(dwells.reference_accel)
        return eqx.tree_at(lambda d: d.valid, dwells, dwells.valid & told)

    def start(self, dwells: Dwells) -> Float[Array, " parameters"]:
        # The residual is linear in the parameters: Gauss-Newton needs no start.
        return jnp.zeros(self.num_parameters, jnp.asarray(dwells.accel).dtype)
