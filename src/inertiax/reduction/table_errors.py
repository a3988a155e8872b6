"""Errors of a table that are the same in all dwells: its base out of level, its two axes out of square.

A base that leans by the small horizontal angles θ turns the room against the table, and axes that are not square by η
turn all that is outside of the inner axis about the common normal n of both axes. Seen in the case, references u err by

    δ_k = (C_kᵀ θ) × u_k,     δ_k = η n_k × u_k,     n = C_kᵀ o × i,

with the case's attitude C_k in the room, the outer axis o in the room and the inner one i in the case. Both triads err
by the same angles. How the case stands in the room, and what means over plateaus keep, is `room_attitudes`. About the
vertical gravity tells no share of a part of a turn: there the lean is one of each plateau by itself
(`leans_of_part_turns`). Rates that the inner axis gives are not turned by η, and rates of the table not by θ.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from ..data.recording import Rig
from .dwells import is_told
from .room_attitudes import (
    ALIKE,
    each_device,
    INNER,
    MeanInRoom,
    means_in_room,
    OUTER,
    rests_in_room,
    RestsInRoom,
)


FEW = 0.05  # of the rests: of so few it does not matter whether they have the error (convention)


class TableErrors(NamedTuple):
    """Changes of the references by one standard deviation: of the level's two angles, and of the axes."""

    accel: Float[np.ndarray, "*dwell 3 3"]  # m/s²; the last axis is the error's
    gyro: Float[np.ndarray, "*dwell 3 3"]  # rad/s
    known: Bool[np.ndarray, " *dwell"]  # where the attitude is known


def states_table_errors(rig: Rig) -> bool:
    """Whether a station says of its level or of the right angle of its axes that they are not perfect."""
    return bool(rig.level_uncertainty or rig.orthogonality_uncertainty)


def table_errors(
    position: Int[np.ndarray, "*device dwell"],
    force: Float[np.ndarray, "*device dwell 3"],
    rate: Float[np.ndarray, "*device dwell 3"],
    rig: Rig,
    *,
    run: Int[np.ndarray, "*device dwell"] | None = None,
    valid: Bool[np.ndarray, "*device dwell"] | None = None,
) -> TableErrors:
    """The module's errors, by the references of dwells in the order they were recorded; zero where the attitude is not
    known.

    **Arguments:** `position` is −1 while the table turns; `force` in m/s², zero where it is not told; `rate` in rad/s,
    Earth's included; `run` numbers the recordings, of which no motion leads from one to the next.
    """
    shape = position.shape
    made = [_of_device(*one, rig) for one in each_device(position, force, rate, run, valid)]
    accel, gyro, known = (np.stack(x) for x in zip(*made, strict=True))
    return TableErrors(
        accel.reshape(*shape, 3, 3), gyro.reshape(*shape, 3, 3), known.reshape(shape)
    )


def _of_device(
    position: Int[np.ndarray, " dwell"],
    force: Float[np.ndarray, "dwell 3"],
    rate: Float[np.ndarray, "dwell 3"],
    run: Int[np.ndarray, " dwell"],
    valid: Bool[np.ndarray, " dwell"],
    rig: Rig,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    accel, gyro = np.zeros((2, len(position), 3, 3))
    known = np.zeros(len(position), bool)
    rests = rests_in_room(position, force, rate, valid)
    if rests is None:
        return accel, gyro, known
    level, square = rig.level_uncertainty or 0.0, rig.orthogonality_uncertainty or 0.0
    known = np.isfinite(rests.axes[:, 0, 0])
    axes, f, w = rests.axes[known], force[known], rate[known]
    for j in range(2):
        accel[known, :, j] = level * np.cross(axes[:, :, j], f)
        gyro[known, :, j] = level * np.cross(axes[:, :, j], w)
    if square and rig.axes is not None:
        outer, inner = np.array(rig.axes[0]), np.array(rig.axes[1])
        normal = _normal(axes @ outer, inner)
        accel[known, :, 2] = square * np.cross(normal, f)
        gyro[known, :, 2] = square * np.cross(normal, w)
    for k, mean in means_in_room(rests, position, force, rate, run, valid, rig.axes).items():
        known[k] = True
        accel[k], gyro[k] = _plateau(force[k], rate[k], rests, mean, rig)
    return accel, gyro, known


def _plateau(
    force: Float[np.ndarray, "3"],
    rate: Float[np.ndarray, "3"],
    rests: RestsInRoom,
    mean: MeanInRoom,
    rig: Rig,
) -> tuple[np.ndarray, np.ndarray]:
    """The errors at a plateau."""
    told = bool(np.any(force != 0.0))
    accel, gyro = np.zeros((2, 3, 3))
    up = np.array([0.0, 0.0, rests.gravity]) * told
    accel[:, :2] = mean.of_turned(up)[:, :2]
    gyro[:, :2] = mean.of_turned(rests.earth)[:, :2]
    if rig.axes is not None and mean.turns == OUTER:
        normal = _normal(rests.axes[mean.rest] @ np.array(rig.axes[0]), np.array(rig.axes[1]))
        accel[:, 2], gyro[:, 2] = np.cross(normal, force), np.cross(normal, rate)
    elif rig.axes is not None and mean.turns == INNER:
        # n = o × i turns with the outer axis o about i: n × f = i (o · f) − o (i · f)
        outer, inner = np.array(rig.axes[0]), np.array(rig.axes[1])
        turning = mean.of(outer) - mean.axis * float(mean.in_room @ outer)
        for to, f in ((accel, up), (gyro, rests.earth)):
            along = float(mean.in_room @ f) * float(inner @ mean.axis)  # i · f
            to[:, 2] = inner * float(outer @ f) - turning * along
    sizes = np.array([rig.level_uncertainty or 0.0] * 2 + [rig.orthogonality_uncertainty or 0.0])
    return accel * sizes, gyro * sizes


def leans_of_part_turns(
    position: Int[np.ndarray, "*dwell"],
    force: Float[np.ndarray, "*dwell 3"],
    rate: Float[np.ndarray, "*dwell 3"],
    duration: Float[np.ndarray, "*dwell"],
    rig: Rig,
    told: Bool[np.ndarray, "*dwell"] | None = None,
) -> Float[np.ndarray, "*dwell 3 3"]:
    """λ² |f|² sinc²(ω T / 2) (E − â âᵀ), (m/s²)², of plateaus about the vertical, by the level λ: of a lean that stands
    in the room the mean over a part of a turn keeps sin(ω T / 2) / (ω T / 2), in a direction that gravity does not
    tell. Zero elsewhere, and where the Earth's rate does (`room_attitudes.turns_told`).

    **Arguments:** `position` is −1 while the table turns; `force`, m/s², is zero where it is not told; `rate` in rad/s;
    `duration` in s; `told` is where the direction is known.

    **Example:** a quarter of a turn keeps 0.9 of it.
    """
    speed, size = np.linalg.norm(rate, axis=-1), np.linalg.norm(force, axis=-1)
    axis = rate / np.where(speed > 0.0, speed, 1.0)[..., None]
    across = np.linalg.norm(np.cross(axis, force), axis=-1)
    upright = (position < 0) & (speed > 0.0) & (size > 0.0) & (across < ALIKE * size)
    upright &= True if told is None else ~told
    kept = np.sinc(speed * duration / (2.0 * np.pi))  # NumPy's is sin(π x) / (π x)
    square = np.where(upright, np.square((rig.level_uncertainty or 0.0) * size * kept), 0.0)
    return square[..., None, None] * (np.eye(3) - axis[..., :, None] * axis[..., None, :])


def _normal(
    outer: Float[np.ndarray, "*dwell 3"], inner: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "*dwell 3"]:
    across = np.cross(outer, inner)
    return across / np.maximum(np.linalg.norm(across, axis=-1, keepdims=True), 1e-12)


def table_error_words(
    rig: Rig,
    errors: TableErrors | None,
    position: Int[np.ndarray, "*device dwell"],
    force: Float[np.ndarray, "*device dwell 3"] | None,
) -> tuple[str, ...]:
    """What of the stated errors could not be used, one line each.

    **Arguments:** `errors` is `None` where there are no references of both triads.
    """
    said = []
    rest = position >= 0
    if rig.orthogonality_uncertainty and rig.axes is None:
        said.append(
            "[rig] orthogonality_uncertainty is in no ±: how the axes stand is told by [columns] table_angles and two "
            "[table] axes alone."
        )
    known = np.zeros(position.shape, bool) if errors is None else errors.known
    stated = [
        f"{k}_uncertainty" for k in ("level", "orthogonality") if getattr(rig, f"{k}_uncertainty")
    ]
    if not stated or (rig.axes is None and not rig.level_uncertainty):
        return tuple(said)
    which = " and ".join(stated if rig.axes is not None else ["level_uncertainty"])
    if not known[rest].any():
        said.append(
            f"[rig] {which} is in no ±: the heading of the rests is not known. References of gravity and the Earth's "
            "rate tell it: of a table's angles they are made with [site] latitude and [table] azimuth (any)."
        )
        return tuple(said)
    lacking = int(np.sum(rest & ~known))
    if lacking > FEW * np.sum(rest):
        rests = "1 rest" if lacking == 1 else f"{lacking} rests"
        said.append(f"[rig] {which}: not of {rests}, whose heading is not known.")
    told = np.zeros(position.shape, bool) if force is None else is_told(np.asarray(force))
    lacking = int(np.sum(~rest & told & ~known))
    if lacking:
        said.append(
            f"[rig] {which}: drawn anew at {lacking} plateaus, whose axis is not known in the room; [table] axes and a "
            "rest before or after tell it."
        )
    return tuple(said)
