"""How the case stands in the room at rests, and the axis of rotation at plateaus: as references tell it.

The attitude of a rest is told by gravity and the Earth's rate in its references (the TRIAD method, Black, AIAA J. 2
(1964) 1350). The mean over whole turns at constant rate keeps what lies along the axis of rotation; that over a part of
a turn keeps of all that lies across it the share, turned by the same angle, that it keeps of gravity across it. About
the vertical gravity tells no share; there the Earth's rate does, where the axis is one of the table's and so known to
better than that rate turns it.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from ..physics.wgs84 import EARTH_RATE
from .dwells import is_told


LEAST_NORTH = (
    0.1  # of the Earth's rate: a level part that is smaller tells no north (84° of latitude)
)
SAME_VERTICAL = (
    0.02  # of the Earth's rate, by which the vertical part of it may differ from rest to rest
)
ALIKE = (
    0.02  # rad, between directions that should be one; the errors' shapes need no better attitude
)
OUTER, INNER = "outer", "inner"

Axes = tuple[
    tuple[float, ...], tuple[float, ...]
]  # the outer one in the room, the inner one in the case


class MeanInRoom(NamedTuple):
    """What a mean over a plateau makes of a vector that is fixed in the room, seen in the case.

    With the axis a in the room and â in the case, and what of gravity's direction, or of the Earth's rate, lies across
    the axis p, whose mean is q:
    v → â (a · v) + q (p · v) / p² + (â × q) ((a × p) · v) / p². Of whole turns, and about the vertical, q is zero.
    """

    axis: Float[np.ndarray, "3"]  # in the case
    in_room: Float[np.ndarray, "3"]
    across: Float[np.ndarray, "3"]  # p
    mean: Float[np.ndarray, "3"]  # q
    rest: int  # before or after the plateau, which tells how the axis stands
    turns: str  # OUTER or INNER where it is an axis of the table that is known, else empty

    @property
    def told(self) -> bool:
        """Whether p is known, and so what a mean over a part of a turn keeps."""
        return float(self.across @ self.across) >= ALIKE**2

    def of(self, v: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3"]:
        """The mean over the plateau, seen in the case, of a vector v of the room."""
        return self._matrix() @ v

    def of_turned(self, v: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3 3"]:
        """The same of e × v for the room's three directions e, as columns."""
        return self._matrix() @ np.cross(np.eye(3), v).T

    def _matrix(self) -> Float[np.ndarray, "3 3"]:
        along = np.outer(self.axis, self.in_room)
        if not self.told:
            return along
        beside = np.outer(np.cross(self.axis, self.mean), np.cross(self.in_room, self.across))
        size = float(self.across @ self.across)
        return along + (np.outer(self.mean, self.across) + beside) / size


class RestsInRoom(NamedTuple):
    """Attitudes of one device's rests."""

    axes: Float[
        np.ndarray, "dwell 3 3"
    ]  # north, west and up in the case, as columns; NaN elsewhere
    earth: Float[np.ndarray, "3"]  # rad/s, in the room
    gravity: float  # m/s²


def rests_in_room(
    position: Int[np.ndarray, " dwell"],
    force: Float[np.ndarray, "dwell 3"],
    rate: Float[np.ndarray, "dwell 3"],
    valid: Bool[np.ndarray, " dwell"],
) -> RestsInRoom | None:
    """The attitudes that rests' references tell; `None` where none tells its own."""
    size = np.linalg.norm(force, axis=1)
    told = valid & (position >= 0) & is_told(force)
    if not told.any():
        return None
    up = force / np.where(size > 0.0, size, 1.0)[:, None]
    vertical = np.sum(up * rate, axis=1)
    level = rate - vertical[:, None] * up
    north = np.linalg.norm(level, axis=1)
    told &= np.abs(np.linalg.norm(rate, axis=1) / EARTH_RATE - 1.0) < 0.5
    told &= north > LEAST_NORTH * EARTH_RATE
    if not told.any():
        return None
    told &= np.abs(vertical - np.median(vertical[told])) < SAME_VERTICAL * EARTH_RATE
    axes = np.full((len(position), 3, 3), np.nan)
    ahead = level[told] / north[told, None]
    axes[told] = np.stack([ahead, np.cross(up[told], ahead), up[told]], axis=2)
    earth = np.array([np.mean(north[told]), 0.0, np.mean(vertical[told])])
    return RestsInRoom(axes, earth, float(np.mean(size[told])))


def means_in_room(
    rests: RestsInRoom,
    position: Int[np.ndarray, " dwell"],
    force: Float[np.ndarray, "dwell 3"],
    rate: Float[np.ndarray, "dwell 3"],
    run: Int[np.ndarray, " dwell"],
    valid: Bool[np.ndarray, " dwell"],
    axes: Axes | None,
) -> dict[int, MeanInRoom]:
    """What means over plateaus make of vectors of the room, by number of the dwell; those of which a rest beside them
    tells how their axis stands.

    **Arguments:** as of `table_errors.table_errors`; `axes` are those of a table with two, if known.
    """
    known = np.isfinite(rests.axes[:, 0, 0]) & (position >= 0)
    made = {}
    for k in np.flatnonzero(valid & (position < 0) & np.any(rate != 0.0, axis=1)).tolist():
        near = _neighbours(k, known, run, rate)
        seen = (_mean_beside(force[k], rate[k], rests, r, axes) for r in near)
        found = next((mean for mean in seen if mean is not None), None)
        if found is not None:
            made[k] = found
    return made


def turns_told(
    position: Int[np.ndarray, "*device dwell"],
    force: Float[np.ndarray, "*device dwell 3"],
    rate: Float[np.ndarray, "*device dwell 3"],
    run: Int[np.ndarray, "*device dwell"],
    axes: Axes | None,
) -> Bool[np.ndarray, "*device dwell"]:
    """Where it is known what a mean over a part of a turn keeps of vectors of the room; nowhere without `axes`."""
    if axes is None:
        return np.zeros(position.shape, bool)
    made = []
    for where, f, w, log, valid in each_device(position, force, rate, run, None):
        told, rests = np.zeros(len(where), bool), rests_in_room(where, f, w, valid)
        if rests is not None:
            for dwell, mean in means_in_room(rests, where, f, w, log, valid, axes).items():
                told[dwell] = mean.told
        made.append(told)
    return np.reshape(made, position.shape)


def each_device(
    position: Int[np.ndarray, "*device dwell"],
    force: Float[np.ndarray, "*device dwell 3"],
    rate: Float[np.ndarray, "*device dwell 3"],
    run: Int[np.ndarray, "*device dwell"] | None,
    valid: Bool[np.ndarray, "*device dwell"] | None,
) -> list[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]]:
    """The same of one device after the other; one recording and all rows valid where nothing is said of them."""
    run = np.zeros(position.shape, int) if run is None else run
    valid = np.ones(position.shape, bool) if valid is None else valid
    count = position.shape[-1]
    flat = [
        x.reshape(-1, count, *x.shape[position.ndim :]) for x in (position, force, rate, run, valid)
    ]
    return list(zip(*flat, strict=True))


def _neighbours(
    k: int,
    rests: Bool[np.ndarray, " dwell"],
    run: Int[np.ndarray, " dwell"],
    rate: Float[np.ndarray, "dwell 3"],
) -> list[int]:
    """The rest before a plateau and the one after it, in the same recording; first the one from which no turn about
    another axis leads to it: that turn may have turned its axis over in the room."""
    there = np.flatnonzero(rests & (run == run[k]))
    before, after = there[there < k], there[there > k]
    near = [*before[-1:].tolist(), *after[:1].tolist()]
    size = np.linalg.norm(rate, axis=1)
    across = np.linalg.norm(np.cross(rate, rate[k]), axis=1) > ALIKE * size * size[k]
    return sorted(near, key=lambda r: bool(across[min(k, r) + 1 : max(k, r)].any()))


def _mean_beside(
    force: Float[np.ndarray, "3"],
    rate: Float[np.ndarray, "3"],
    rests: RestsInRoom,
    rest: int,
    axes: Axes | None,
) -> MeanInRoom | None:
    """The mean at a plateau beside a rest; `None` where that rest does not tell how the axis of rotation stands."""
    axis = rate / np.linalg.norm(rate)
    told = bool(np.any(force != 0.0))
    upright = float(axis @ force) / rests.gravity if told else np.nan
    in_room, turns = None, ""
    if axes is not None:
        outer, inner = np.array(axes[0]), np.array(axes[1])
        seen = rests.axes[rest] @ outer  # the outer axis in the case
        if abs(along := float(seen @ axis)) > 1.0 - ALIKE:
            axis, in_room, turns = np.sign(along) * seen, np.sign(along) * outer, OUTER
        elif abs(along := float(axis @ inner)) > 1.0 - ALIKE:
            beside = np.sign(along) * rests.axes[rest].T @ inner
            if not told or abs(beside[2] - upright) < ALIKE:
                axis, in_room, turns = np.sign(along) * inner, beside, INNER
    if in_room is None and abs(upright) > 1.0 - ALIKE**2:  # a vertical axis has no azimuth
        in_room = np.array([0.0, 0.0, np.sign(upright)])
    if in_room is None:
        return None
    across = lambda v, along: v - along * float(along @ v)
    room, seen = across(np.array([0.0, 0.0, 1.0]), in_room), across(force, axis) / rests.gravity
    if turns and np.linalg.norm(room) < ALIKE:
        size = np.linalg.norm(rests.earth)
        room, seen = across(rests.earth, in_room) / size, across(rate, axis) / size
    return MeanInRoom(axis, in_room, room, seen, rest, turns)
