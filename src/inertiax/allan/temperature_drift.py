"""What the temperature does to a log at rest, which in a spectrum looks like random walk, ramp or flicker.

No log tells a drift with temperature from a random walk that went the same way. Where the output follows the
temperature, the slow terms have no value; the compensated log tells them.
"""

import dataclasses

import numpy as np
from jaxtyping import Float

from .model import NoiseModel, NoiseTerm
from .stored_channel import Log


MOVED = 2.0  # °C in the rest, from which it matters (convention)
BLOCKS = 64  # means of the rest, of output and of temperature
DEGREE = 3  # of the drift over temperature, as flight controllers' corrections have it
FOLLOWS = (
    0.5  # of the means' scatter, from which the output follows; white noise gets there once in 10¹⁰
)
SLOW = ("B", "K", "R")


def follows_temperature(log: Log, temperature: Float[np.ndarray, " row"]) -> bool:
    """Whether most of what the means of a rest scatter by is a cubic of the temperature.

    **Arguments:** both cover the same rest, with equal steps of their own.
    """
    if np.ptp(temperature) <= MOVED or len(log) < 2 * BLOCKS or len(temperature) < 2 * BLOCKS:
        return False
    output, probe = _means(log), _means(temperature)
    x = 2.0 * (probe - probe.min()) / np.ptp(probe) - 1.0
    columns = np.polynomial.chebyshev.chebvander(x, DEGREE)
    left = output - columns @ np.linalg.lstsq(columns, output, rcond=None)[0]
    return bool(np.var(left) < (1.0 - FOLLOWS) * np.var(output))


def _means(log: Log) -> Float[np.ndarray, " block"]:
    edges = np.arange(BLOCKS + 1) * len(log) // BLOCKS
    return np.array([log[a:b].mean() for a, b in zip(edges[:-1].tolist(), edges[1:].tolist())])


def without_slow_terms(model: NoiseModel) -> NoiseModel:
    """The model without values of B, K and R; they are no greater than the fit had them at most."""
    untold = {
        name: NoiseTerm(None, None, 0.0, model.terms[name].upper) if name in SLOW else term
        for name, term in model.terms.items()
    }
    return dataclasses.replace(model, terms=untold)
