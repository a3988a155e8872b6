"""What lagging elements take from the calibration beside them: they were at other temperatures than the probe's.

The outputs without a lag are compared with the model at the probe's temperature, and what was taken away is made of the
model's own parameters θ. They are known as the elements' temperatures tell them: a range that the probe reached and the
elements did not is extrapolated, whatever was taken away there. With the columns X of the parameters and the white
noise as weights W the covariance is

    C + D (N_s − N_p) D,    N = (XᵀWX)⁻¹,

at the elements' temperatures (s) and at the probe's (p). D scales N_p to the variances that the fit has, with what
dwells differ by beyond their white noise.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from ..candidates.signatures import Term
from ..element_temperature import bilinear
from ..noise.observation_series import System
from ..problem import Prepared
from .separable import at_element


def extrapolated(
    prepared: Prepared,
    terms: Sequence[Term],
    covariance: Float[np.ndarray, "unknowns unknowns"],
    count: int,
) -> Float[np.ndarray, "unknowns unknowns"]:
    """What is added to the `covariance` of `count` parameters, whose coefficients are row-major (size, parameters)."""
    mine = [t for t in terms if bilinear(t)]
    size = len(covariance) // count
    if not mine or size == 1:
        return np.zeros_like(covariance)
    system = prepared.system
    values = (
        system.base.coefficients
    )  # the model is linear: its columns are those of any parameters
    told = _inverse(at_element(prepared, mine, (), values), count, size)
    taken = _inverse(system, count, size)
    known = np.sqrt(np.maximum(np.diagonal(covariance), 0.0))
    scale = known / np.sqrt(np.maximum(np.diagonal(taken), 1e-300))
    # In units of the fit's standard deviations, where biases and scale factors are alike.
    unit = np.where(known > 0.0, known, 1.0)
    more = scale[:, None] * (told - taken) * scale / unit[:, None] / unit
    worth, direction = np.linalg.eigh(0.5 * (more + more.T))
    # Where elements tell more than the probe's temperatures promise, what is written stays.
    more = (direction * np.maximum(worth, 0.0)) @ direction.T
    return unit[:, None] * more * unit


def _inverse(system: System, count: int, size: int) -> Float[np.ndarray, "unknowns unknowns"]:
    """(XᵀWX)⁻¹ of the calibration's coefficients, beside what else the rows have parameters of."""
    base = system.base
    total = 1 + max(int(index.max()) for index in base.index)
    normal = np.zeros((total, total))
    for chain, columns, index in zip(system.chains, base.columns, base.index, strict=True):
        normal[np.ix_(index, index)] += columns.T @ (columns / chain.white[:, None])
    norm = np.sqrt(np.maximum(np.diagonal(normal), 1e-300))
    inverse = np.linalg.pinv(normal / norm[:, None] / norm, rcond=1e-12, hermitian=True)
    inverse = inverse / norm[:, None] / norm
    number, power = np.divmod(np.arange(total), size)
    own = number < count  # lever arms are effects of the calibration, no parameters of the triad
    made = np.zeros((size * count, size * count))
    place = power[own] * count + number[own]
    made[np.ix_(place, place)] = inverse[np.ix_(own, own)]
    return made
