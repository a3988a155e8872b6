"""What an estimator is: a residual for one dwell, and the algebra to iterate on it.

An estimator treats the parameters of one triad at one temperature as a flat vector. It knows
how to read that vector (`unpack`), what one dwell's whitened residual is, how to refine a dwell's
outputs with given parameters (block 3 of the paper's figure 1) and how parameters estimated in two
stages combine (equation 6, block 5).
"""

import abc
from typing import ClassVar, Generic, TypeVar

from jaxtyping import Float

from .._jax import Array, eqx, jax, jnp
from .._typing import AnyArray, Mat3, Scalar
from ..physics.error_model import AccelerometerErrors, GyroErrors, solve3
from ..physics.magnetic_model import MagnetometerErrors
from ..reduction.dwells import Dwells


Errors = TypeVar(
    "Errors",
    AccelerometerErrors,
    GyroErrors,
    tuple[AccelerometerErrors, GyroErrors],
    MagnetometerErrors,
)


class AbstractEstimator(eqx.Module, Generic[Errors]):
    """Interface of the estimators; each states its gauge (what stays unobservable) in its docs."""

    triad: eqx.AbstractClassVar[str]  # "accel", "gyro", "imu" or "mag"
    by_reference: ClassVar[bool] = (
        False  # its rows need what an ideal triad reads, in motion as well
    )
    by_magnitude: ClassVar[bool] = (
        False  # one row a dwell, of the magnitude, instead of one a channel
    )
    scatter: eqx.AbstractVar[Scalar]  # extra 1-sigma of every dwell, m/s² or rad/s

    @property
    @abc.abstractmethod
    def names(self) -> tuple[str, ...]:
        """Names of the parameters, in order, e.g. `accel.bias[0]` or `gyro.matrix[2,1]`."""

    @abc.abstractmethod
    def unpack(self, vector: Float[AnyArray, " parameters"]) -> Errors:
        """The vector as the triad's error parameters."""

    @abc.abstractmethod
    def pack(self, errors: Errors) -> Float[Array, " parameters"]:
        """Inverse of `unpack` for errors of the estimator's own form."""

    @abc.abstractmethod
    def residual(
        self, vector: Float[AnyArray, " parameters"], dwell: Dwells
    ) -> Float[Array, " rows"]:
        """Whitened residual of one dwell: unit variance where the noise model is right."""

    @abc.abstractmethod
    def misfit(
        self, vector: Float[AnyArray, " parameters"], dwell: Dwells
    ) -> tuple[Float[Array, " rows"], Float[Array, " rows"]]:
        """Misfit of one dwell in SI units, and its standard deviation by the dwell's own noise."""

    @abc.abstractmethod
    def compensate(self, vector: Float[AnyArray, " parameters"], dwell: Dwells) -> Dwells:
        """The dwell with its outputs refined by the parameters, equation (3)."""

    @abc.abstractmethod
    def compose(
        self, first: Float[AnyArray, " parameters"], second: Float[AnyArray, " parameters"]
    ) -> Float[Array, " parameters"]:
        """Equation (6): `second` was estimated on dwells compensated with `first`."""

    @abc.abstractmethod
    def start(self, dwells: Dwells) -> Float[Array, " parameters"]:
        """Closed-form approximation from all dwells (block 2): a start for the solve."""

    @classmethod
    def usable(cls, dwells: Dwells) -> Dwells:
        """The dwells with `valid` only where this estimator may read them, one device's or many's, traced or not.

        At a constant rate (`position` −1) lever arms add centripetal force and the axes turn through gravity, so that
        only an estimator with a reference for the motion uses those rows; the others use rests. A hand that holds a
        device turns it and pushes it nowhere for long: of rests that are `held` only the magnitude of the force counts.
        """
        by_hand = None if cls.by_magnitude else dwells.held
        if cls.by_reference and by_hand is None:
            return dwells
        valid = dwells.valid if cls.by_reference else dwells.valid & (dwells.position >= 0)
        valid = valid if by_hand is None else valid & ~by_hand
        return eqx.tree_at(lambda d: d.valid, dwells, valid)

    @property
    def num_parameters(self) -> int:
        """Length of the parameter vector."""
        return len(self.names)


# Where neither the recording nor the rig tells how noisy a dwell is, all dwells weigh the same and
# the scale comes from the residuals; any positive number serves as the provisional sigma.
NOMINAL_SIGMA = 1e-3  # m/s² or rad/s


def soften(residual: Float[Array, " rows"], threshold: float | None) -> Float[Array, " rows"]:
    """Pseudo-Huber loss as a residual: r̃ = r √(2 / (1 + √(1 + (r/δ)²))).

    ½ r̃² = δ² (√(1 + (r/δ)²) − 1), quadratic below δ standard deviations and linear above, smooth
    everywhere, so that Gauss-Newton and implicit differentiation go on as before. `None`: r̃ = r.

    **Reference:** Hartley & Zisserman, *Multiple View Geometry*, 2nd ed., A6.8.
    """
    if threshold is None:
        return residual
    return residual * jnp.sqrt(2.0 / (1.0 + jnp.sqrt(1.0 + jnp.square(residual / threshold))))


def whiten(covariance: Mat3 | None, scatter: Scalar | float, residual: Array) -> Float[Array, "3"]:
    """L⁻¹ r with L Lᵀ = covariance + scatter² E: three residuals of unit variance.

    Written out in scalars (3 × 3), for `vmap` over many dwells without LAPACK.
    """
    c = _given(covariance)
    extra = jnp.square(jnp.asarray(scatter))
    l00 = jnp.sqrt(c[0, 0] + extra)
    l10, l20 = c[1, 0] / l00, c[2, 0] / l00
    l11 = jnp.sqrt(c[1, 1] + extra - l10**2)
    l21 = (c[2, 1] - l20 * l10) / l11
    l22 = jnp.sqrt(c[2, 2] + extra - l20**2 - l21**2)
    w0 = residual[0] / l00
    w1 = (residual[1] - l10 * w0) / l11
    w2 = (residual[2] - l20 * w0 - l21 * w1) / l22
    return jnp.stack([w0, w1, w2])


def diagonal_sigmas(covariance: Mat3 | None) -> Float[Array, "3"]:
    """Standard deviations of the three means; for reporting, not for differentiation."""
    return jax.lax.stop_gradient(jnp.sqrt(jnp.diagonal(_given(covariance))))


def _given(covariance: Mat3 | None) -> Float[Array, "3 3"]:
    # Dwells carry outputs and their covariance together, or neither.
    assert covariance is not None
    return jnp.asarray(covariance)


def transform_covariance(
    matrix: Float[Array, "3 3"], covariance: Float[AnyArray, "3 3"] | None
) -> Float[Array, "3 3"] | None:
    """Covariance of (E + matrix)⁻¹ x from that of x, for |matrix| well below 1."""
    if covariance is None:
        return None
    m = jnp.eye(3, dtype=matrix.dtype) + matrix
    columns = jax.vmap(lambda c: solve3(m, c), in_axes=1, out_axes=1)
    return columns(columns(jnp.asarray(covariance)).T)


def check_estimator(call: str, estimator: object) -> None:
    """Raise `ValueError` for what is no estimator: the class without its arguments, or something else."""
    if isinstance(estimator, AbstractEstimator):
        return
    if isinstance(estimator, type):
        name = estimator.__name__
        raise ValueError(f"`{call}`: {name} is a class; give it its arguments, `{name}(…)`.")
    raise ValueError(
        f"`{call}`: {type(estimator).__name__} is no estimator; give one such as `Invariant(gravity=9.81)`."
    )
