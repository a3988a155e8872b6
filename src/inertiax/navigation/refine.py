"""The calibration as a filter's run leaves it: coefficients and covariance after what the run has shown.

With c the estimated coefficients (prior mean m, covariance C_cc, posterior mean m + d, covariance P) and b the
others, these
follow by their prior correlation, G = C_bc C_cc⁻¹:

    b ← b + G d,     C_bb ← C_bb − G (C_cc − P) Gᵀ,     C_bc ← G P
"""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..calibration.calibration import Calibration
from .filter import Filter
from .filter_state import FilterState


def coefficient_covariance(
    filter_: Filter, state: FilterState
) -> Float[Array, "*runs states states"]:
    """Joint covariance of the estimated coefficients in SI, in the order of `filter_.names`."""
    scale = jnp.asarray(filter_.model.states.scale)
    count = scale.shape[0]
    size = state.covariance.shape[-1]
    block = jnp.asarray(state.covariance)[..., size - count :, size - count :]
    return block * (scale[:, None] * scale[None, :]).astype(block.dtype)


def refined(filter_: Filter, state: FilterState) -> Calibration:
    """The calibration after a run, to be written by `write_calibration` like any other.

    **Arguments:** `state` is the run's last, `track.last`. What the drift states hold is left out: it is noise of
    this run, and not the device's at the next one.

    Raises `ValueError` for the states of several runs, and for a filter with `thermal=False`, whose constants are
    not the calibration's coefficients.
    """
    if jnp.ndim(state.covariance) > 2:
        raise ValueError(
            f"`refined(filter_, state)`: the state holds {jnp.shape(state.covariance)[:-2]} runs, but this is for one; "
            f"use `jax.tree.map(lambda x: x[k], state)`."
        )
    states = filter_.model.states
    if not states.thermal:
        raise ValueError(
            "`refined(filter_, state)`: the filter was made with thermal=False; its constants are not coefficients of "
            "the calibration. Use `Filter(thermal=True)`."
        )
    calibration = filter_.calibration
    move = np.concatenate([np.asarray(m, float) for m in states.split(state.estimate.calibration)])
    after = np.asarray(coefficient_covariance(filter_, state), float)
    chosen, prior = np.array(states.rows, int), np.asarray(calibration.covariance, float)
    other = np.setdiff1d(np.arange(len(prior)), chosen)
    inside, across = prior[np.ix_(chosen, chosen)], prior[np.ix_(other, chosen)]
    gain = across @ _inverse(inside)
    values = np.array(calibration.coefficients, float)
    values[chosen] += move
    values[other] += gain @ move
    new = prior.copy()
    new[np.ix_(chosen, chosen)] = after
    new[np.ix_(other, chosen)] = gain @ after
    new[np.ix_(chosen, other)] = (gain @ after).T
    new[np.ix_(other, other)] -= gain @ (inside - after) @ gain.T
    moved = calibration.with_values("*", jnp.asarray(values))
    return moved.with_covariance(jnp.asarray(0.5 * (new + new.T)))


def _inverse(matrix: np.ndarray) -> np.ndarray:
    """Inverse over the directions that vary at all: a covariance may hold coefficients exactly."""
    scale = np.sqrt(np.diagonal(matrix))
    scale = np.where(scale > 0.0, scale, 1.0)
    # Relative to the largest eigenvalue of a correlation matrix, rounding is n eps; a thousand times that is none.
    cut = 1e3 * len(matrix) * np.finfo(float).eps
    return np.linalg.pinv(matrix / np.outer(scale, scale), rcond=cut, hermitian=True) / np.outer(
        scale, scale
    )
