"""What else than the IMU tells of the state: positions, velocities, standstills, attitudes, any residual function.

An update holds one row per segment, at the segments' ends: the value, its standard deviations, and whether there is
one.
Its residual r(state, value), measured less predicted, is all that it adds; derivatives are JAX's.
"""

import abc
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from .._typing import AnyArray
from ..physics import rotation
from .filter_state import Estimate, NAVIGATION, retract


class AbstractUpdate(eqx.Module):
    """One kind of measurement, with a row per segment.

    `sigma` is above zero: one number, one a component, or one row a segment. Where `valid` is false there is no
    measurement, and the value may be anything, NaN too. Where `gate` is given, a row whose normalised innovation
    squared is above it is left out (for three components 16.3 leaves out one in a thousand good ones).
    """

    value: eqx.AbstractVar[AnyArray]
    sigma: eqx.AbstractVar[AnyArray | float]
    valid: eqx.AbstractVar[Bool[AnyArray, " segments"] | None]
    gate: eqx.AbstractVar[float | None]

    @abc.abstractmethod
    def residual(self, estimate: Estimate, value: Array) -> Float[Array, " components"]:
        """Measured less predicted."""

    @property
    @abc.abstractmethod
    def neutral(self) -> Float[np.ndarray, "..."]:
        """What stands where there is no measurement, so that derivatives are finite."""

    @property
    def navigation_only(self) -> bool:
        """Whether the residual depends on attitude, velocity and position alone."""
        return True


class Rows(eqx.Module):
    """An update as arrays with a leading axis of segments."""

    value: Float[Array, "segments ..."]
    variance: Float[Array, "segments components"]
    valid: Bool[Array, " segments"]


def rows_of(update: AbstractUpdate, segments: int, like: Array) -> Rows:
    """An update's rows in the precision of `like`. Raises `ValueError` for another number of rows or other
    components."""
    value = jnp.asarray(update.value, like.dtype)
    name = type(update).__name__
    if value.shape[0] != segments:
        raise ValueError(
            f"`{name}(value=...)` has {value.shape[0]} rows, but the data have {segments} segments; give one row a "
            f"segment and `valid` for those without measurement."
        )
    if value.ndim != 1 + update.neutral.ndim or (
        update.neutral.size > 1 and value.shape[1:] != update.neutral.shape
    ):
        raise ValueError(
            f"`{name}(value=...)` has shape {value.shape}; it must be ({segments}, "
            f"{', '.join(map(str, update.neutral.shape))})."
        )
    if update.valid is not None and jnp.shape(update.valid) != (segments,):
        raise ValueError(
            f"`{name}(valid=...)` has shape {jnp.shape(update.valid)}; it must be ({segments},)."
        )
    valid = jnp.ones(segments, bool) if update.valid is None else jnp.asarray(update.valid)
    mask = valid.reshape(-1, *(1,) * (value.ndim - 1))
    value = jnp.where(mask, value, jnp.asarray(update.neutral, like.dtype)[None])
    count = 3 if value.ndim == 3 else value.shape[1]
    sigma = jnp.asarray(update.sigma, like.dtype)
    if sigma.ndim > 2 or (sigma.ndim and sigma.shape[-1] not in (1, count)):
        raise ValueError(
            f"`{name}(sigma=...)` has shape {sigma.shape}; it must be a number, ({count},) or "
            f"({segments}, {count})."
        )
    sigma = jnp.broadcast_to(
        sigma.reshape((1,) * (2 - sigma.ndim) + sigma.shape), (segments, count)
    )
    # The same for the standard deviations of absent rows.
    variance = jnp.where(valid[:, None], sigma, jnp.ones_like(sigma)) ** 2
    return Rows(value, variance, valid)


def innovation(
    update: AbstractUpdate, estimate: Estimate, value: Array
) -> tuple[Float[Array, " m"], Float[Array, "m n"]]:
    """A row's residual y and H = −∂y/∂(error of the estimate)."""
    count = NAVIGATION + estimate.slow.shape[0] + estimate.calibration.shape[0]
    asked = NAVIGATION if update.navigation_only else count
    dtype = jnp.asarray(estimate.navigation.position).dtype

    def of_error(error: Array) -> tuple[Array, Array]:
        padded = jnp.concatenate([error, jnp.zeros(count - asked, dtype)])
        y = update.residual(retract(estimate, padded), value)
        return y, y

    slope, y = jax.jacfwd(of_error, has_aux=True)(jnp.zeros(asked, dtype))
    empty = jnp.zeros((y.shape[0], count - asked), dtype)
    return y, -jnp.concatenate([slope, empty], axis=1)


class Position(AbstractUpdate):
    """Positions in the level frame, m, of the IMU or of an antenna `lever_arm` (m, case axes) from it."""

    value: Float[AnyArray, "segments 3"]  # m
    sigma: AnyArray | float  # m
    valid: Bool[AnyArray, " segments"] | None = None
    gate: float | None = None
    lever_arm: Float[AnyArray, "3"] | None = None  # m

    @property
    def neutral(self) -> Float[np.ndarray, "..."]:
        """Zero."""
        return np.zeros(3)

    def residual(self, estimate: Estimate, value: Array) -> Float[Array, "3"]:
        """Fix less predicted position."""
        predicted = jnp.asarray(estimate.navigation.position)
        if self.lever_arm is not None:
            arm = jnp.asarray(self.lever_arm, predicted.dtype)
            predicted = predicted + jnp.asarray(estimate.navigation.attitude) @ arm
        return value - predicted


class Velocity(AbstractUpdate):
    """Velocities over ground, east, north and up, m/s."""

    value: Float[AnyArray, "segments 3"]  # m/s
    sigma: AnyArray | float  # m/s
    valid: Bool[AnyArray, " segments"] | None = None
    gate: float | None = None

    @property
    def neutral(self) -> Float[np.ndarray, "..."]:
        """Zero."""
        return np.zeros(3)

    def residual(self, estimate: Estimate, value: Array) -> Float[Array, "3"]:
        """Measured less predicted velocity."""
        return value - estimate.navigation.velocity


def zero_velocity(
    standing: Bool[AnyArray, " segments"], sigma: float = 0.01, *, gate: float | None = None
) -> Velocity:
    """Standstills: zero velocity at the ends of the segments that `standing` marks, to `sigma` m/s."""
    return Velocity(jnp.zeros((len(standing), 3)), sigma, jnp.asarray(standing), gate)


class Attitude(AbstractUpdate):
    """Attitudes as case-to-level matrices; `sigma` is of their small rotations about the level axes, rad."""

    value: Float[AnyArray, "segments 3 3"]
    sigma: AnyArray | float  # rad
    valid: Bool[AnyArray, " segments"] | None = None
    gate: float | None = None

    @property
    def neutral(self) -> Float[np.ndarray, "..."]:
        """No rotation."""
        return np.eye(3)

    def residual(self, estimate: Estimate, value: Array) -> Float[Array, "3"]:
        """Rotation vector from the predicted to the measured attitude, level axes, rad."""
        return rotation.log(value @ jnp.asarray(estimate.navigation.attitude).T)


class Residual(AbstractUpdate):
    """Any measurement: `function(estimate, value)` is what was measured less what the estimate predicts.

    Independent components with standard deviations `sigma`; the estimate's fields are `navigation` (attitude,
    velocity, position), `slow` and `calibration` (states in their units, see `Filter`).
    """

    function: Callable[[Estimate, Array], Array] = eqx.field(static=True)
    value: Float[AnyArray, "segments components"]
    sigma: AnyArray | float
    valid: Bool[AnyArray, " segments"] | None = None
    gate: float | None = None

    @property
    def neutral(self) -> Float[np.ndarray, "..."]:
        """Zero: choose a function that is smooth there, or fill absent rows yourself."""
        return np.zeros(1)

    @property
    def navigation_only(self) -> bool:
        """It may depend on every state."""
        return False

    def residual(self, estimate: Estimate, value: Array) -> Array:
        """The user's function."""
        return self.function(estimate, value)


def on_segments(
    times: Float[np.ndarray, " fixes"], ends: Float[np.ndarray, " segments"], *, tolerance: float
) -> tuple[np.ndarray, np.ndarray]:
    """Which fix stands at each segment's end, and whether one does.

    **Arguments:** `times` of the fixes and `ends` of the segments in s on one clock; a fix may be `tolerance` s off.
    **Returns** indices into the fixes and a mask, one a segment: `Position(fixes[index], sigma, mask)`.

    Raises `ValueError` for a fix inside the data that is at no segment's end: choose segments that fit the fixes.
    """
    times, ends = np.asarray(times, float), np.asarray(ends, float)
    near = np.abs(times[:, None] - ends[None, :])
    inside = (times > ends[0] - tolerance) & (times < ends[-1] + tolerance)
    lost = np.flatnonzero(inside & (near.min(axis=1) > tolerance))
    if len(lost):
        raise ValueError(
            f"`on_segments(times, ends)`: {len(lost)} fixes are at no segment's end, the first at {times[lost[0]]:g} "
            f"s, "
            f"{near[lost[0]].min():.2g} s from the nearest; choose segments whose ends are the fixes' times."
        )
    index = near.argmin(axis=0)
    return index, near.min(axis=0) <= tolerance
