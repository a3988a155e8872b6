"""Whether the magnetometers' samples in motion say the same in the first half of a log and in the second.

Neighbours err alike, which their memory holds. Iron that is near by for one half and not for the other, or a hard iron
that changes, is in no correlation of neighbours: each half agrees with itself, and the two differ.
"""

import numpy as np
from jaxtyping import Float

from ..numerics.linear_algebra import scaled_inverse
from .magnetic_memory import Memory


FEWEST = 200  # samples in motion; each half has ten times as many as unknowns then
_CHANCE = 1e-3  # by which halves that say the same differ as far


def spread_of_halves(
    moving: Float[np.ndarray, "row unknown"],
    left: Float[np.ndarray, " row"],
    memory: Memory,
    alike: float,
) -> Float[np.ndarray, "unknown unknown"]:
    """What two states, one a half, add to the covariance of the answer that they have in common: ¼ δ δᵀ, where chance
    makes no such difference δ, else zero. A state's variance is δ²/2, and that of the mean of two half of it.

    With δ_h = (J_hᵀJ_h)⁻¹ J_hᵀ r_h, one step of each half from the common answer,

        δ = δ_1 − δ_2,   χ² = δᵀ (V_1 + V_2)⁻¹ δ,   V_h = (J_hᵀJ_h)⁻¹ J_hᵀ R J_h / τ (J_hᵀJ_h)⁻¹.

    **Arguments:** whitened design and misfits of the samples in their order, their memory R, and τ. Zero where a
    half does not determine the unknowns.
    """
    unknowns = moving.shape[1]
    none = np.zeros((unknowns, unknowns))
    if len(moving) < FEWEST:
        return none
    steps, spreads = [], []
    for rows in np.array_split(np.arange(len(moving)), 2):
        own = moving[rows]
        bread = scaled_inverse(own.T @ own)
        if not np.all(np.isfinite(bread)):
            return none
        steps.append(bread @ (own.T @ left[rows]))
        spreads.append(bread @ (own.T @ memory.applied(own) / alike) @ bread)
    apart = steps[0] - steps[1]
    inverse = scaled_inverse(spreads[0] + spreads[1])
    if not np.all(np.isfinite(inverse)):
        return none
    from scipy.special import chdtri  # loaded where it is asked, as in `magnetic_memory`

    square = float(apart @ inverse @ apart)
    return 0.25 * np.outer(apart, apart) if square > float(chdtri(unknowns, _CHANCE)) else none
