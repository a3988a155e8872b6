"""Positioning errors of a table with two axes: an axis that stands keeps its own, whatever the other one does.

A positioning of the case is one of the outer axis and one of the inner. Where a plan turns the inner axis through
several positions while the outer one stands, the outer one's error is the same in all of them, in the room: no number
of them averages it. The error of an inner axis that stands is the same in the case. Of the stated variance α² of a
positioning each axis has half, so that the reference u of rest k errs by

    δ_k = (C_kᵀ ε_o) × u_k + ε_i × u_k + ε_k × u_k,     cov ε_o = cov ε_i = α²/2 E

with the case's attitude C_k in the room; `Rig.outer_part` has another share of α² than half, where a station states
each axis by itself. A standing of which there is one position only has no error to share: it stays in ε_k, which is
drawn anew. An axis stands until its direction changes, a plateau about it, or the recording's end.

How the case lies against the axis of a staircase is its error as a positioning (`positionings`). How that axis lies in
the room is the outer one's, which a mean over turns about the inner axis shares with the rests beside it, and one
about the outer axis with its staircase (`room_attitudes`). It matters to forces, of which a level axis keeps g ε.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from ..data.recording import Rig
from .room_attitudes import ALIKE, each_device, INNER, means_in_room, OUTER, rests_in_room


_PADS = -2  # as a position, of a row that is none


class StandingErrors(NamedTuple):
    """Changes of the references by one standard deviation of each angle of each standing; three angles a standing."""

    accel: Float[np.ndarray, "*device dwell 3 error"]  # m/s²
    gyro: Float[np.ndarray, "*device dwell 3 error"]  # rad/s
    part: Float[np.ndarray, "*device dwell"]  # of α², that is in these: 0, a half or 1


def standing_errors(
    position: Int[np.ndarray, "*device dwell"],
    force: Float[np.ndarray, "*device dwell 3"],
    rate: Float[np.ndarray, "*device dwell 3"],
    rig: Rig,
    *,
    run: Int[np.ndarray, "*device dwell"] | None = None,
    valid: Bool[np.ndarray, "*device dwell"] | None = None,
) -> StandingErrors | None:
    """The module's errors, by the references of dwells, or blocks of such, in the order they were recorded; `None`
    where the rig states no two axes, or no axis stands through several positions.

    **Arguments:** as of `table_errors.table_errors`.

    **Example:** of an outer axis that stands while the inner one turns to eight positions, half of the variance is one
    error of three angles, which all eight have.
    """
    if not rig.position_uncertainty or rig.axes is None:
        return None
    shape = position.shape
    made = [_of_device(*one, rig) for one in each_device(position, force, rate, run, valid)]
    most = max(m.accel.shape[2] for m in made)
    if not most:
        return None
    padded = lambda x: np.pad(x, ((0, 0), (0, 0), (0, most - x.shape[2])))
    accel, gyro = (np.stack([padded(getattr(m, t)) for m in made]) for t in ("accel", "gyro"))
    part = np.stack([m.part for m in made])
    return StandingErrors(
        accel.reshape(*shape, 3, most), gyro.reshape(*shape, 3, most), part.reshape(shape)
    )


def angles_of_axes(rig: Rig) -> tuple[float, float]:
    """What the outer and the inner axis of a table are taken to err by at a positioning, rad, 1 sigma."""
    position = rig.position_uncertainty or 0.0
    outer, inner = np.sqrt([rig.outer_part, 1.0 - rig.outer_part]) * position
    return float(outer), float(inner)


def _of_device(
    position: Int[np.ndarray, " dwell"],
    force: Float[np.ndarray, "dwell 3"],
    rate: Float[np.ndarray, "dwell 3"],
    run: Int[np.ndarray, " dwell"],
    valid: Bool[np.ndarray, " dwell"],
    rig: Rig,
) -> StandingErrors:
    rests = rests_in_room(position, force, rate, valid)
    part, none = np.zeros(len(position)), np.zeros((len(position), 3, 0))
    if rests is None or rig.axes is None:
        return StandingErrors(none, none, part)
    axes, parts = rig.axes, {OUTER: rig.outer_part, INNER: 1.0 - rig.outer_part}
    angle = dict(zip((OUTER, INNER), angles_of_axes(rig)))
    case = np.swapaxes(rests.axes, 1, 2)  # C_k, from the case to the room
    seen = np.array(axes[1]), np.einsum("kji,j->ki", case, np.array(axes[0]))
    there = np.where(valid, position, _PADS)
    outer, inner = _standings(there, rate, run, np.einsum("kij,j->ki", case, seen[0]), *seen)
    means = means_in_room(rests, position, force, rate, run, valid, axes)
    along = np.full(len(position), -1)  # the outer axis' standing at plateaus
    for k, mean in means.items():
        if mean.turns == INNER:
            along[k] = outer[mean.rest]
        elif mean.turns == OUTER:  # of its own, one for all plateaus at an inner axis' standing
            along[k] = outer.max() + 1 + inner[mean.rest]
    up = np.array([0.0, 0.0, rests.gravity])
    made = {"accel": [none], "gyro": [none]}
    for number in np.unique(np.r_[outer[outer >= 0], along[along >= 0]]):
        rest, plateaus = outer == number, np.flatnonzero(along == number)
        if len(np.unique(inner[rest])) < 2 and not len(plateaus):
            continue
        part[rest] += parts[OUTER]
        for triad, u in (("accel", force), ("gyro", rate)):
            turned = np.where(rest[:, None, None], _turned(rests.axes, u), 0.0)
            for k in plateaus:
                turned[k] = means[int(k)].of_turned(up if triad == "accel" else rests.earth)
            made[triad].append(angle[OUTER] * turned)
    for number in np.unique(inner[inner >= 0]):
        rest = inner == number
        if len(np.unique(outer[rest])) < 2:
            continue
        part[rest] += parts[INNER]
        for triad, u in (("accel", force), ("gyro", rate)):
            turned = angle[INNER] * _turned(np.broadcast_to(np.eye(3), case.shape), u)
            made[triad].append(np.where(rest[:, None, None], turned, 0.0))
    accel, gyro = (np.concatenate(x, axis=2) for x in made.values())
    return StandingErrors(accel, gyro, part)


def _turned(
    directions: Float[np.ndarray, "dwell 3 3"], u: Float[np.ndarray, "dwell 3"]
) -> Float[np.ndarray, "dwell 3 3"]:
    """e × u of directions e, which are columns, as columns."""
    return np.swapaxes(np.cross(np.swapaxes(directions, 1, 2), u[:, None, :]), 1, 2)


def _standings(
    position: Int[np.ndarray, " dwell"],
    rate: Float[np.ndarray, "dwell 3"],
    run: Int[np.ndarray, " dwell"],
    inner_in_room: Float[np.ndarray, "dwell 3"],
    inner: Float[np.ndarray, "3"],
    outer_in_case: Float[np.ndarray, "dwell 3"],
) -> tuple[Int[np.ndarray, " dwell"], Int[np.ndarray, " dwell"]]:
    """Numbers of the standings of the outer axis and of the inner one; −1 at plateaus and where no attitude is known.

    The inner axis' direction in the room says how the outer one stands, the outer one's in the case how the inner one
    does."""
    made = np.full((2, len(position)), -1)
    number, last, turned = np.array([0, 0]), -1, np.zeros(2, bool)
    for k in np.flatnonzero(position != _PADS):
        if position[k] < 0:
            size = np.linalg.norm(rate[k])
            along = bool(abs(inner @ rate[k]) > (1.0 - ALIKE) * size)
            turned |= size > 0.0 and np.array([not along, along])
            continue
        if np.isnan(inner_in_room[k, 0]):
            last = -1
            continue
        if last < 0 or run[k] != run[last]:
            moved = np.array([True, True])
        else:
            away = [np.linalg.norm(x[k] - x[last]) > ALIKE for x in (inner_in_room, outer_in_case)]
            moved = turned | np.array(away)
        number = number + moved
        made[:, k] = number
        last, turned = k, np.zeros(2, bool)
    return made[0], made[1]
