"""What a change of the force does to gyros that feel it, by the g-sensitivity that was estimated."""

import jax
import jax.numpy as jnp
from jaxtyping import Array

from ..estimators import AbstractEstimator, ReferenceGyroRig
from ..estimators.triads import GyroEstimator
from ..physics.temperature import Curve
from ..reduction.dwells import Dwells


def by_force(
    estimator: AbstractEstimator, curve: Curve, dwells: Dwells, change: Array | None
) -> Array | None:
    """What a change of the force adds to gyros that feel it: D Δa / g."""
    if change is None or not feels_force(estimator):
        return None
    assert isinstance(estimator, GyroEstimator | ReferenceGyroRig)
    gravity = estimator.gravity

    def one(temperature: Array, felt: Array) -> Array:
        return jnp.asarray(estimator.unpack(curve(temperature)).g_sensitivity) @ (felt / gravity)

    return jax.vmap(one)(jnp.asarray(dwells.temperature), change)


def feels_force(estimator: AbstractEstimator) -> bool:
    """Whether gyros are estimated that the force acts on."""
    return estimator.triad == "gyro" and bool(getattr(estimator, "g_sensitivity", False))
