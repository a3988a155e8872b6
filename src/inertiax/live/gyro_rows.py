"""Rows of a turn between two rests for the gyros' matrix: gravity's direction turns as the integrated rates say.

With the rates y less their bias, ω = (E + Θ)⁻¹ y, the case turns by R = Π exp[ω_i Δt_i] over steps of any length, and
the direction u of the specific force from u₀ to p = Rᵀ u₀. The row is the small tilt between p and the direction m that
the accelerometers read after the turn, in the two components across m (`estimators.gravity_rotation`). A change of Θ
makes

    δp = p × η,   η = −Σ S_iᵀ (E + Θ)⁻¹ δΘ ω_i Δt_i,   S_i = Π_{j>i} exp[ω_j Δt_j]
"""

import dataclasses

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from ..physics.vectors import axes_across, cross_matrix
from .posterior import Rows


NAMES = tuple(f"gyro.matrix[{i},{j}]" for i in range(3) for j in range(3))
LONGEST = 60.0  # s, as in the batch estimate: by then a bias has wandered off
_STEPS = 8  # of a turn that is only planned


@dataclasses.dataclass(frozen=True, eq=False)
class Turn:
    """Rates between two rests, and what the accelerometers read in both."""

    rate: Float[
        np.ndarray, "step 3"
    ]  # rad/s, less the bias: the mean over each step (`mean_rates`)
    step: Float[
        np.ndarray, " step"
    ]  # s, as long as each is: twice the usual where a row is missing
    before: Float[np.ndarray, "3"]  # mean output of the accelerometers at rest, m/s²
    after: Float[np.ndarray, "3"]
    walk: float  # variance of the integrated rate about an axis, rad²
    kept: list["Turned"] = dataclasses.field(default_factory=list)  # as it was integrated last

    @property
    def seconds(self) -> float:
        """How long it took."""
        return float(self.step.sum())


@dataclasses.dataclass(frozen=True, eq=False)
class Turned:
    """A turn integrated with one Θ: R and how it changes."""

    matrix: Float[np.ndarray, "3 3"]  # Θ
    rotation: Float[np.ndarray, "3 3"]
    change: Float[np.ndarray, "3 9"]  # ∂η/∂Θ, row by row of Θ


def mean_rates(
    rate: Float[np.ndarray, "time 3"], step: Float[np.ndarray, " step"]
) -> Float[np.ndarray, "step 3"]:
    """What turns as a rate that goes linearly from row to row does in each step, rad/s (`motions.step_angle` over h).

    (ω₀ + ω₁) / 2 + h ω₀ × ω₁ / 12
    """
    first, second = rate[:-1], rate[1:]
    return 0.5 * (first + second) + step[:, None] / 12.0 * np.cross(first, second)


def integrated(turn: Turn, matrix: Float[np.ndarray, "3 3"]) -> Turned:
    """The turn by the rates that a matrix Θ makes of the outputs."""
    inverse = np.linalg.inv(np.eye(3) + matrix)
    rate = turn.rate @ inverse.T
    angle = rate * turn.step[:, None]
    steps = Rotation.from_rotvec(angle).as_matrix()
    later, change = np.eye(3), np.zeros((3, 3, 3))
    for step, turned in zip(steps[::-1], angle[::-1]):
        change -= (later.T @ inverse)[:, :, None] * turned
        later = step @ later
    return Turned(matrix, later, change.reshape(3, 9))


def turn_rows(
    turned: list[Turned],
    before: Float[np.ndarray, "turn 3"],
    after: Float[np.ndarray, "turn 3"],
    variance: Float[np.ndarray, " turn"],
) -> Rows:
    """Two rows a turn, linear about each one's Θ. **Arguments:** specific forces before and after, m/s²."""
    jacobian, value = [], []
    for one, start, end in zip(turned, before, after):
        m = end / np.linalg.norm(end)
        p = one.rotation.T @ (start / np.linalg.norm(start))
        sideways = axes_across(m)
        jacobian.append(sideways @ cross_matrix(p) @ one.change)
        residual = 2.0 * (sideways @ p) / (1.0 + m @ p)
        value.append(jacobian[-1] @ one.matrix.reshape(9) - residual)
    if not jacobian:
        return Rows(np.zeros((0, 9)), np.zeros(0), np.zeros(0))
    return Rows(np.concatenate(jacobian), np.concatenate(value), np.repeat(variance, 2))


def planned_rows(
    now: Float[np.ndarray, "3"], up: Float[np.ndarray, "candidate 3"]
) -> Float[np.ndarray, "candidate 2 9"]:
    """Rows of the shortest turns from the direction `now` to each of `up` (unit vectors), with an ideal gyro."""
    axis = np.cross(up, now)
    size = np.linalg.norm(axis, axis=1)
    angle = np.arctan2(size, up @ now)
    axis = axis / np.maximum(size, 1e-12)[:, None]
    change = np.zeros((len(up), 3, 3, 3))
    for share in (np.arange(_STEPS) + 0.5) / _STEPS:
        later = Rotation.from_rotvec(axis * (angle * (1.0 - share))[:, None]).as_matrix()
        rate = axis * (angle / _STEPS)[:, None]
        change -= np.einsum("cji,cb->cijb", later, rate)
    return np.einsum(
        "crk,ckl,clp->crp", axes_across(up), cross_matrix(up), change.reshape(-1, 3, 9)
    )
