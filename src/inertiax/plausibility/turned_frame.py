r"""One triad turned against the other within a log: a device that was opened, or two that were taped together anew.

With U the rotation that the gyros integrate over a motion and $u_1, u_2$ gravity's directions before and after it, a
small rotation $\rho$ of the accelerometers' frame against the gyros' leaves, to first order,

$$u_2 - U u_1 = ([u_2]_\times - U [u_1]_\times) \rho.$$

A constant $\rho$ is a misalignment, which the calibration fits, as it fits the gyros' scale factors and the
accelerometers' biases, which turn the directions that these read by as many milliradians as they have 0.01 m/s²: their
columns stand beside it. One before and another one after some moment are compared with that by an F test at the best
moment, times the number of moments (Bonferroni).
"""

import math

import numpy as np
import scipy.special
from jaxtyping import Float

from ..physics.vectors import cross_matrix
from ..reduction.turned_direction import turned
from .evidence import Log
from .finding import Finding, finding
from .thresholds import Thresholds
from .turns import Motions


_SIDE = 4  # motions on either side: 8 rows for 3 unknowns (convention)
_STEP = 1e-3  # of the scale factors' differences


def turned_frame(logs: tuple[Log, ...], motions: Motions, limits: Thresholds) -> list[Finding]:
    """A warning where the rotation between the triads changes once, in motions in the order of time."""
    count = motions.count
    if count < 2 * _SIDE:
        return []
    right, design, others = _rows(motions)
    later = np.zeros_like(design)
    kept, _ = _fit(np.concatenate([others, design], axis=2), right)
    fits = {}
    for split in range(_SIDE, count - _SIDE + 1):
        later[:split], later[split:] = 0.0, design[split:]
        fits[split] = _fit(np.concatenate([others, design, later], axis=2), right)
    at = min(fits, key=lambda k: fits[k][0])
    left, solution = fits[at]
    freedom = 2 * count - 12  # two rows a motion: directions have no length
    ratio = (kept - left) / 3.0 / max(left / freedom, 1e-300)
    chance = len(fits) * float(scipy.special.fdtrc(3, freedom, ratio))
    change = solution[9:]
    angle = float(np.linalg.norm(change))
    if chance > limits.turned_by_chance or angle < limits.turned_frame:
        return []
    about = "xyz"[int(np.argmax(np.abs(change)))]
    begins = motions.began if len(logs) == 1 else ()
    when = f"motion {at + 1}" if not begins else logs[0].moment(begins[at])
    name = logs[0].name if len(logs) == 1 else f"{logs[0].name} and {len(logs) - 1} more"
    return [
        finding(
            "remounted",
            "warning",
            "accel",
            f"{name}: from about {when} on the accelerometers are turned by {math.degrees(angle):.1f}° against the "
            f"gyros, mostly about {about}, by gravity's turns in {at} motions before and {count - at} after: one was "
            "mounted anew; calibrate both parts for themselves.",
            angle=angle,
            rotation=tuple(float(v) for v in change),
            motions_before=at,
            motions_after=count - at,
            chance=chance,
        )
    ]


def _rows(
    motions: Motions,
) -> tuple[
    Float[np.ndarray, "motion 3"], Float[np.ndarray, "motion 3 3"], Float[np.ndarray, "motion 3 6"]
]:
    """What each motion misses of gravity's turn, and what a small rotation between the triads changes of that, and the
    gyros' scale factors with the accelerometers' biases."""
    turn, before = turned(motions.angle), motions.before
    ends = lambda by: np.einsum("mij,mj->mi", turned(motions.angle * by), before)
    missed = motions.after - np.einsum("mij,mj->mi", turn, before)
    pair = lambda k: (ends(1.0 + _STEP * np.eye(3)[k]) - ends(1.0 - _STEP * np.eye(3)[k])) / 2.0
    scales = np.stack([pair(k) / _STEP for k in range(3)], axis=2)
    across = lambda u: np.eye(3) - u[:, :, None] * u[:, None, :]
    biases = across(motions.after) - turn @ across(before)
    others = np.concatenate([scales, biases], axis=2)
    return missed, cross_matrix(motions.after) - turn @ cross_matrix(before), others


def _fit(
    design: Float[np.ndarray, "motion 3 unknown"], right: Float[np.ndarray, "motion 3"]
) -> tuple[float, Float[np.ndarray, " unknown"]]:
    """Sum of squares that a least squares leaves, and its solution."""
    rows = design.reshape(-1, design.shape[2])
    solution = np.linalg.lstsq(rows, right.reshape(-1), rcond=1e-9)[0]
    return float(np.sum(np.square(right.reshape(-1) - rows @ solution))), solution
