"""How many rests a target needs, said before one begins, by the noise that a rest's mean may have.

Nothing is known of the device but the priors, and s is the standard deviation of a rest's mean: noise and scatter from
rest to rest together. The n rests are planned together (`next_position`), each is followed 10° off, and n is the least
for which

    t_ν(q) s_i ≤ t_i     for each parameter i that is asked for,     ν = n r − p,

with s_i its standard deviation by the rows alone, t_i its limit, r rows a rest, p unknowns and q the quantile that
holds all limits together with 95 %. No fewer are counted than a session makes before it may stop.
"""

import dataclasses
import math

import numpy as np
from scipy.special import stdtrit

from ..physics.directions import hand_directions
from ..storage.wrong_value import WrongValue
from .accel_rows import AccelModel, prior_std
from .estimate import FEWEST_FREEDOM, limits_of
from .next_position import (
    followed,
    joint_quantile,
    MOST_AHEAD,
    Part,
    planned_limits,
    planned_shares,
    spread_after,
)
from .target import Target


TURN = 4.0  # s that a hand takes from rest to rest (convention)
# Of the noise of a rest's mean, in the accelerometers' tightest limit: what is asked about where nobody says the noise.
USUAL = (0.1, 0.25, 0.5, 1.0, 2.0)


@dataclasses.dataclass(frozen=True)
class Ahead:
    """The rests for one noise."""

    noise: float  # m/s², standard deviation of a rest's mean
    rests: int | None  # `None`: more than a person makes


def rests_ahead(target: Target, model: AccelModel, grade: str | None, noise: float) -> Ahead:
    """How many rests the accelerometers' part of a target needs, where a rest's mean has this noise (m/s²).

    Raises `WrongValue` where the target asks nothing of the accelerometers.
    """
    limits = limits_of(model.names, target)
    if not np.isfinite(limits).any():
        raise WrongValue(
            "--plan: the target asks nothing of the accelerometers; rests of gyros are not forecast."
        )
    covariance = np.diag(prior_std(model, grade) ** 2)
    start, up = np.zeros(len(limits)), hand_directions()
    around = followed(up)
    rows = model.tried(start, around.reshape(-1, 3))
    per_rest, unknowns = rows.shape[1], rows.shape[2]
    part = Part(covariance, limits, rows.reshape(*around.shape[:2], per_rest, -1), noise**2)
    exact = model.tried(start, up)[:, None]
    asked = planned_limits(model.names, limits, model.gravity)
    share = planned_shares([Part(covariance, asked, exact, noise**2)])
    quantile = joint_quantile([part])

    def reached(rests: int) -> bool:
        worst = spread_after(part, share, rests)
        return bool(stdtrit(rests * per_rest - unknowns, quantile) * worst <= 1.0)

    low = math.ceil((unknowns + FEWEST_FREEDOM) / per_rest)
    if reached(low):
        return Ahead(noise, low)
    high = int(MOST_AHEAD)
    if not reached(high):
        return Ahead(noise, None)
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if reached(middle) else (middle, high)
    return Ahead(noise, high)


def usual_noises(target: Target, model: AccelModel) -> list[float]:
    """Noises about the tightest limit of the accelerometers, m/s²; a limit of the matrix counts at 1 g."""
    limits = limits_of(model.names, target)
    sizes = [
        limit * (1.0 if ".bias" in name else model.gravity)
        for name, limit in zip(model.names, limits)
    ]
    return [share * float(min(sizes)) for share in USUAL]
