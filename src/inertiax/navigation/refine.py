"""The calibration as a filter's run leaves it: coefficients and covariance after what the run has shown.

With c the estimated coefficients (prior mean m, covariance C_cc, posterior mean m + d, covariance P) and b the
others, these
follow by their prior correlation, G = C_bc C_cc⁻¹:

    b ← b + G d,     C_bb ← C_bb − G (C_cc − P) Gᵀ,     C_bc ← G P

which is L P Lᵀ + (what is left where c is known), L = (1, G).
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..calibration.calibration import Calibration
from ..calibration.coefficients import conditional, regression
from ..physics.leaves import is_traced
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
    this run, and not the device's at the next one. `jit` and `vmap` over runs serve; outside of them the arithmetic is
    in 64 bits.

    Raises `ValueError` for the states of several runs without `vmap`, and for a filter with `thermal=False`, whose
    constants are not the calibration's coefficients.
    """
    if jnp.ndim(state.covariance) > 2:
        raise ValueError(
            f"`refined(filter_, state)`: the state holds {jnp.shape(state.covariance)[:-2]} runs, but this is for one; "
            f"use `jax.vmap(lambda state: refined(filter_, state))(state)`."
        )
    states = filter_.model.states
    if not states.thermal:
        raise ValueError(
            "`refined(filter_, state)`: the filter was made with thermal=False; its constants are not coefficients of "
            "the calibration. Use `Filter(thermal=True)`."
        )
    calibration = filter_.calibration
    traced = any(is_traced(x) for x in jax.tree.leaves((state, states, calibration)))
    number = jnp.asarray if traced else lambda x: np.asarray(x, float)
    mean, prior = number(calibration.coefficients), calibration.covariance
    # A prior that is known stays in 64 bits in traced code, too.
    prior = prior if is_traced(prior) else np.asarray(prior, float)
    move = number(jnp.concatenate(states.split(state.estimate.calibration)))
    after = number(coefficient_covariance(filter_, state))
    known = mean[np.array(states.rows, int)] + move
    values, left = conditional(mean, prior, states.rows, known)
    gain = number(regression(prior, states.rows)[0])
    spread = gain @ after @ gain.T + number(left)
    return calibration.with_values("*", values).with_covariance(0.5 * (spread + spread.T))
