"""What a station promises of its positions and rates, as covariances of dwells against their reference.

A positioning that is off by small independent angles of standard deviation α turns the reference u by α × u, and a
rate that is off by the part ρ scales it:

    C = α² (|u|² E − u uᵀ) + ρ² u uᵀ
"""

import equinox as eqx
import numpy as np
from jaxtyping import Float

from ..data.recording import Rig
from .dwells import Dwells


def rig_covariance(
    reference: Float[np.ndarray, "*dwell 3"], angle: float, rate: float = 0.0
) -> Float[np.ndarray, "*dwell 3 3"]:
    """Covariance of the reference, in its unit squared.

    **Arguments:** `reference` in m/s² or rad/s; `angle` of each positioning, rad, and `rate`, a part of the reference,
    both 1 sigma.
    """
    outer = reference[..., :, None] * reference[..., None, :]
    square = np.sum(np.square(reference), axis=-1)[..., None, None]
    return angle**2 * (square * np.eye(3) - outer) + rate**2 * outer


def with_rig_errors(dwells: Dwells, rig: Rig) -> Dwells:
    """The dwells with the errors of their reference in the covariances of their means; any leading axes."""
    angle, rate = rig.position_uncertainty or 0.0, rig.rate_uncertainty or 0.0
    for triad, part in (("accel", 0.0), ("gyro", rate)):
        reference = getattr(dwells, f"reference_{triad}")
        own = getattr(dwells, f"{triad}_covariance")
        if reference is None or own is None or not (angle or part):
            continue
        wider = np.asarray(own) + rig_covariance(np.asarray(reference), angle, part)
        dwells = eqx.tree_at(lambda d, t=triad: getattr(d, f"{t}_covariance"), dwells, wider)
    return dwells
