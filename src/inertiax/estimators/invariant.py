"""The invariant accelerometer estimator: at rest, the specific force has magnitude g.

    r = (‖(E + Γ)⁻¹ (a' − a⁰)‖ − g) / σ,   Γ lower triangular; 9 parameters

With `misalignments` False Γ is diagonal: 6 parameters, which six faces determine. On a face a misalignment m
changes |a| by g m²/2 only.

No orientation has to be known (paper's ref. [6], Egorov and Dzuev 2016).

**Gauge.** Only |a| is used, so a rotation of the whole triad against the case is unobservable; it is
fixed by taking Γ lower triangular: the first accelerometer's axis *is* the x axis of the frame, the
second lies in its xy plane. Misalignment of the triad to the case or the table needs `reference`.
"""

from typing import ClassVar

import numpy as np
from jaxtyping import Float

from .._jax import Array, jnp
from .._records import field
from .._typing import AnyArray, Scalar
from ..numerics.linear_algebra import cholesky, cholesky_solve
from ..physics.error_model import AccelerometerErrors, compensate_accel
from ..physics.leaves import as_array, is_traced
from ..reduction.dwells import Dwells
from .base import soften
from .triads import AccelEstimator


_ROWS = (0, 1, 1, 2, 2, 2)
_COLUMNS = (0, 0, 1, 0, 1, 2)


class Invariant(AccelEstimator):
    """‖compensated output‖ = g at rest; bias (3) and lower-triangular Γ (6). See the module.

    Raises `ValueError` for a gravity that is not above zero.
    """

    by_magnitude: ClassVar[bool] = True

    gravity: Scalar = field(converter=as_array)  # m/s²
    scatter: Scalar = field(converter=as_array, default=0.0)  # m/s², 1 sigma
    robust: float | None = field(static=True, default=None)  # pseudo-Huber threshold, sigmas
    misalignments: bool = field(static=True, default=True)  # False: Γ is diagonal

    def __check_init__(self):
        if not is_traced(self.gravity) and not np.all(np.asarray(self.gravity) > 0.0):
            raise ValueError(
                f"`Invariant(gravity=...)`: {self.gravity:g}; it is the size of gravity, above 0 m/s² and about 9.8."
            )

    @property
    def _elements(self) -> tuple[tuple[int, ...], tuple[int, ...]]:
        """Rows and columns of Γ's free elements."""
        return (_ROWS, _COLUMNS) if self.misalignments else ((0, 1, 2), (0, 1, 2))

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(f"accel.bias[{i}]" for i in range(3)) + tuple(
            f"accel.matrix[{i},{j}]" for i, j in zip(*self._elements, strict=True)
        )

    def unpack(self, vector: Float[AnyArray, " parameters"]) -> AccelerometerErrors:
        vector = jnp.asarray(vector)
        rows, columns = self._elements
        matrix = jnp.zeros((3, 3), vector.dtype).at[jnp.array(rows), jnp.array(columns)]
        return AccelerometerErrors(vector[:3], matrix.set(vector[3:]))

    def pack(self, errors: AccelerometerErrors) -> Float[Array, " parameters"]:
        matrix, (rows, columns) = jnp.asarray(errors.matrix), self._elements
        return jnp.concatenate(
            [jnp.asarray(errors.bias), matrix[jnp.array(rows), jnp.array(columns)]]
        )

    def residual(
        self, vector: Float[AnyArray, " parameters"], dwell: Dwells
    ) -> Float[Array, " rows"]:
        misfit, sigma = self.misfit(vector, dwell)
        total = jnp.sqrt(jnp.square(sigma) + jnp.square(self.scatter))
        return soften(misfit / total, self.robust)

    def misfit(
        self, vector: Float[AnyArray, " parameters"], dwell: Dwells
    ) -> tuple[Float[Array, " rows"], Float[Array, " rows"]]:
        output = jnp.asarray(dwell.accel)
        direction = output / jnp.linalg.norm(output)
        variance = direction @ jnp.asarray(dwell.accel_covariance) @ direction
        force = compensate_accel(self.unpack(vector), output)
        return (jnp.linalg.norm(force) - self.gravity)[None], _safe_sqrt(variance)[None]

    def start(self, dwells: Dwells) -> Float[Array, " parameters"]:
        """The ellipsoid's, or zero where Γ is diagonal: faces alone determine no ellipsoid."""
        outputs = jnp.asarray(dwells.accel)
        if not self.misalignments:
            return jnp.zeros(self.num_parameters, outputs.dtype)
        return ellipsoid_start(outputs, jnp.asarray(dwells.valid), self.gravity)


def _safe_sqrt(x: Array) -> Array:
    # sqrt has an infinite derivative at 0, which would turn into NaN where a dwell has no noise.
    positive = x > 0
    return jnp.where(
        positive, jnp.sqrt(jnp.where(positive, x, jnp.ones_like(x))), jnp.zeros_like(x)
    )


def ellipsoid_start(
    outputs: Float[Array, "dwells 3"], valid: Array, gravity: Scalar | float
) -> Float[Array, "9"]:
    """Closed-form parameters from the ellipsoid that the outputs at rest lie on.

    ‖L (a' − a⁰)‖² = g² with L = (E + Γ)⁻¹ is a quadric x ᵀA x + 2 vᵀx = 1 in x = a'/g, linear in its
    nine coefficients; then a⁰ = −g A⁻¹ v and LᵀL = A / (1 + vᵀA⁻¹v). It minimises an algebraic
    distance, so it is only a start. Where the quadric is no ellipsoid (too few or badly placed
    positions) the identity is returned and the solve is left to find out.

    **Reference:** Li & Griffiths, *Least squares ellipsoid specific fitting*, GMP 2004.
    """
    x = outputs / gravity
    x0, x1, x2 = x[:, 0], x[:, 1], x[:, 2]
    columns = [x0**2, x1**2, x2**2, 2 * x0 * x1, 2 * x0 * x2, 2 * x1 * x2, 2 * x0, 2 * x1, 2 * x2]
    design = jnp.stack(columns, axis=1) * jnp.asarray(valid, x.dtype)[:, None]
    normal = design.T @ design
    right = design.T @ jnp.asarray(valid, x.dtype)
    q = cholesky_solve(cholesky(normal), right)
    shape = jnp.stack(
        [
            jnp.stack([q[0], q[3], q[4]]),
            jnp.stack([q[3], q[1], q[5]]),
            jnp.stack([q[4], q[5], q[2]]),
        ]
    )
    v = q[6:]
    centre = -cholesky_solve(cholesky(shape), v)
    form = shape / (1.0 - v @ centre)
    # LᵀL = form with L lower: Cholesky of the form with both axes reversed, reversed back.
    reversed_factor = cholesky(form[::-1, ::-1])
    inverse_matrix = reversed_factor[::-1, ::-1].T
    matrix = _inverse_lower3(inverse_matrix)
    vector = jnp.concatenate(
        [
            gravity * centre,
            jnp.stack(
                [
                    matrix[i, j] - (1.0 if i == j else 0.0)
                    for i, j in zip(_ROWS, _COLUMNS, strict=True)
                ]
            ),
        ]
    )
    return jnp.where(jnp.all(jnp.isfinite(vector)), vector, jnp.zeros_like(vector))


def _inverse_lower3(lower: Float[Array, "3 3"]) -> Float[Array, "3 3"]:
    zero = jnp.zeros((), lower.dtype)
    d0, d1, d2 = 1.0 / lower[0, 0], 1.0 / lower[1, 1], 1.0 / lower[2, 2]
    i10 = -lower[1, 0] * d0 * d1
    i21 = -lower[2, 1] * d1 * d2
    i20 = -(lower[2, 0] * d0 + lower[2, 1] * i10) * d2
    return jnp.stack(
        [jnp.stack([d0, zero, zero]), jnp.stack([i10, d1, zero]), jnp.stack([i20, i21, d2])]
    )
