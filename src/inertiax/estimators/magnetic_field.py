"""Magnetometers in one place: the field has one magnitude, and at rest one angle to the vertical.

    r₁ = ‖m‖ − F                            every sample, at rest or in motion
    r₂ = m · u − F_u                        at rest, u = a / ‖a‖

with m = (E + S)⁻¹ (m' − b − c I) and u the upward direction that the compensated accelerometers show. Unknown are hard
iron b (3), soft iron S (9), the field of a current c (3) and the field's upward part F_u (1): up to 16 parameters.

r₁ is the accelerometers' invariant with another name, and leaves a rotation of the triad open; r₂ closes it, so that
the result is in the frame of the accelerometers. Rows are whitened with the covariance of the means, carried to both
residuals at the parameters `at`: weights that moved with the unknowns would draw the answer to where they are small.
`scatter` is what the field itself differs by from place to place, alike in all directions.

Where misfits are some per cent of F, r₁ at fixed weights has its least value for outputs that lie on none of the
ellipsoids one means: (E + S)⁻¹ takes nearly all of them to one point, from a centre far away. With `by_distance` the
outputs' own noise and scatter are carried to r₁ at the unknowns, so that r₁ over its sigma is the distance from the
ellipsoid (Sampson's, to first order in it), which no far centre makes small.

**Gauge.** A common scale of S against F: F is given, or set by convention. The sign of the field: an inverted triad
(all three axes) with an inverted F_u fits as well; of both the one nearer to the ideal triad is meant.

**Reference:** Vasconcelos, Elkaim, Silvestre, Oliveira, Cardeira, *Geometric approach to strapdown magnetometer
calibration in sensor frame*, IEEE Trans. AES 47 (2011) 1293; Kok, Schön, *Magnetometer calibration using inertial
sensors*, IEEE Sensors J. 16 (2016) 5679; for the distance, P. D. Sampson, *Fitting conic
sections to "very scattered" data*, Computer Graphics and Image Processing 18 (1982) 97.
"""

from typing import ClassVar

import numpy as np
from jaxtyping import Bool, Float

from .._jax import Array, eqx, jnp
from .._typing import AnyArray, Scalar
from ..physics.composition import compose_accel
from ..physics.error_model import AccelerometerErrors, solve3
from ..physics.leaves import as_array
from ..physics.magnetic_model import compensate_mag, MagnetometerErrors
from ..reduction.dwells import Dwells
from .base import AbstractEstimator, soften, transform_covariance
from .invariant import ellipsoid_start


VERTICAL = "mag.vertical"  # F_u, T
_ALONE = (
    1e-9  # of a variance: far above rounding, far below what any field that is not vertical leaves
)


class MagneticField(AbstractEstimator[MagnetometerErrors]):
    """Constant magnitude of the field, and at rest a constant angle to the vertical. See the module.

    Of dwells of position −1 the magnitude alone counts; those without a duration are single samples in motion.
    """

    triad: ClassVar[str] = "mag"

    field: Scalar = eqx.field(converter=as_array)  # F, T
    at: Float[AnyArray, " parameters"] = eqx.field(converter=as_array)  # where the weights are made
    scatter: Scalar = eqx.field(converter=as_array, default=0.0)  # T, 1 sigma
    # How many samples in motion tell what one would whose error is its own: neighbours are in the same place.
    alike: Scalar = eqx.field(converter=as_array, default=1.0)
    with_current: bool = eqx.field(static=True, default=False)  # c is estimated
    robust: float | None = eqx.field(static=True, default=None)  # pseudo-Huber threshold, sigmas
    by_distance: bool = eqx.field(static=True, default=False)  # r₁ as a distance from the ellipsoid

    @property
    def names(self) -> tuple[str, ...]:
        current = tuple(f"mag.current[{i}]" for i in range(3)) if self.with_current else ()
        return (
            *(f"mag.bias[{i}]" for i in range(3)),
            *(f"mag.matrix[{i},{j}]" for i in range(3) for j in range(3)),
            *current,
            VERTICAL,
        )

    def unpack(self, vector: Float[AnyArray, " parameters"]) -> MagnetometerErrors:
        vector = jnp.asarray(vector)
        current = vector[12:15] if self.with_current else jnp.zeros(3, vector.dtype)
        return MagnetometerErrors(vector[:3], vector[3:12].reshape(3, 3), current)

    def pack(self, errors: MagnetometerErrors) -> Float[Array, " parameters"]:
        """With a vertical part of zero, which is no error of the triad."""
        parts = [jnp.asarray(errors.bias), jnp.asarray(errors.matrix).reshape(9)]
        parts += [jnp.asarray(errors.current)] if self.with_current else []
        return jnp.concatenate([*parts, jnp.zeros(1, parts[0].dtype)])

    def residual(
        self, vector: Float[AnyArray, " parameters"], dwell: Dwells
    ) -> Float[Array, " rows"]:
        misfit, _ = self.misfit(vector, dwell)
        if self.by_distance:
            spread = self._covariance(dwell, jnp.asarray(vector), jnp.square(self.scatter))
        else:
            spread = self._covariance(dwell, jnp.asarray(self.at))
            spread = spread + jnp.square(self.scatter) * self._of_place(dwell)
        spread = spread * jnp.where(jnp.asarray(dwell.duration) > 0.0, 1.0, self.alike)
        first = jnp.sqrt(spread[0, 0])
        across = spread[1, 0] / first
        # Where the field is vertical both residuals are one, and the second tells nothing new.
        second = jnp.sqrt(jnp.maximum(spread[1, 1] - jnp.square(across), _ALONE * spread[1, 1]))
        magnitude = misfit[0] / first
        vertical = jnp.where(_rests(dwell), (misfit[1] - across * magnitude) / second, 0.0)
        return soften(jnp.stack([magnitude, vertical]), self.robust)

    def misfit(
        self, vector: Float[AnyArray, " parameters"], dwell: Dwells
    ) -> tuple[Float[Array, " rows"], Float[Array, " rows"]]:
        vector = jnp.asarray(vector)
        field = self._field(vector, dwell)
        vertical = field @ _up(dwell) - vector[-1]
        misfit = jnp.stack([jnp.linalg.norm(field) - self.field, vertical])
        sigma = jnp.sqrt(jnp.diagonal(self._covariance(dwell, jnp.asarray(self.at))))
        return jnp.where(jnp.array([True, False]) | _rests(dwell), misfit, 0.0), sigma

    def _field(self, vector: Float[Array, " parameters"], dwell: Dwells) -> Float[Array, "3"]:
        current = 0.0 if dwell.current is None else dwell.current
        return compensate_mag(self.unpack(vector), jnp.asarray(dwell.mag), current)

    def _of_place(self, dwell: Dwells) -> Float[Array, "2 2"]:
        """Of both residuals where the field differs by one unit on every axis: ∂r₁/∂m = m / ‖m‖, ∂r₂/∂m = u."""
        field = self._field(jnp.asarray(self.at), dwell)
        steep = field @ _up(dwell) / jnp.linalg.norm(field)
        return jnp.array([[1.0, 0.0], [0.0, 1.0]]) + steep * jnp.array([[0.0, 1.0], [1.0, 0.0]])

    def _covariance(
        self, dwell: Dwells, vector: Float[Array, " parameters"], more: Scalar | float = 0.0
    ) -> Float[Array, "2 2"]:
        """Of both residuals, T², by the dwell's own noise: ∂r₁/∂m' = (E + S)⁻ᵀ m / ‖m‖, ∂r₂/∂m' = (E + S)⁻ᵀ u; with
        `more` variance of each output (T²)."""
        up, field = _up(dwell), self._field(vector, dwell)
        transposed = (jnp.eye(3, dtype=vector.dtype) + self.unpack(vector).matrix).T
        rows = jnp.stack([solve3(transposed, d) for d in (field / jnp.linalg.norm(field), up)])
        outputs = jnp.asarray(dwell.mag_covariance) + more * jnp.eye(3)
        spread = rows @ outputs @ rows.T
        if dwell.accel is None:
            return spread
        # The vertical is known as well as the accelerometers tell it: δu = (E − u uᵀ) δa / ‖a‖.
        lever = (field - (field @ up) * up) / jnp.linalg.norm(jnp.asarray(dwell.accel))
        return spread.at[1, 1].add(lever @ jnp.asarray(dwell.accel_covariance) @ lever)

    def compensate(self, vector: Float[AnyArray, " parameters"], dwell: Dwells) -> Dwells:
        """m = (E + S)⁻¹ (m' − b − c I), and the covariance of the mean with it."""
        vector = jnp.asarray(vector)
        spread = transform_covariance(jnp.asarray(self.unpack(vector).matrix), dwell.mag_covariance)
        refined = self._field(vector, dwell), spread
        return eqx.tree_at(lambda d: (d.mag, d.mag_covariance), dwell, refined)

    def compose(
        self, first: Float[AnyArray, " parameters"], second: Float[AnyArray, " parameters"]
    ) -> Float[Array, " parameters"]:
        """Equation (6); the second stage was estimated beside no current that the first left over."""
        one, two = self.unpack(first), self.unpack(second)
        affine = compose_accel(
            AccelerometerErrors(one.bias, one.matrix), AccelerometerErrors(two.bias, two.matrix)
        )
        current = jnp.asarray(one.current) + two.current + one.matrix @ two.current
        whole = self.pack(MagnetometerErrors(affine.bias, affine.matrix, current))
        return whole.at[-1].set(jnp.asarray(second)[-1])

    @classmethod
    def usable(cls, dwells: Dwells) -> Dwells:
        """All dwells: the field is the same while the device turns, whose samples have `position` −1."""
        return dwells

    def start(self, dwells: Dwells) -> Float[Array, " parameters"]:
        """The ellipsoid's, in the frame of the triad itself (S lower triangular); see `turned`.

        Outputs are centred first, since hard iron may be larger than the field.
        """
        outputs, valid = jnp.asarray(dwells.mag), jnp.asarray(dwells.valid)
        kept = jnp.where(valid[:, None], outputs, jnp.nan)
        middle = 0.5 * (jnp.nanmin(kept, axis=0) + jnp.nanmax(kept, axis=0))
        found = ellipsoid_start(outputs - middle[None, :], valid, self.field)
        lower = jnp.zeros((3, 3), found.dtype).at[np.tril_indices(3)].set(found[3:])
        return self.pack(MagnetometerErrors(middle + found[:3], lower, jnp.zeros(3)))


def _rests(dwell: Dwells) -> Bool[Array, ""]:
    """Whether the vertical is known."""
    return (jnp.asarray(dwell.position) >= 0) & (dwell.accel is not None)


def _up(dwell: Dwells) -> Float[Array, "3"]:
    """Direction of the specific force; anything where it is not known."""
    if dwell.accel is None:
        return jnp.array([0.0, 0.0, 1.0])
    force = jnp.asarray(dwell.accel)
    return force / jnp.linalg.norm(force)


def turn_to_vertical(
    fields: Float[np.ndarray, "rest 3"], up: Float[np.ndarray, "rest 3"]
) -> tuple[Float[np.ndarray, "3 3"], float]:
    """The rotation R that makes (R m) · u the same at every rest, and that part F_u; in closed form.

    uᵀ R m − F_u = 0 is linear in the nine elements of R and in F_u: the singular vector of the smallest singular value,
    scaled to det R = 1 and drawn to the nearest rotation. Where rows of both signs fit, that of a rotation.

    **Arguments:** `fields` (T) of constant magnitude, in any frame fixed to the device; `up`, unit vectors in the frame
    wanted. Ten rests or more in different orientations determine the rotation.

    ```python
    import numpy as np
    from inertiax.estimators.magnetic_field import turn_to_vertical

    up = np.random.default_rng(1).normal(size=(20, 3))
    up /= np.linalg.norm(up, axis=1, keepdims=True)
    level = np.cross(up, [0.3, -0.5, 0.8])
    fields = 2e-5 * level / np.linalg.norm(level, axis=1, keepdims=True) - 4e-5 * up
    turn, vertical = turn_to_vertical(fields, up)
    assert np.allclose(turn, np.eye(3)) and np.isclose(vertical, -4e-5)
    ```
    """
    size = np.median(np.linalg.norm(fields, axis=1))
    products = np.einsum("ni,nj->nij", up, fields / size).reshape(len(up), 9)
    design = np.column_stack([products, -np.ones(len(up))])
    null = np.linalg.svd(design)[2][-1]
    matrix, vertical = null[:9].reshape(3, 3), null[9]
    determinant = np.linalg.det(matrix)
    scale = np.cbrt(determinant) if determinant != 0.0 else 1.0
    left, _, right = np.linalg.svd(matrix / scale)
    turn = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
    return turn, float(size * vertical / scale)
