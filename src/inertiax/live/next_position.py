"""Where to turn next: the direction of gravity that brings the parameters nearest to their targets, in words.

What is far from its target counts: with standard deviations s_i and limits t_i the distance is

    Φ = (Σ (s_i / t_i)^p)^(1/p),   p = 6,

nearly the worst ratio, but smooth, so that a direction that helps one of several bad parameters is worth something.
A rest adds its rows to the information (a step of rank k), averaged over how a person follows: about 10° off.
"""

import dataclasses

import numpy as np
from jaxtyping import Float

from ..physics.directions import up_in_words


POWER = 6.0
FOLLOWED = np.radians(10.0)  # how far off a hand is from what it was told (convention)
_AROUND = 6  # directions on that circle
_NEARLY = 0.03  # of the gain: among directions this near the best, the easiest to hold is told
# Of the fall of the logarithm of the volume, beside the gain: while two rests are needed to tell a parameter, the first
# of them gains nothing, but shrinks the volume. With many rests it falls by a hundredth and does not count.
_VOLUME = 0.02


@dataclasses.dataclass(frozen=True, eq=False)
class Part:
    """Parameters that are known together, and the rows that each candidate would add."""

    covariance: Float[np.ndarray, "parameter parameter"]
    limits: Float[np.ndarray, " parameter"]  # ∞ where nothing is asked
    rows: Float[np.ndarray, "candidate around row parameter"]
    variance: float  # of one row


@dataclasses.dataclass(frozen=True)
class NextPosition:
    """A direction of the specific force in the case, what it gains, and how to say it."""

    up: tuple[float, float, float]
    statement: str
    gain: float  # of the distance Φ, 0 to 1
    temperature: float | None = None  # °C that the chamber is to reach
    rate: float | None = None  # rad/s at which the table is to turn


def followed(up: Float[np.ndarray, "candidate 3"]) -> Float[np.ndarray, "candidate around 3"]:
    """Directions on a circle about each, as a person follows them."""
    least = np.eye(3)[np.argmin(np.abs(up), axis=1)]
    first = np.cross(up, least)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    second = np.cross(up, first)
    angle = 2.0 * np.pi * np.arange(_AROUND) / _AROUND
    across = np.cos(angle)[:, None] * first[:, None] + np.sin(angle)[:, None] * second[:, None]
    return np.cos(FOLLOWED) * up[:, None] + np.sin(FOLLOWED) * across


def best_position(candidates: Float[np.ndarray, "candidate 3"], parts: list[Part]) -> NextPosition:
    """The candidate of the greatest expected gain; among those nearly as good the first, which is the easiest.

    Raises `ValueError` where no part asks for anything.
    """
    if not any(np.isfinite(p.limits).any() for p in parts):
        raise ValueError("`best_position(parts)`: no parameter has a limit.")
    before = sum(_powers(np.diagonal(p.covariance), p.limits) for p in parts)
    after = sum(_powers(_variances(p), p.limits) for p in parts)
    distance = np.mean(np.power(after, 1.0 / POWER), axis=1) / np.power(before, 1.0 / POWER)
    gain = 1.0 - distance
    score = gain + _VOLUME * sum(_shrinkage(p) for p in parts if np.isfinite(p.limits).any())
    good = np.flatnonzero(score >= (1.0 - _NEARLY) * score.max())
    best = int(good[0])
    x, y, z = (float(c) for c in np.round(candidates[best], 6))
    return NextPosition((x, y, z), in_words(candidates[best]), float(np.clip(gain[best], 0.0, 1.0)))


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


def _shrinkage(part: Part) -> Float[np.ndarray, " candidate"]:
    """By how much the logarithm of the confidence ellipsoid's volume falls: ½ log det(E + J C Jᵀ / v), averaged."""
    inner = part.rows @ part.covariance @ np.swapaxes(part.rows, -1, -2) / part.variance
    return 0.5 * np.linalg.slogdet(inner + np.eye(inner.shape[-1]))[1].mean(axis=1)


def _variances(part: Part) -> Float[np.ndarray, "candidate around parameter"]:
    """Variances after the rows of each candidate: diag(C − C Jᵀ (v E + J C Jᵀ)⁻¹ J C)."""
    spread = part.rows @ part.covariance  # J C
    inner = spread @ np.swapaxes(part.rows, -1, -2)
    inner = inner + part.variance * np.eye(part.rows.shape[-2])
    solved = np.linalg.solve(inner, spread)
    return np.diagonal(part.covariance) - np.sum(spread * solved, axis=-2)
