"""The fixed-interval smoother of a filter's run: every time's estimate from the measurements of the whole run.

It is Rauch, Tung and Striebel's smoother in Bryson and Frazier's form, which inverts no covariance of the state. A
calibration's covariance may therefore be singular, and constants (the calibration) cost nothing. Going back from the
end with
λ = 0, Λ = 0, through each update (gain K, slope H, innovation y, its covariance S) and each segment (transition F),

    λ ← −Hᵀ S⁻¹ y + (E − KH)ᵀ λ,    Λ ← Hᵀ S⁻¹ H + (E − KH)ᵀ Λ (E − KH);    λ ← Fᵀ λ,    Λ ← Fᵀ Λ F

    x_s = x_f − P_f λ,    P_s = P_f − P_f Λ P_f

**References:** Rauch, Tung and Striebel, AIAA J. 3 (1965) 1445-1450; Bierman, "Fixed interval smoothing with discrete
measurements", Int. J. Control 18 (1973) 65-75 (the modified Bryson-Frazier form and its equality to the former).
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .checks import check_one_run
from .filter import Correction, Track
from .filter_state import Estimate, NAVIGATION, retract
from .segment import Transition


class Smoothed(eqx.Module):
    """Estimates at the segments' ends from all measurements; the calibration's are the same at every time."""

    time: Float[Array, "*runs segments"]  # s
    estimate: Estimate
    # Of attitude, velocity, position and drift states.
    covariance: Float[Array, "*runs segments d d"]

    @property
    def sigma(self) -> Float[Array, "*runs segments 9"]:
        """Standard deviations of tilts and heading (rad), velocity (m/s) and position (m)."""
        return jnp.sqrt(jnp.diagonal(self.covariance, axis1=-2, axis2=-1))[..., :NAVIGATION]


def smooth(track: Track) -> Smoothed:
    """Smooth a run: the fixed-interval estimates at the ends of its segments.

    Raises `ValueError` for several runs in one track, which it is to be mapped over.
    """
    check_one_run("smooth(track)", track.time, "`jax.vmap(smooth)(track)`")
    return _smooth(track)


@eqx.filter_jit
def _smooth(track: Track) -> Smoothed:
    size, changing = track.rows.shape[2], track.rows.shape[1]
    dtype = track.rows.dtype

    def back(adjoint: tuple[Array, Array], inputs: tuple):
        estimate, rows, transition, corrections = inputs
        moved, covariance = _smoothed(estimate, rows, *adjoint)
        for correction in reversed(corrections):
            adjoint = _through_correction(correction, *adjoint)
        return _through_transition(transition, *adjoint), (moved, covariance)

    end = (jnp.zeros(size, dtype), jnp.zeros((size, size), dtype))
    inputs = (track.estimate, track.rows, track.transition, track.corrections)
    _, (estimate, covariance) = jax.lax.scan(back, end, inputs, reverse=True)
    constants = jnp.broadcast_to(
        jnp.asarray(track.last.estimate.calibration)[None], estimate.calibration.shape
    )
    del changing
    return Smoothed(track.time, Estimate(estimate.navigation, estimate.slow, constants), covariance)


def _smoothed(
    estimate: Estimate, rows: Array, value: Array, information: Array
) -> tuple[Estimate, Array]:
    """x_f − P λ and P − P Λ P of the states that change."""
    count = rows.shape[0]
    move = -(rows @ value)
    padded = jnp.concatenate([move, jnp.zeros(rows.shape[1] - count, move.dtype)])
    covariance = rows[:, :count] - rows @ information @ rows.T
    return retract(estimate, padded), 0.5 * (covariance + covariance.T)


def _through_correction(
    correction: Correction, value: Array, information: Array
) -> tuple[Array, Array]:
    """Back through an update: first its turn of the error's axes, then its gain."""
    n = NAVIGATION
    turn = correction.reset
    value = jnp.concatenate([turn.T @ value[:n], value[n:]])
    information = jnp.concatenate([turn.T @ information[:n], information[n:]])
    information = jnp.concatenate([information[:, :n] @ turn, information[:, n:]], axis=1)
    gain, slope = correction.gain, correction.slope
    value = value - slope.T @ (correction.weighted + gain.T @ value)
    left = information - slope.T @ (gain.T @ information)
    left = left - (left @ gain) @ slope
    return value, left + slope.T @ correction.information @ slope


def _through_transition(
    transition: Transition, value: Array, information: Array
) -> tuple[Array, Array]:
    """Fᵀ λ and Fᵀ Λ F with F = [[Φ, B], [0, diag(decay, 1)]]."""
    n = NAVIGATION
    top = jnp.concatenate([transition.navigation, transition.others], axis=1)
    constants = jnp.ones(value.shape[0] - n - transition.decay.shape[0], value.dtype)
    decay = jnp.concatenate([jnp.zeros(n, value.dtype), transition.decay, constants])
    carried = top.T @ value[:n] + decay * value
    half = top.T @ information[:n] + decay[:, None] * information
    whole = half[:, :n] @ top + half * decay[None, :]
    return carried, 0.5 * (whole + whole.T)
