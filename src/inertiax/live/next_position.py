"""Where to turn next: the direction of gravity that brings the parameters soonest to their targets, in words.

What is far from its target counts: with standard deviations s_i and limits t_i the distance is

    Φ = (Σ (s_i / t_i)^p)^(1/p),   p = 6,

nearly the worst ratio, but smooth, so that a direction that helps one of several bad parameters is worth something.
What lowers Φ most in one rest is not what reaches the target in the fewest, so the n rests that are still needed are
planned together: the share w_c of each direction is what brings Φ lowest after all of them,

    Λ = Λ₀ + n Σ_c w_c M_c,   M_c = mean of J_cᵀ J_c / v over how a person follows, about 10° off,

by the multiplicative algorithm w_c ← w_c d_c^½ / Σ w d^½ of the gain d_c = tr(M_c Λ⁻¹ G Λ⁻¹), G the derivative of Φ^p
by the variances. The direction of the greatest share comes next. The plan is made anew after every rest.

A rest narrows intervals twice: by its rows, and by what they tell of the noise. Intervals at a quantile q are t_ν(q)
standard deviations wide, Student's with the ν degrees of freedom of the noise, so that r rows more make them narrower
by t_(ν+r)(q) / t_ν(q) besides (`narrowing`): 7 % from 5 to 6 degrees of freedom, 1 % from 15 to 16.

**Reference:** Silvey, Titterington and Torsney, "An algorithm for optimal designs on a finite design space",
Communications in Statistics A 7 (1978) 1379.
"""

import dataclasses

import numpy as np
from jaxtyping import Float
from scipy.special import ndtri, stdtrit

from ..physics.directions import up_in_words
from .target import CONFIDENCE


POWER = 6.0
FOLLOWED = np.radians(10.0)  # how far off a hand is from what it was told (convention)
# A misalignment that the rests tell no better than this is left out by the batch estimate (see
# `calibrate.accelerometers.MISALIGNED`), which must not happen after the target is said to be reached.
MISALIGNED = 0.01  # rad
_AROUND = 6  # directions on that circle
_NEARLY = 0.03  # of the share: among directions this near the best, the easiest to hold is told
MOST_AHEAD = 500.0  # rests that are planned together
_ROUNDS, _STEPS = 3, 30  # of the plan: how many rests, and the shares for so many


@dataclasses.dataclass(frozen=True, eq=False)
class Part:
    """Parameters that are known together, and the rows that each candidate would add."""

    covariance: Float[np.ndarray, "parameter parameter"]
    limits: Float[np.ndarray, " parameter"]  # ∞ where nothing is asked
    rows: Float[np.ndarray, "candidate around row parameter"]
    variance: float  # of one row
    freedom: float = np.inf  # degrees of freedom with which that is known

    @property
    def asks(self) -> bool:
        """Whether any parameter has a limit."""
        return bool(np.isfinite(self.limits).any())


@dataclasses.dataclass(frozen=True)
class NextPosition:
    """A direction of the specific force in the case, what it gains, and how to say it."""

    up: tuple[float, float, float]
    statement: str
    gain: float  # share by which the distance Φ shrinks, 0 to 1
    temperature: float | None = None  # °C that the chamber is to reach
    rate: float | None = None  # rad/s at which the table is to turn
    further: int | None = None  # rests that are still needed, as forecast; `None`: not known


def followed(up: Float[np.ndarray, "candidate 3"]) -> Float[np.ndarray, "candidate around 3"]:
    """Directions on a circle about each, as a person follows them."""
    least = np.eye(3)[np.argmin(np.abs(up), axis=1)]
    first = np.cross(up, least)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    second = np.cross(up, first)
    angle = 2.0 * np.pi * np.arange(_AROUND) / _AROUND
    across = np.cos(angle)[:, None] * first[:, None] + np.sin(angle)[:, None] * second[:, None]
    return np.cos(FOLLOWED) * up[:, None] + np.sin(FOLLOWED) * across


def best_position(
    candidates: Float[np.ndarray, "candidate 3"],
    parts: list[Part],
    share: Float[np.ndarray, " candidate"],
) -> NextPosition:
    """The candidate of the greatest share in the plan; among those nearly as good the first, which is the easiest.

    `share` is that of `planned_shares`. Raises `ValueError` where no part asks for anything.
    """
    if not any(p.asks for p in parts):
        raise ValueError("`best_position(parts)`: no parameter has a limit.")
    good = np.flatnonzero(share >= (1.0 - _NEARLY) * share.max())
    best = int(good[0])
    before = sum(_powers(np.diagonal(p.covariance), p.limits) for p in parts)
    quantile = joint_quantile(parts)
    after = sum(
        _powers(_variances(p, best), p.limits)
        * narrowing(p.freedom, p.rows.shape[2], quantile) ** POWER
        for p in parts
    )
    distance = np.mean(np.power(after, 1.0 / POWER)) / np.power(before, 1.0 / POWER)
    x, y, z = (float(c) for c in np.round(candidates[best], 6))
    return NextPosition((x, y, z), in_words(candidates[best]), float(np.clip(1.0 - distance, 0, 1)))


def planned_limits(
    names: tuple[str, ...], limits: Float[np.ndarray, " parameter"], gravity: float
) -> Float[np.ndarray, " parameter"]:
    """Limits that the plan is made for, with those of elements of the matrix that nobody asked for.

    Such an element ε of the matrix is felt as ε sin α in a position that is off by α, and in no position that is held
    exactly: the plan wants it known as well as what is asked for is, at the angle by which a person is off.
    """
    asked = np.isfinite(limits)
    if not asked.any():
        return limits
    matrix = np.array([".matrix" in name for name in names])
    least = np.min(limits[asked] / np.where(matrix[asked], 1.0, gravity))
    beside = min(least / np.sin(FOLLOWED), MISALIGNED)
    return np.where(matrix & ~asked, beside, limits)


def joint_quantile(parts: list[Part]) -> float:
    """The quantile whose interval holds each error often enough for all that are asked for to be held with
    `CONFIDENCE`."""
    asked = sum(int(np.isfinite(p.limits).sum()) for p in parts)
    return 0.5 + 0.5 * CONFIDENCE ** (1.0 / asked)


def narrowing(freedom: float, rows: int, quantile: float) -> float:
    """By how much intervals narrow for what further rows tell of the noise, at most 1."""
    if not np.isfinite(freedom):
        return 1.0
    return float(stdtrit(freedom + rows, quantile) / stdtrit(freedom, quantile))


def spread_after(part: Part, share: Float[np.ndarray, " candidate"], rests: int) -> float:
    """The worst standard deviation in its limit after further rests of these shares."""
    one = _scaled(part, 1.0)
    return float(np.sqrt(np.max(np.diagonal(_after(one, share, float(rests))) * one.asked)))


def rests_needed(
    parts: list[Part], share: Float[np.ndarray, " candidate"], ratio: float
) -> int | None:
    """Further rests of these shares until the target is reached; `None` beyond `MOST_AHEAD`.

    **Arguments:** `ratio` is by how much the limits would have to be wider now.
    """
    if ratio <= 1.0:
        return 0
    quantile = joint_quantile(parts)
    known = [p for p in parts if p.asks]
    now = max(spread_after(p, share, 0) for p in known)

    def left(rests: int) -> float:
        return max(
            spread_after(p, share, rests) * narrowing(p.freedom, rests * p.rows.shape[2], quantile)
            for p in known
        )

    low, high = 0, int(MOST_AHEAD)
    if ratio * left(high) > now:
        return None
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if ratio * left(middle) <= now else (middle, high)
    return high


def in_words(up: Float[np.ndarray, "3"]) -> str:
    """How to hold the device so that this direction of the case points up."""
    return f"turn the device so that it rests {up_in_words(up)}"


def _powers(
    variance: Float[np.ndarray, "*any parameter"], limits: Float[np.ndarray, " parameter"]
) -> Float[np.ndarray, "*any"]:
    """Σ (s_i / t_i)^p over the parameters that are asked for."""
    asked = np.isfinite(limits)
    ratio = np.sqrt(np.maximum(variance[..., asked], 0.0)) / limits[asked]
    return np.asarray((ratio**POWER).sum(axis=-1))


def _variances(part: Part, one: int) -> Float[np.ndarray, "around parameter"]:
    """Variances after the rows of one candidate: diag(C − C Jᵀ (v E + J C Jᵀ)⁻¹ J C)."""
    rows = part.rows[one]
    spread = rows @ part.covariance  # J C
    inner = spread @ np.swapaxes(rows, -1, -2)
    inner = inner + part.variance * np.eye(rows.shape[-2])
    solved = np.linalg.solve(inner, spread)
    return np.diagonal(part.covariance) - np.sum(spread * solved, axis=-2)


# --- the rests that are still needed, planned together --------------------------------------------


@dataclasses.dataclass(frozen=True, eq=False)
class _Scaled:
    """A part in units in which a limit of what is asked, and a prior deviation of the rest, is 1."""

    information: Float[np.ndarray, "parameter parameter"]
    adds: Float[np.ndarray, "candidate parameter parameter"]  # information of a rest
    asked: Float[np.ndarray, " parameter"]  # 1 where a limit is asked, else 0


def _scaled(part: Part, width: float) -> _Scaled:
    asked = np.isfinite(part.limits)
    unit = np.where(asked, part.limits / width, np.sqrt(np.diagonal(part.covariance)))
    rows = part.rows * unit / np.sqrt(part.variance)
    adds = np.einsum("caki,cakj->cij", rows, rows) / rows.shape[1]
    return _Scaled(np.linalg.inv(part.covariance / np.outer(unit, unit)), adds, asked.astype(float))


def planned_shares(parts: list[Part], ahead: float = MOST_AHEAD) -> Float[np.ndarray, " candidate"]:
    """Share of each candidate in the rests that are still needed until the target is reached, or in the next `ahead`
    where that is fewer; they sum to 1."""
    # Standard deviations below limit / width hold all errors within the limits with the confidence asked for.
    width = float(ndtri(joint_quantile(parts)))
    scaled = [_scaled(p, width) for p in parts if p.asks]
    count = len(scaled[0].adds)
    share = np.full(count, 1.0 / count)
    for _ in range(_ROUNDS):
        needed = min(_needed(scaled, share), ahead)
        for _ in range(_STEPS):
            share = share * np.sqrt(_gain(scaled, share, needed))
            share /= share.sum()
    return share


def _after(one: _Scaled, share: Float[np.ndarray, " candidate"], rests: float):
    """Covariance after further rests."""
    return np.linalg.inv(one.information + rests * np.tensordot(share, one.adds, 1))


def _gain(
    scaled: list[_Scaled], share: Float[np.ndarray, " candidate"], rests: float
) -> Float[np.ndarray, " candidate"]:
    """How fast Σ (s / t)^p falls with the share of each candidate, but for a factor."""
    gain = np.zeros(len(share))
    for one in scaled:
        covariance = _after(one, share, rests)
        slope = np.diagonal(covariance) ** (0.5 * POWER - 1.0) * one.asked
        gain += np.einsum("cij,ij->c", one.adds, (covariance * slope) @ covariance)
    return gain


def _needed(scaled: list[_Scaled], share: Float[np.ndarray, " candidate"]) -> float:
    """Rests of these shares after which the worst standard deviation is what its limit asks for, 1 to `MOST_AHEAD`."""
    low, high = 1.0, MOST_AHEAD
    for _ in range(12):
        middle = np.sqrt(low * high)
        worst = max(np.max(np.diagonal(_after(o, share, middle)) * o.asked) for o in scaled)
        low, high = (low, middle) if worst <= 1.0 else (middle, high)
    return float(high)
