"""Lever arms that a plan does not show: held at zero, and as uncertain as the others are long.

Turning about a case axis shows, of accelerometer i, the arm along its own axis alone. Along other axes it shows arms by
what the device stands askew, [Γ (ω × (ω × R))]_i: they are estimated where that tells them better than the others' size
does. What is held may still be that long, and so spoils the arms that are estimated: their covariance holds it.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float

from ..numerics.linear_algebra import scaled_inverse
from ..procedure.rank import TOLERANCE
from ..procedure.single_device import Problem


# Standard deviation, relative to the others' size, up to which an arm is estimated: beyond a third the data hardly tell
# more than that chips sit together (convention).
_TOLD = 1.0 / 3.0

_Free = Bool[np.ndarray, "size parameter"]
_Coefficients = Float[np.ndarray, "size parameter"]
_Normal = Float[np.ndarray, "unknowns unknowns"]


def without_unseen_arms(problem: Problem, free: _Free) -> _Free:
    """The unknowns without lever arms that no dwell shows of a device along the case, by the rule of `procedure.rank`.

    A plateau about a case axis shows accelerometer i's arm along i alone: [ω × (ω × R_i)]_i = ω_i (ω·R_i) − ω² R_ii.
    """
    arms = _arms(problem.estimator.names)
    if not arms.any():
        return free
    jacobian = problem.at(np.zeros(free.shape)).jacobian
    size = np.linalg.norm(jacobian.reshape(-1, len(arms)), axis=0)
    return free & ~(arms & (size < TOLERANCE * size[arms].max()))


def with_arms_told(
    names: Sequence[str], coefficients: _Coefficients, normal: _Normal, free: _Free
) -> _Free:
    """The unknowns with those lever arms that the device's misalignment shows; `normal` is JᵀJ of all coefficients."""
    arms = _arms(names)
    if not np.any(arms & free[0]) or not np.any(arms & ~free[0]):
        return free
    size = np.sqrt(_square(arms, coefficients, normal, free))
    told = free.copy()
    told[0] |= arms & (np.diagonal(normal)[: len(arms)] > 0.0)
    while np.any(told[0] & ~free[0]):
        own = np.flatnonzero(told.ravel())
        sigma = np.zeros(free.size)
        sigma[own] = np.sqrt(np.diagonal(scaled_inverse(normal[np.ix_(own, own)])))
        added = np.where(told[0] & ~free[0], sigma[: len(arms)], 0.0)
        worst = int(np.argmax(added))
        if added[worst] < _TOLD * size:
            break
        told[0, worst] = False
    return told


def covariance_beside(
    names: Sequence[str], coefficients: _Coefficients, normal: _Normal, free: _Free
) -> Float[np.ndarray, "unknowns unknowns"]:
    r"""Covariance of all coefficients, zero for those that are held at zero but for lever arms.

    Of unknowns f and arms x that are held, as long as the others in the mean square, $P_x$: with
    $K = (J_f^T J_f)^{-1} J_f^T J_x$ it is $(J_f^T J_f)^{-1} + K P_x K^T$ of the unknowns, $-K P_x$ between both.

    **Reference:** consider parameters, Tapley, Schutz and Born, *Statistical Orbit Determination* (2004), ch. 6.
    """
    own = np.flatnonzero(free.ravel())
    plain = scaled_inverse(normal[np.ix_(own, own)])
    result = np.zeros((free.size, free.size))
    result[np.ix_(own, own)] = plain
    arms = _arms(names)
    held = np.flatnonzero(arms & ~free[0])
    if len(held) == 0 or not np.any(arms & free[0]):
        return result
    square = _square(arms, coefficients, normal, free)
    gain = plain @ normal[np.ix_(own, held)]
    result[np.ix_(own, own)] += square * (gain @ gain.T)
    result[np.ix_(own, held)] = -square * gain
    result[np.ix_(held, own)] = -square * gain.T
    result[held, held] = square
    return result


def _arms(names: Sequence[str]) -> Bool[np.ndarray, " parameter"]:
    return np.array(["lever_arm" in name for name in names])


def _square(
    arms: Bool[np.ndarray, " parameter"], coefficients: _Coefficients, normal: _Normal, free: _Free
) -> float:
    """Mean square of the arms that are estimated, m², their variances counted in."""
    own = np.flatnonzero(free.ravel())
    variance = np.zeros(free.size)
    variance[own] = np.diagonal(scaled_inverse(normal[np.ix_(own, own)]))
    seen = arms & free[0]
    return float(np.mean(np.square(coefficients[0, seen]) + variance[: len(arms)][seen]))
