"""What a filter knows at one time: attitude, velocity and position, noise and calibration states, covariance.

The error of the first three is the left-invariant one of SE₂(3), its axes turned to the level frame:

    X = X̂ exp(Ĉᵀ ζ),   that is   C = exp(θ) Ĉ,   v = v̂ + J(θ) ν,   p = p̂ + J(θ) ρ,   ζ = (θ, ν, ρ)

A position fix is then linear in ζ whatever the state is, and the covariance reads in plain terms: tilts and heading
(rad), velocity (m/s) and position (m), east, north, up. The further states' errors are differences.
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._typing import AnyArray
from ..physics import rotation
from .se23 import ExtendedPose, left_jacobian, so3_left_jacobian, so3_left_jacobian_inverse


NAVIGATION = 9  # states of attitude, velocity and position


class Estimate(eqx.Module):
    """The means; leading axes are times."""

    navigation: ExtendedPose
    slow: Float[AnyArray, "*time slow"]  # drift states, see `process`
    calibration: Float[AnyArray, "*time states"]  # see `calibration_states`


class FilterState(eqx.Module):
    """Means and covariance of the errors (ζ, drift states, calibration states)."""

    estimate: Estimate
    covariance: Float[AnyArray, "n n"]


def retract(estimate: Estimate, error: Float[AnyArray, " n"]) -> Estimate:
    """The state that lies `error` from an estimate."""
    pose, e = estimate.navigation, jnp.asarray(error)
    jacobian = so3_left_jacobian(e[:3])
    count = NAVIGATION + estimate.slow.shape[-1]
    return Estimate(
        ExtendedPose(
            rotation.exp(e[:3]) @ jnp.asarray(pose.attitude),
            pose.velocity + jacobian @ e[3:6],
            pose.position + jacobian @ e[6:9],
        ),
        estimate.slow + e[NAVIGATION:count],
        estimate.calibration + e[count:],
    )


def navigation_error(state: ExtendedPose, estimate: ExtendedPose) -> Float[Array, "9"]:
    """ζ of a state from an estimate of it: tilts and heading (rad), velocity (m/s), position (m)."""
    theta = rotation.log(jnp.asarray(state.attitude) @ jnp.asarray(estimate.attitude).T)
    inverse = so3_left_jacobian_inverse(theta)
    off = [jnp.asarray(getattr(state, k)) - getattr(estimate, k) for k in ("velocity", "position")]
    return jnp.concatenate([theta, inverse @ off[0], inverse @ off[1]])


def reset_jacobian(error: Float[AnyArray, "9"]) -> Float[Array, "9 9"]:
    """∂(error from the moved estimate)/∂(error from the old one), where the estimate moved by `error`:
    diag(exp θ) J_r(ζ). Without it a covariance would still refer to the old attitude's axes."""
    e = jnp.asarray(error)
    turn = rotation.exp(e[:3])
    right = left_jacobian(-e)
    return jnp.concatenate([turn @ right[3 * k : 3 * k + 3] for k in range(3)])
