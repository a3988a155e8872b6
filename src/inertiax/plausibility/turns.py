"""Gravity turned by the gyros between rests, for every exchange and mirroring of axes at once.

A direction fixed in the room goes through a motion as u₂ = U(ω) u₁ in the case frame. For a signed permutation P of
the gyros' axes with determinant d, U(P ω) = P U(d ω) Pᵀ, so two integrations serve all 48.
"""

import dataclasses
import itertools

import numpy as np
from jaxtyping import Float, Int

from ..physics.vectors import angle_between, unit_vector
from ..reduction.clipping import clipped_rows
from ..reduction.turned_direction import turned
from .evidence import Log


_MOST_MOTIONS = 40
_LONGEST = 60.0  # s; by then a consumer gyro's zero has wandered off by degrees
_LONGEST_ROWS = 6000  # the same where the stamps are no seconds
_TURNING = 0.01  # rad/s; slower rotations about gravity tell nothing

PERMUTATIONS: Float[np.ndarray, "48 3 3"] = np.array(
    [
        np.diag(signs) @ np.eye(3)[list(order)]
        for order in itertools.permutations(range(3))
        for signs in itertools.product((1.0, -1.0), repeat=3)
    ]
)
DETERMINANTS: Float[np.ndarray, "48"] = np.round(np.linalg.det(PERMUTATIONS))
IDENTITY = int(np.argmin(np.abs(PERMUTATIONS - np.eye(3)).sum(axis=(1, 2))))


@dataclasses.dataclass(frozen=True, eq=False)
class Motions:
    """Motions between neighbouring rests whose gravity directions differ."""

    angle: Float[np.ndarray, "motion step 3"]  # rad, step by step; zero beyond a motion's end
    before: Float[np.ndarray, "motion 3"]  # unit vectors of the specific force
    after: Float[np.ndarray, "motion 3"]
    began: tuple[float, ...] = ()  # s, on the recording's clock

    @property
    def count(self) -> int:
        """Number of motions."""
        return len(self.before)

    @property
    def tilt(self) -> Float[np.ndarray, " motion"]:
        """rad between the two directions."""
        return angle_between(self.before, self.after)

    @property
    def path(self) -> Float[np.ndarray, " motion"]:
        """rad through which the device turned, step by step."""
        return np.linalg.norm(self.angle, axis=2).sum(axis=1)


def motions_of(logs: tuple[Log, ...], least_tilt: float) -> Motions | None:
    """Motions that tilt by at least `least_tilt` (rad), in the order of the logs; `None` without any."""
    pieces = [piece for log in logs for piece in _of_one(log)]
    pieces = [p for p in pieces if angle_between(p[1], p[2]) >= least_tilt]
    if not pieces:
        return None
    if len(pieces) > _MOST_MOTIONS:  # spread over the log
        chosen = np.linspace(0, len(pieces) - 1, _MOST_MOTIONS).astype(int)
        pieces = [pieces[k] for k in chosen]
    longest = max(len(p[0]) for p in pieces)
    angle = np.stack([np.pad(a, ((0, longest - len(a)), (0, 0))) for a, *_ in pieces])
    before, after = (np.stack([p[k] for p in pieces]) for k in (1, 2))
    return Motions(angle, before, after, tuple(p[3] for p in pieces))


def _of_one(log: Log) -> list[tuple[np.ndarray, np.ndarray, np.ndarray, float]]:
    recording = log.recording
    force, rate = log.over_rests("accel"), log.over_rests("gyro")
    if force is None or rate is None or recording.gyro is None:
        return []
    found, ended = [], clipped_rows(recording.gyro)
    for k in range(1, log.num_rests):
        first, last = int(log.stop[k - 1]) - 1, int(log.start[k])
        rows = last - first
        steps = np.diff(recording.time[first : last + 1])
        if rows < 4 or rows > _LONGEST_ROWS or steps.max() > 20 * log.step:
            continue
        if rows * log.step > _LONGEST and log.step < 1.0:
            continue
        if ended[first : last + 1].any():  # rates beyond the range: how far it turned is not known
            continue
        zero = 0.5 * (rate.mean[k - 1] + rate.mean[k])
        turn = recording.gyro[first : last + 1] - zero
        if np.linalg.norm(turn, axis=1).max() < _TURNING:
            continue
        step_angle = 0.5 * (turn[1:] + turn[:-1]) * steps[:, None]
        began = float(recording.time[first])
        found.append(
            (step_angle, unit_vector(force.mean[k - 1]), unit_vector(force.mean[k]), began)
        )
    return found


def misfits(motions: Motions, factor: float = 1.0) -> Float[np.ndarray, "48 motion"]:
    """rad between gravity turned by the gyros (times `factor`, axes exchanged by each P) and gravity seen."""
    forward = turned(factor * motions.angle)
    backward = turned(-factor * motions.angle)
    turns = np.where((DETERMINANTS > 0)[:, None, None, None], forward[None], backward[None])
    p = PERMUTATIONS
    rotated = np.einsum("pij,pmjk,plk,ml->pmi", p, turns, p, motions.before, optimize=True)
    return angle_between(rotated, motions.after[None])


def misfit_as_given(motions: Motions, factor: float = 1.0) -> Float[np.ndarray, " motion"]:
    """The same for the axes as they are."""
    end = np.einsum("mij,mj->mi", turned(factor * motions.angle), motions.before)
    return angle_between(end, motions.after)


def score(angles: Float[np.ndarray, "*n motion"]) -> np.ndarray:
    """Mean misfit, rad, without the worst eighth, so that one slip does not decide."""
    kept = angles.shape[-1] - angles.shape[-1] // 8
    return np.asarray(np.sort(np.minimum(angles, 1.5), axis=-1)[..., :kept].mean(axis=-1))


def complexity(p: Float[np.ndarray, "3 3"]) -> int:
    """How many axes a signed permutation moves or negates."""
    return int(np.sum(np.abs(p - np.eye(3)).sum(axis=1) > 0))


def order_and_signs(
    p: Float[np.ndarray, "3 3"],
) -> tuple[Int[np.ndarray, "3"], Float[np.ndarray, "3"]]:
    """Which old axis each new one is, and its sign."""
    order = np.argmax(np.abs(p), axis=1)
    return order, p[np.arange(3), order]


def describe(p: Float[np.ndarray, "3 3"]) -> str:
    """A signed permutation in words: "x and y are exchanged", "z is mirrored", …"""
    order, signs = order_and_signs(p)
    moved = [k for k in range(3) if order[k] != k]
    negated = ["xyz"[order[k]] for k in range(3) if signs[k] < 0]
    parts = []
    if len(moved) == 2:
        parts.append(f"{'xyz'[moved[0]]} and {'xyz'[moved[1]]} are exchanged")
    elif moved:
        parts.append(f"x, y, z are taken from {', '.join('xyz'[k] for k in order)}")
    if negated:
        parts.append(f"{' and '.join(negated)} {'is' if len(negated) == 1 else 'are'} mirrored")
    return " and ".join(parts) if parts else "nothing is changed"
