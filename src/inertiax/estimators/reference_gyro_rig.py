"""Gyros against a rate table whose rate and whose mounting of the device are not exactly known.

    r  = W (ω' − (E + Θ) (1 + s) R ω_ref − ν⁰ − D a / g),   R = exp([μ]×)
    r₁ = Wₐ (a − R a_ref),     r₀ = s / (σ_s √n)

s is the relative error of the table's rate, μ the rotation vector from the table's mounting face to
the accelerometers' frame (rad), a the compensated outputs of the accelerometers.

**Gauge.** Rates alone tell neither s nor μ from Θ (see `reference_gyro`). So μ comes from gravity, as the
accelerometers see it on the same table, which makes Θ refer to the accelerometers' frame; and s stays
what the rig promises, 0 ± σ_s, where it belongs: in the uncertainty of Θ's common scale factor.

Each of the n dwells holds an equal part of the promise. It concerns s itself, not what is left of s after
a pass of an iterative procedure: use `joint_fit`.
"""

from typing import ClassVar

from jaxtyping import Float

from .._jax import Array, jnp
from .._records import field
from .._typing import AnyArray, Scalar
from ..physics.error_model import distort_gyro, GyroErrors
from ..physics.leaves import as_array
from ..reduction.dwells import Dwells
from ..reduction.motions import rotate
from .base import AbstractEstimator, diagonal_sigmas, soften, whiten
from .reference_gyro import ReferenceGyro
from .triads import dwell_force


class ReferenceGyroRig(AbstractEstimator[GyroErrors]):
    """Bias (3), Θ (9), optionally D (9), then s and μ (3). See the module.

    Dwells need `accel`, compensated, and `reference_accel` beside the rates.
    """

    triad: ClassVar[str] = "gyro"
    by_reference: ClassVar[bool] = True

    gravity: Scalar = field(converter=as_array)  # m/s²
    rate_uncertainty: Scalar = field(converter=as_array)  # σ_s, relative
    num_dwells: int = field(static=True)  # n, of the whole fit
    scatter: Scalar = field(converter=as_array, default=0.0)  # rad/s, 1 sigma
    g_sensitivity: bool = field(static=True, default=False)
    robust: float | None = field(static=True, default=None)  # pseudo-Huber threshold, sigmas

    @property
    def _form(self) -> ReferenceGyro:
        return ReferenceGyro(gravity=self.gravity, g_sensitivity=self.g_sensitivity)

    @property
    def names(self) -> tuple[str, ...]:
        return (*self._form.names, "rig.rate_error", *(f"rig.mounting[{i}]" for i in range(3)))

    def unpack(self, vector: Float[AnyArray, " parameters"]) -> GyroErrors:
        return self._form.unpack(jnp.asarray(vector)[:-4])

    def rig(self, vector: Float[AnyArray, " parameters"]) -> tuple[Array, Float[Array, "3"]]:
        """Relative error of the rate, and the mounting's rotation vector, rad."""
        return jnp.asarray(vector)[-4], jnp.asarray(vector)[-3:]

    def pack(self, errors: GyroErrors) -> Float[Array, " parameters"]:
        own = self._form.pack(errors)
        return jnp.concatenate([own, jnp.zeros(4, own.dtype)])

    def residual(
        self, vector: Float[AnyArray, " parameters"], dwell: Dwells
    ) -> Float[Array, " rows"]:
        rate_error, mounting = self.rig(vector)
        misfit, _ = self.misfit(vector, dwell)
        level = jnp.asarray(dwell.accel) - rotate(mounting, jnp.asarray(dwell.reference_accel))
        rows = jnp.concatenate(
            [
                whiten(dwell.gyro_covariance, self.scatter, misfit),
                whiten(dwell.accel_covariance, 0.0, level),
            ]
        )
        promise = rate_error / (self.rate_uncertainty * self.num_dwells**0.5)
        return jnp.concatenate([soften(rows, self.robust), promise[None]])

    def misfit(
        self, vector: Float[AnyArray, " parameters"], dwell: Dwells
    ) -> tuple[Float[Array, " rows"], Float[Array, " rows"]]:
        rate_error, mounting = self.rig(vector)
        rate = (1.0 + rate_error) * rotate(mounting, jnp.asarray(dwell.reference_gyro))
        expected = distort_gyro(self.unpack(vector), rate, self._force(dwell), self.gravity)
        return jnp.asarray(dwell.gyro) - expected, diagonal_sigmas(dwell.gyro_covariance)

    def _force(self, dwell: Dwells) -> Float[Array, "3"]:
        return jnp.asarray(dwell.accel) if dwell.accel is not None else dwell_force(dwell)

    def compensate(self, vector: Float[AnyArray, " parameters"], dwell: Dwells) -> Dwells:
        raise ValueError(
            "`ReferenceGyroRig` is for `joint_fit`: iterations would forget its promise."
        )

    def compose(
        self, first: Float[AnyArray, " parameters"], second: Float[AnyArray, " parameters"]
    ) -> Float[Array, " parameters"]:
        raise ValueError(
            "`ReferenceGyroRig` is for `joint_fit`: iterations would forget its promise."
        )

    def start(self, dwells: Dwells) -> Float[Array, " parameters"]:
        return jnp.zeros(self.num_parameters, jnp.asarray(dwells.gyro).dtype)
