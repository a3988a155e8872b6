"""The rotation of a motion from its rates, and what a change of each sample's rate does to its end.

A direction u is carried through the steps of a motion, u ← Rₖ u with Rₖ = exp(−[φₖ]×). To first order a change of the
step's rotation vector turns the end by

    δu = u × Σₖ Pₖ J(−φₖ) δφₖ,   Pₖ = Rₙ … Rₖ₊₁,

with J the left Jacobian of the rotation group. Components stand along the first axis of every array, so that NumPy runs
over long rows: arrays of small matrices take several times as long.

**Reference:** Solà, Deray, Atchuthan, *A micro Lie theory for state estimation in robotics*, arXiv:1812.01537, eq. 145.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float


_Vectors = Float[np.ndarray, "3 ..."]
_Quaternions = Float[np.ndarray, "4 ..."]  # scalar first


class Carried(NamedTuple):
    """Motions, step by step."""

    rate: Float[np.ndarray, "3 dwell sample"]  # rad/s
    step: Float[np.ndarray, "dwell step"]  # s
    angle: Float[np.ndarray, "3 dwell step"]  # φ, rad (`reduction.motions.step_angle`)
    later: Float[np.ndarray, "4 dwell step"]  # P, as quaternions
    turn: Float[np.ndarray, "dwell 3 3"]  # R, the whole motion's rotation


def carried(
    rates: Float[np.ndarray, "dwell sample 3"], step: Float[np.ndarray, "dwell step"]
) -> Carried:
    """The rotation of motions by their rates (rad/s) and the steps between samples (s)."""
    rate = np.ascontiguousarray(np.moveaxis(rates, -1, 0))
    first, second = rate[:, :, :-1], rate[:, :, 1:]
    angle = 0.5 * step * (first + second) + step**2 / 12.0 * _cross(first, second)
    later, whole = _later_turns(_quaternions(-angle))
    return Carried(rate, step, angle, later, np.moveaxis(_matrix(whole), -1, 0))


def by_rates(
    motion: Carried, rows: Float[np.ndarray, "dwell row 3"]
) -> Float[np.ndarray, "dwell row 3 sample"]:
    """What a change of each sample's rate does to numbers that change by `rows` with a small turn of the end.

    rows Σₖ Pₖ J(−φₖ) δφₖ = Σₛ result δωₛ
    """
    at_end = np.moveaxis(rows, -1, 0)[..., None].swapaxes(1, 2)  # component, row, dwell, 1
    after = _turned_back(at_end, motion.later[:, None])
    by_angle = _times_jacobian(after, -motion.angle[:, None])
    half, coning = 0.5 * motion.step * by_angle, motion.step**2 / 12.0 * by_angle
    result = np.zeros((*half.shape[:-1], half.shape[-1] + 1))
    result[..., :-1] = half - _cross(coning, motion.rate[:, None, :, 1:])
    result[..., 1:] += half + _cross(coning, motion.rate[:, None, :, :-1])
    return np.ascontiguousarray(np.transpose(result, (2, 1, 0, 3)))


def _turned_back(row: _Vectors, q: _Quaternions) -> _Vectors:
    """rowᵀ P for the rotation P of a quaternion."""
    twice = 2.0 * _cross(row, q[1:])
    return row + q[0] * twice + _cross(twice, q[1:])


def _times_jacobian(row: _Vectors, angle: _Vectors) -> _Vectors:
    """rowᵀ J(φ), J = E + (1 − cos θ)/θ² [φ]× + (θ − sin θ)/θ³ [φ]×², by the series of `motions.rotate`."""
    s = np.sum(np.square(angle), axis=0)
    cosine = 0.5 * (1.0 + s / -12.0 * (1.0 + s / -30.0 * (1.0 + s / -56.0 * (1.0 + s / -90.0))))
    third = (1.0 + s / -20.0 * (1.0 + s / -42.0 * (1.0 + s / -72.0))) / 6.0
    once = _cross(row, angle)
    return row + cosine * once + third * _cross(once, angle)


def _quaternions(angle: _Vectors) -> _Quaternions:
    """cos(θ/2) and sin(θ/2) φ/θ, as series of θ²/4 of which less is left out than of those of `motions.rotate`."""
    s = 0.25 * np.sum(np.square(angle), axis=0)
    result = np.empty((4, *s.shape))
    result[0] = 1.0 + s / -2.0 * (
        1.0 + s / -12.0 * (1.0 + s / -30.0 * (1.0 + s / -56.0 * (1.0 + s / -90.0)))
    )
    sine = 1.0 + s / -6.0 * (1.0 + s / -20.0 * (1.0 + s / -42.0 * (1.0 + s / -72.0)))
    np.multiply(0.5 * sine, angle, out=result[1:])
    return result


def _later_turns(
    turn: Float[np.ndarray, "4 dwell step"],
) -> tuple[Float[np.ndarray, "4 dwell step"], Float[np.ndarray, "4 dwell"]]:
    """qₙ … qₖ₊₁ for every step k, and the product of all.

    In blocks of about √n steps, all blocks side by side, so that Python runs 2 √n products instead of n.
    """
    _, count, steps = turn.shape
    length = int(np.ceil(np.sqrt(steps)))
    blocks = -(-steps // length)
    padded = np.zeros((4, count, blocks * length))
    padded[0] = 1.0
    padded[:, :, :steps] = turn
    inside, ends = _one_by_one(np.moveaxis(padded.reshape(4, count, blocks, length), 3, 0))
    beyond, whole = _one_by_one(np.moveaxis(ends, 2, 0))
    every = _product(np.moveaxis(beyond, 0, 2)[..., None], np.moveaxis(inside, 0, 3))
    return every.reshape(4, count, blocks * length)[:, :, :steps], whole


def _one_by_one(turn: Float[np.ndarray, "step 4 ..."]) -> tuple[np.ndarray, np.ndarray]:
    """The product of all later turns for each step, and of all."""
    turn = np.ascontiguousarray(turn)
    later = np.empty_like(turn)
    running = np.zeros(turn.shape[1:])
    running[0] = 1.0
    for k in range(len(turn) - 1, -1, -1):
        later[k] = running
        running = _product(running, turn[k])
    return later, running


def _product(a: _Quaternions, b: _Quaternions) -> _Quaternions:
    """Hamilton's product: the turn b, then the turn a."""
    result = _empty(a, b)
    result[0] = a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3]
    result[1:] = a[0] * b[1:]
    result[1:] += b[0] * a[1:]
    result[1:] += _cross(a[1:], b[1:])
    return result


def _matrix(q: Float[np.ndarray, "4 dwell"]) -> Float[np.ndarray, "3 3 dwell"]:
    w, x, y, z = q
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.array(rows)


def _cross(a: _Vectors, b: _Vectors) -> _Vectors:
    result = _empty(a, b)
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        np.multiply(a[i], b[j], out=result[k])
        result[k] -= a[j] * b[i]
    return result


def _empty(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.empty((len(a), *np.broadcast_shapes(a.shape[1:], b.shape[1:])))
