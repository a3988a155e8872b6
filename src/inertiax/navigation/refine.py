"""The calibration as a filter's run leaves it: coefficients and covariance after what the run has shown.

With c the estimated coefficients (prior mean m, covariance C_cc, posterior mean m + d, covariance P) and b the others of the
same triad, the others follow by their prior correlation, G = C_bc C_cc⁻¹:

    b ← b + G d,     C_bb ← C_bb − G (C_cc − P) Gᵀ,     C_bc ← G P

The accelerometers' and the gyros' coefficients come out correlated with each other, which a calibration's two covariances do
not hold; `coefficient_covariance` has it.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..calibration.calibration import Calibration, TriadCalibration
from .calibration_states import place_of, TriadStates
from .filter import Filter
from .filter_state import FilterState


def coefficient_covariance(filter_: Filter, state: FilterState) -> Float[Array, "states states"]:
    """Joint covariance of the estimated coefficients in SI, in the order of `filter_.names`."""
    scale = jnp.asarray(filter_.model.states.scale)
    count = scale.shape[0]
    size = state.covariance.shape[0]
    block = jnp.asarray(state.covariance)[size - count :, size - count :]
    return block * (scale[:, None] * scale[None, :]).astype(block.dtype)


def refined(filter_: Filter, state: FilterState) -> Calibration:
    """The calibration after a run, to be written by `write_calibration` like any other.

    **Arguments:** `state` is the run's last, `track.last`. What the drift states hold is left out: it is noise of
    this run, and not the device's at the next one.

    Raises `ValueError` for a filter with `thermal=False`, whose constants are not the calibration's coefficients.
    """
    states = filter_.model.states
    if not states.thermal:
        raise ValueError(
            "`refined(filter_, state)`: the filter was made with thermal=False; its constants are not coefficients of "
            "the calibration. Use `Filter(thermal=True)`."
        )
    moves = states.split(state.estimate.calibration)
    covariance = coefficient_covariance(filter_, state)
    count = len(states.accel.places)
    blocks = (covariance[:count, :count], covariance[count:, count:])
    calibration = filter_.calibration
    for name, move, block in zip(("accel", "gyro"), moves, blocks, strict=True):
        triad = getattr(calibration, name)
        if triad is not None and move.shape[0]:
            new = _refined_triad(triad, getattr(states, name), np.asarray(move), np.asarray(block))
            calibration = eqx.tree_at(lambda c, k=name: getattr(c, k), calibration, new)
    return calibration


def _refined_triad(
    triad: TriadCalibration, states: TriadStates, move: np.ndarray, after: np.ndarray
) -> TriadCalibration:
    parameters = {place_of(n): k for k, n in enumerate(triad.names)}
    size = len(triad.names)
    chosen = np.array([a * size + parameters[(i, c)] for a, i, c in states.places])
    prior = np.asarray(triad.covariance, float)
    other = np.setdiff1d(np.arange(len(prior)), chosen)
    inside, across = prior[np.ix_(chosen, chosen)], prior[np.ix_(other, chosen)]
    gain = across @ _inverse(inside)
    values = np.asarray(triad.curve.coefficients, float).reshape(-1)
    values[chosen] += move
    values[other] += gain @ move
    new = prior.copy()
    new[np.ix_(chosen, chosen)] = after
    new[np.ix_(other, chosen)] = gain @ after
    new[np.ix_(chosen, other)] = (gain @ after).T
    new[np.ix_(other, other)] -= gain @ (inside - after) @ gain.T
    coefficients = jnp.asarray(values.reshape(-1, size))
    where = lambda t: [t.curve.coefficients, t.covariance]
    return eqx.tree_at(where, triad, [coefficients, jnp.asarray(0.5 * (new + new.T))])


def _inverse(matrix: np.ndarray) -> np.ndarray:
    """Inverse over the directions that vary at all: a covariance may hold coefficients exactly."""
    scale = np.sqrt(np.diagonal(matrix))
    scale = np.where(scale > 0.0, scale, 1.0)
    # Relative to the largest eigenvalue of a correlation matrix, rounding is n eps; a thousand times that is none.
    cut = 1e3 * len(matrix) * np.finfo(float).eps
    return np.linalg.pinv(matrix / np.outer(scale, scale), rcond=cut, hermitian=True) / np.outer(
        scale, scale
    )
