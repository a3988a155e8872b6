"""Gravity's turn between rests against the gyros' integrated outputs: the factor from outputs to rad/s.

Gravity stays in the room, so a direction u in the case frame goes through a motion as u₂ = U(s ω) u₁, where U is
the product of the small rotations that the outputs ω make with the factor s. The right s brings u₁ to u₂ in every
motion; any other does so in none.
"""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from ..physics.vectors import angle_between
from .clipping import clipped_rows
from .rests import PAUSE
from .turned_direction import turned


_MOST = 12  # motions: enough for a factor to a few percent
_LONGEST = 60.0  # s; by then a consumer gyro's zero has wandered off by degrees
_LEAST_TILT = np.deg2rad(10.0)
_BLOCK = 0.1  # s, of a direction while the device moves all along
_WINDOWS = (0.6, 2.0, 6.0)  # s, from one direction to the next; slow turns need longer ones
_STEADY = 0.1  # of the norm: the ends of a window, at which little but gravity acts
_FEWEST, _ENOUGH = 12, 100  # windows
_GRID = 1.08  # ratio of neighbours in a search without a start: a turn of 2 rad is missed by 0.08 rad at most


class GravityTurns(NamedTuple):
    """Motions between neighbouring rests whose gravity directions differ."""

    # Gyro output times step, less what it is at rest; 0 beyond the end
    output: Float[np.ndarray, "motion step 3"]
    before: Float[np.ndarray, "motion 3"]
    after: Float[np.ndarray, "motion 3"]
    what: str = "force"  # whose directions these are

    @property
    def num_motions(self) -> int:
        """How many motions there are."""
        return len(self.before)

    def misfit(self, factor: float) -> float:
        """Median angle (rad) between gravity at a rest and gravity brought there from the rest before."""
        ends = np.einsum("mij,mj->mi", turned(factor * self.output), self.before)
        return float(np.median(angle_between(ends, self.after)))

    def best(self, factors: Iterable[float]) -> tuple[float, float]:
        """The factor of least misfit, refined, and that misfit."""
        coarse = min(factors, key=self.misfit)
        for width in (0.08, 0.016, 0.003):
            coarse = min(coarse * (1.0 + width * np.linspace(-1.0, 1.0, 11)), key=self.misfit)
        return float(coarse), self.misfit(coarse)


def factors_between(low: float, high: float) -> Float[np.ndarray, " factor"]:
    """Factors for a search over all that lies between two."""
    return np.geomspace(low, high, int(np.ceil(np.log(high / low) / np.log(_GRID))) + 1)


def gravity_turns(
    time: Float[np.ndarray, " time"],
    gyro: Float[np.ndarray, "time 3"],
    up: Float[np.ndarray, "rest 3"],
    start: Int[np.ndarray, " rest"],
    stop: Int[np.ndarray, " rest"],
) -> GravityTurns | None:
    """Motions that tilt the device by 10° or more within a minute and the gyros' range, without a pause in the rows;
    `None` where there are none.

    **Arguments:** `up` is the unit vector of the specific force in each rest, `start` and `stop` its rows.
    """
    rest = np.array([np.median(gyro[a:b], axis=0) for a, b in zip(start, stop, strict=True)])
    step = np.gradient(time) if len(time) > 1 else np.ones(1)
    longest = PAUSE * float(np.median(step))  # s; the motion went on while nothing was recorded
    pieces, ended = [], clipped_rows(gyro)
    for k in range(len(up) - 1):
        rows = slice(int(stop[k]), int(start[k + 1]))
        missed = np.diff(time[max(rows.start - 1, 0) : rows.stop + 1]).max(initial=0.0) > longest
        useless = rows.stop - rows.start < 4 or missed or ended[rows].any()
        if useless or time[rows.stop] - time[rows.start] > _LONGEST:
            continue
        tilt = float(angle_between(up[k], up[k + 1]))
        if tilt < _LEAST_TILT:
            continue
        zero = 0.5 * (rest[k] + rest[k + 1])
        pieces.append(((gyro[rows] - zero) * step[rows, None], up[k], up[k + 1]))
    if not pieces:
        return None
    return _joined(sorted(pieces, key=lambda p: len(p[0]))[:_MOST])


def _joined(pieces: Sequence[tuple[np.ndarray, np.ndarray, np.ndarray]]) -> GravityTurns:
    output = np.zeros((len(pieces), max(len(p[0]) for p in pieces), 3))
    for k, piece in enumerate(pieces):
        output[k, : len(piece[0])] = piece[0]
    return GravityTurns(output, np.array([p[1] for p in pieces]), np.array([p[2] for p in pieces]))


def turns_in_motion(
    time: Float[np.ndarray, " time"],
    gyro: Float[np.ndarray, "time 3"],
    force: Float[np.ndarray, "time 3"],
) -> GravityTurns | None:
    """Windows of a device that moves all along, in which it tilts by 10° or more; `None` where there are few.

    The directions at their ends hold what the motion adds to gravity, so that they tell a unit and no scale.

    **Arguments:** `force` is the accelerometers' output about its centre, in any unit.
    """
    rows = np.diff(time)
    step = float(np.median(rows)) if len(rows) else 0.0
    if not 0.0 < step <= _BLOCK:
        return None
    block = max(1, round(_BLOCK / step))
    return next(
        (
            t
            for w in _WINDOWS
            if (t := _windows(gyro * step, force, block, round(w / step))) is not None
        ),
        None,
    )


def _windows(
    output: Float[np.ndarray, "time 3"], force: Float[np.ndarray, "time 3"], block: int, apart: int
) -> GravityTurns | None:
    """Windows of `apart` rows, between the means of `block` rows at their ends."""
    first = np.arange(0, len(force) - apart - block, max(1, apart // 2))
    at_each = np.lib.stride_tricks.sliding_window_view(force, min(block, len(force)), axis=0)
    before, after = (at_each[at].mean(axis=2) for at in (first, first + apart))
    sizes = np.stack([np.linalg.norm(before, axis=1), np.linalg.norm(after, axis=1)])
    usual = float(np.median(sizes)) if sizes.size else 0.0
    told = np.all(np.abs(sizes - usual) < _STEADY * usual, axis=0) & (sizes > 0.0).all(axis=0)
    tilts = np.zeros(len(first), bool)
    tilts[told] = angle_between(before[told], after[told]) > _LEAST_TILT
    chosen = np.flatnonzero(tilts)
    if len(chosen) < _FEWEST:
        return None
    half, pieces = block // 2, []
    for k in chosen[:: -(-len(chosen) // _ENOUGH)]:
        unit = [x[k] / np.linalg.norm(x[k]) for x in (before, after)]
        pieces.append((output[first[k] + half : first[k] + half + apart], unit[0], unit[1]))
    return _joined(pieces)
