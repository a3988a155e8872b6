"""What the estimators of one triad share: equation (3) refines a dwell, equation (6) joins two stages."""

import abc
from typing import ClassVar

from jaxtyping import Float

from .._jax import Array, eqx, jnp
from .._typing import AnyArray, Scalar
from ..physics.composition import compose_accel, compose_gyro
from ..physics.error_model import (
    AccelerometerErrors,
    compensate_accel,
    compensate_gyro,
    GyroErrors,
)
from ..reduction.dwells import Dwells, known_force
from .base import AbstractEstimator, transform_covariance


class AccelEstimator(AbstractEstimator[AccelerometerErrors], abc.ABC):
    """An estimator of accelerometers alone; its residual is the subclass's."""

    triad: ClassVar[str] = "accel"

    def compensate(self, vector: Float[AnyArray, " parameters"], dwell: Dwells) -> Dwells:
        """a = (E + Γ)⁻¹ (a' − a⁰), and the covariance of the mean with it."""
        errors = self.unpack(vector)
        return eqx.tree_at(
            lambda d: (d.accel, d.accel_covariance),
            dwell,
            (
                compensate_accel(errors, jnp.asarray(dwell.accel)),
                transform_covariance(jnp.asarray(errors.matrix), dwell.accel_covariance),
            ),
        )

    def compose(
        self, first: Float[AnyArray, " parameters"], second: Float[AnyArray, " parameters"]
    ) -> Float[Array, " parameters"]:
        return self.pack(compose_accel(self.unpack(first), self.unpack(second)))


class GyroEstimator(AbstractEstimator[GyroErrors], abc.ABC):
    """An estimator of gyros alone; its residual is the subclass's."""

    triad: ClassVar[str] = "gyro"

    gravity: eqx.AbstractVar[Scalar]  # m/s², makes D's force dimensionless

    def compensate(self, vector: Float[AnyArray, " parameters"], dwell: Dwells) -> Dwells:
        """ω = (E + Θ)⁻¹ (ω' − ν⁰ − D a / g), and the covariance of the mean with it."""
        errors = self.unpack(vector)
        rate = compensate_gyro(errors, jnp.asarray(dwell.gyro), dwell_force(dwell), self.gravity)
        return eqx.tree_at(
            lambda d: (d.gyro, d.gyro_covariance),
            dwell,
            (rate, transform_covariance(jnp.asarray(errors.matrix), dwell.gyro_covariance)),
        )

    def compose(
        self, first: Float[AnyArray, " parameters"], second: Float[AnyArray, " parameters"]
    ) -> Float[Array, " parameters"]:
        return self.pack(compose_gyro(self.unpack(first), self.unpack(second)))


def dwell_force(dwell: Dwells) -> Float[Array, "3"]:
    """Specific force of a dwell, m/s²: the reference where there is one, else the accelerometers'
    (compensated) outputs, else zero."""
    force = known_force(dwell.reference_accel, dwell.accel)
    return jnp.zeros(3, jnp.asarray(dwell.gyro).dtype) if force is None else jnp.asarray(force)
