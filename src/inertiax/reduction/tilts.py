"""Slips and slow tilts: turns of a resting device that gravity's direction and the integrated rates show alike.

With the specific force $f$ at rest, a turn by the small angle $\\theta$ changes it by $-\\theta \\times f$. An
accelerometer's drift changes its output and no rate; a gyro's changes a rate and no direction; only a turn does both.
Where a device restarts or is switched over, biases of both triads jump at once, and by chance that looks like a turn.
But a turn leaves |f|, and rests follow it whose rates are those of the rests before.
"""

from dataclasses import dataclass
from typing import no_type_check

import numpy as np
from jaxtyping import Bool, Float, Int

from .quiet_level import ordered


@dataclass(frozen=True)
class TiltThresholds:
    """When a change of direction is a turn.

    Angles across gravity have two components, so that noise passes k standard deviations with exp(-k²/2): 4e-6 at 5, by
    each triad, and both must agree. `benchmarks/handling.py` counts false ones with white and with MEMS noise.
    """

    deviations: float = 5.0  # standard deviations that either triad must show (derived)
    agree: float = 3.0  # standard deviations that the two may differ by
    share: float = 0.3  # of the turn that they may differ by besides: scale factors and misalignments in the raw data
    beside: float = 1.0  # s, means before and after a slip; less in short rests
    slip: float = 0.3  # s, that a slip takes
    grid: float = 0.05  # s, between the moments that are tried
    least_turn: float = (
        1e-3  # rad over a rest; less changes neither |a| nor a gyro's bias that rests can tell
    )
    fewest: int = 3  # rests that tell the gyros' bias
    longest: float = 120.0  # s; in longer rests a bias wanders as fast as a slow tilt
    blocks: int = 10  # means in a rest whose course is looked at
    slowest: float = 0.2  # s from sample to sample


THRESHOLDS = TiltThresholds()


@dataclass(frozen=True, eq=False)
class _Turns:
    """Turns across gravity at some moments of a rest, by both triads, rad."""

    row: Int[np.ndarray, " moment"]  # middle of the moment, row of the rest
    seen: Float[np.ndarray, "moment 3"]  # by the direction of the specific force
    integrated: Float[np.ndarray, "moment 3"]  # by the gyros
    length: Float[np.ndarray, " moment"]  # change of the specific force's, over it
    # What a jump of the gyros' biases makes of `integrated` at most: half the change of rate for the time of a slip.
    jump: Float[np.ndarray, " moment"]


def slips(
    rests: list[tuple[Float[np.ndarray, "_ 3"], Float[np.ndarray, "_ 3"]]],
    step: float,
    limits: TiltThresholds = THRESHOLDS,
) -> list[tuple[int, int] | None]:
    """For each rest the rows `[start, stop)` of its greatest slip, or `None`.

    **Arguments:** accelerometers' (m/s²) and gyros' outputs (rad/s) of each rest of a recording, `step` in s.
    """
    turns = [_turns(a, g, step, limits) for a, g in rests]
    levels = [_quiet(t) for t in turns if t is not None]
    if not levels:
        return [None] * len(rests)
    usual = np.median(np.array(levels), axis=0)
    half = max(round(limits.slip / step), 2)
    found: list[tuple[int, int] | None] = []
    for turn, (a, _) in zip(turns, rests):
        moment = (
            None if turn is None else _slip(turn, np.maximum(usual, 0.5 * _quiet(turn)), limits)
        )
        if moment is None:
            found.append(None)
        else:
            found.append((max(moment - half, 0), min(moment + half, len(a))))
    return found


@no_type_check  # as in `quiet_level`
def _turns(
    accel: np.ndarray, gyro: np.ndarray, step: float, limits: TiltThresholds
) -> _Turns | None:
    num = len(accel)
    gap = max(round(limits.slip / step), 2)
    beside = min(round(limits.beside / step), (num - gap) // 3)
    if beside < 8 or step > limits.slowest:
        return None
    row = np.arange(beside, num - gap - beside + 1, max(round(limits.grid / step), 1))
    sums = [_sums(x) for x in (accel, gyro)]
    over = lambda s, a, b: s[b] - s[a]
    before = [over(s, row - beside, row) / beside for s in sums]
    after = [over(s, row + gap, row + gap + beside) / beside for s in sums]
    force = 0.5 * (before[0] + after[0])
    size = np.linalg.norm(force, axis=1, keepdims=True)
    up = force / size
    seen = np.cross(up, -(after[0] - before[0]) / size)
    rest_rate = 0.5 * (before[1] + after[1])
    angle = (over(sums[1], row, row + gap) - gap * rest_rate) * step
    across = angle - np.sum(angle * up, axis=1, keepdims=True) * up
    norms = [np.linalg.norm(means[0], axis=1) for means in (before, after)]
    jump = 0.5 * gap * step * np.linalg.norm(after[1] - before[1], axis=1)
    return _Turns(row + gap // 2, seen, across, (norms[1] - norms[0]) / size[:, 0], jump)


def _sums(x: np.ndarray) -> np.ndarray:
    """Of the rows before each, and of all; axis by axis in memory, as the samples of a `Recording` lie."""
    made = np.zeros((len(x) + 1, 3), order="F")
    np.cumsum(x, axis=0, out=made[1:])
    return made


@no_type_check  # as in `quiet_level`
def _quiet(turns: _Turns) -> Float[np.ndarray, "2"]:
    """Standard deviation of one component of the turns by either triad, from the quieter moments of a rest."""
    return np.array(
        [ordered(np.linalg.norm(x, axis=1), 0.25) / 0.7585 for x in (turns.seen, turns.integrated)]
    )


@no_type_check  # as in `quiet_level`
def _slip(turns: _Turns, sigma: Float[np.ndarray, "2"], limits: TiltThresholds) -> int | None:
    seen, integrated = (np.linalg.norm(x, axis=1) for x in (turns.seen, turns.integrated))
    turned = np.maximum(integrated - turns.jump, 0.0)
    least = np.minimum(seen / max(sigma[0], 1e-12), turned / max(sigma[1], 1e-12))
    apart = np.linalg.norm(turns.seen - turns.integrated, axis=1)
    alike = apart < limits.agree * np.hypot(*sigma) + limits.share * np.maximum(seen, integrated)
    # Scale factors and misalignments in the raw data change the length by a part of the turn, too.
    of_noise = ordered(np.abs(turns.length), 0.25) / 0.3186
    alike &= np.abs(turns.length) < limits.agree * of_noise + limits.share * seen
    score = np.where(alike, least, 0.0)
    k = int(np.argmax(score))
    return int(turns.row[k]) if score[k] > limits.deviations else None


def tilting(
    rests: list[tuple[Float[np.ndarray, "_ 3"], Float[np.ndarray, "_ 3"]]],
    step: float,
    limits: TiltThresholds = THRESHOLDS,
) -> tuple[Bool[np.ndarray, " rest"], Float[np.ndarray, " rest"]]:
    """Rests that tilt slowly from their beginning to their end, and by how much by gravity's direction, rad.

    The gyros' bias is what all rests agree on (weights by distance), of the components across gravity and less what the
    directions turn: where every rest tilts, it is found all the same. Two or fewer rests tell none.
    """
    num = len(rests)
    turn = np.zeros(num)
    fits = [
        k for k, (a, _) in enumerate(rests) if limits.blocks * 4 <= len(a) <= limits.longest / step
    ]
    if len(fits) < limits.fewest or step > limits.slowest:
        return np.zeros(num, bool), turn
    courses = [_course(*rests[k], step, limits.blocks) for k in fits]
    seen, sigma, rate, up = (np.array(x) for x in zip(*courses))
    across = np.eye(3) - up[:, :, None] * up[:, None, :]
    bias = _bias(rate - seen, across)
    turned = np.einsum("kij,kj->ki", across, rate - bias)
    apart = np.linalg.norm(turned - seen, axis=1)
    scatter = float(np.median(apart)) / 1.1774  # of one of two components
    size, integrated = np.linalg.norm(seen, axis=1), np.linalg.norm(turned, axis=1)
    lasts = np.array([len(rests[k][0]) for k in fits]) * step
    tilts = (size > limits.deviations * sigma) & (integrated > limits.deviations * scatter)
    tilts &= apart < limits.agree * np.hypot(scatter, sigma) + limits.share * size
    tilts &= size * lasts > limits.least_turn
    turn[fits] = size * lasts
    marked = np.zeros(num, bool)
    marked[fits] = tilts
    return marked, turn


@no_type_check  # as in `quiet_level`
def _course(
    accel: np.ndarray, gyro: np.ndarray, step: float, blocks: int
) -> tuple[np.ndarray, float, np.ndarray, np.ndarray]:
    """Rate of turn by gravity's direction (rad/s) and its standard deviation, mean rate, and up in the case."""
    size = len(accel) // blocks
    means = accel[: size * blocks].reshape(blocks, size, 3).mean(axis=1)
    mean = means.mean(axis=0)
    norm = float(np.linalg.norm(mean))
    up = mean / norm
    time = (np.arange(blocks) - 0.5 * (blocks - 1)) * size * step
    slope = time @ (means - mean) / (time @ time)
    left = means - mean - time[:, None] * slope
    noise = float(np.sqrt(np.sum(left**2) / (3 * (blocks - 2)) / (time @ time)))
    return np.cross(up, -slope / norm), noise / norm, gyro.mean(axis=0), up


def _bias(rate: Float[np.ndarray, "rest 3"], across: Float[np.ndarray, "rest 3 3"]) -> np.ndarray:
    """The vector whose components across gravity are nearest to the rests' rates, by least absolute distances."""
    weight = np.ones(len(rate))
    bias = np.median(rate, axis=0)
    for _ in range(20):
        normal = np.einsum("k,kij->ij", weight, across) + 1e-9 * weight.sum() * np.eye(3)
        bias = np.linalg.solve(normal, np.einsum("k,kij,kj->i", weight, across, rate))
        apart = np.linalg.norm(np.einsum("kij,kj->ki", across, rate - bias), axis=1)
        weight = 1.0 / np.maximum(apart, 1e-3 * np.median(apart) + 1e-15)
    return bias
