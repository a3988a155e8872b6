"""Draws of the fitted noise, for p-values of statistics whose distribution no table gives."""

import numpy as np
from jaxtyping import Float

from .state_space import Chain, TIME_CONSTANTS, Variances, WANDER


def draw(
    chain: Chain, variances: Variances, draws: int, rng: np.random.Generator
) -> Float[np.ndarray, "block draw"]:
    """Rows of one chain under given variances, in the rows' unit: the noise that `whiten` makes white."""
    num, channels = chain.loads.shape
    white, flicker, walk, dwell, cycle, probe, rig = (
        float(v)
        for v in (
            variances.white, variances.flicker, variances.walk, variances.dwell, variances.cycle,
            variances.probe, variances.rig,
        )
    )  # fmt: skip
    made = rng.standard_normal((num, draws)) * np.sqrt(white * chain.white)[:, None]
    if np.array_equal(chain.new_positioning, chain.new_dwell):  # one draw is for both
        both = chain.rig + chain.rig_of_dwell
        made += _held(chain.new_dwell, np.sqrt(dwell + rig * both), draws, rng)
    else:
        own = np.sqrt(dwell + rig * chain.rig_of_dwell)
        made += _held(chain.new_dwell, own, draws, rng)
        made += _held(chain.new_positioning, np.sqrt(rig * chain.rig), draws, rng)
    for c in range(channels):
        slow = _held(chain.new_cycle, np.full(num, np.sqrt(cycle)), draws, rng)
        steps = rng.standard_normal((num, draws)) * np.sqrt(walk * chain.gap)[:, None]
        slow += np.cumsum(steps, axis=0) + _relaxations(
            chain.gap, TIME_CONSTANTS, flicker, draws, rng
        )
        made += chain.loads[:, c, None] * slow
    for heated in chain.heated.T:
        error = _held(chain.new_cycle, np.full(num, np.sqrt(probe)), draws, rng)
        error += _relaxations(chain.gap, (WANDER,), probe, draws, rng)
        made += heated[:, None] * error
    return made


def _held(
    new: np.ndarray, sigma: np.ndarray, draws: int, rng: np.random.Generator
) -> Float[np.ndarray, "block draw"]:
    """A level drawn afresh wherever `new` says so, and held until then."""
    first = np.flatnonzero(new > 0.0)
    which = np.cumsum(new > 0.0) - 1
    return rng.standard_normal((len(first), draws))[which] * sigma[first][which][:, None]


def _relaxations(
    gap: np.ndarray,
    time_constants: tuple[float, ...],
    variance: float,
    draws: int,
    rng: np.random.Generator,
) -> Float[np.ndarray, "block draw"]:
    """Sum of Gauss-Markov processes in equilibrium."""
    decay = np.exp(-gap[:, None] / np.asarray(time_constants))
    decay[0] = 0.0
    state = np.zeros((decay.shape[1], draws))
    made = np.empty((len(gap), draws))
    spread = np.sqrt(variance * (1.0 - decay**2))
    for k in range(len(gap)):
        fresh = rng.standard_normal(state.shape)
        state = decay[k][:, None] * state + spread[k][:, None] * fresh
        made[k] = state.sum(axis=0)
    return made
