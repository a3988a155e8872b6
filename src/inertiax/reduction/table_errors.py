"""Errors of a table that are the same in all dwells: its base out of level, its two axes out of square.

A base that leans by the small horizontal angles θ turns the room against the table, and axes that are not square by η
turn all that is outside of the inner axis about the common normal n of both axes. Seen in the case, references u err by

    δ_k = (C_kᵀ θ) × u_k,     δ_k = η n_k × u_k,     n = C_kᵀ o × i,

with the case's attitude C_k in the room, the outer axis o in the room and the inner one i in the case. Both triads err
by the same angles. The attitude of a rest is told by gravity and the Earth's rate in its references (the TRIAD method,
Black, AIAA J. 2 (1964) 1350). The mean over whole turns at constant rate keeps what lies along the axis of rotation;
that over a part of a turn keeps of all that lies across it the share, turned by the same angle, that it keeps of
gravity across it (`_Mean`). About the vertical gravity tells no share: there the lean is one of each plateau by itself
(`leans_of_part_turns`). Rates that the inner axis gives are not turned by η, and rates of the table not by θ.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from ..data.recording import Rig
from ..physics.wgs84 import EARTH_RATE
from .dwells import is_told


LEAST_NORTH = (
    0.1  # of the Earth's rate: a level part that is smaller tells no north (84° of latitude)
)
FEW = 0.05  # of the rests: of so few it does not matter whether they have the error (convention)
SAME_VERTICAL = (
    0.02  # of the Earth's rate, by which the vertical part of it may differ from rest to rest
)
ALIKE = (
    0.02  # rad, between directions that should be one; the errors' shapes need no better attitude
)


class TableErrors(NamedTuple):
    """Changes of the references by one standard deviation: of the level's two angles, and of the axes."""

    accel: Float[np.ndarray, "*dwell 3 3"]  # m/s²; the last axis is the error's
    gyro: Float[np.ndarray, "*dwell 3 3"]  # rad/s
    known: Bool[np.ndarray, " *dwell"]  # where the attitude is known


class _Mean(NamedTuple):
    """What a mean over a plateau makes of a vector that is fixed in the room, seen in the case.

    With the axis a in the room and â in the case, and gravity's direction across the axis p, whose mean is q:
    v → â (a · v) + q (p · v) / p² + (â × q) ((a × p) · v) / p². Of whole turns, and about the vertical, q is zero.
    """

    axis: Float[np.ndarray, "3"]  # in the case
    in_room: Float[np.ndarray, "3"]
    across: Float[np.ndarray, "3"]  # p
    mean: Float[np.ndarray, "3"]  # q

    def of(self, v: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3"]:
        along = self.axis * float(self.in_room @ v)
        size = float(self.across @ self.across)
        if size < ALIKE**2:
            return along
        beside = float(np.cross(self.in_room, self.across) @ v) * np.cross(self.axis, self.mean)
        return along + (self.mean * float(self.across @ v) + beside) / size


class _Rests(NamedTuple):
    """Attitudes of one device's rests."""

    axes: Float[
        np.ndarray, "dwell 3 3"
    ]  # north, west and up in the case, as columns; NaN elsewhere
    earth: Float[np.ndarray, "3"]  # rad/s, in the room
    gravity: float  # m/s²


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
    shape, count = position.shape, position.shape[-1]
    flat = lambda x, inner: np.asarray(x).reshape(-1, count, *inner)
    position, force, rate = flat(position, ()), flat(force, (3,)), flat(rate, (3,))
    run = np.zeros(position.shape, int) if run is None else flat(run, ())
    valid = np.ones(position.shape, bool) if valid is None else flat(valid, ())
    made = [_of_device(*one, rig) for one in zip(position, force, rate, run, valid, strict=True)]
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
    rests = _rests(position, force, rate, valid)
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
    for k in np.flatnonzero(valid & (position < 0) & np.any(rate != 0.0, axis=1)).tolist():
        near = [r for r in _neighbours(k, known & (position >= 0), run, rate)]
        found = next((p for r in near if (p := _plateau(force[k], rate[k], rests, r, rig))), None)
        if found is None:
            continue
        known[k] = True
        accel[k], gyro[k] = found
    return accel, gyro, known


def _rests(
    position: Int[np.ndarray, " dwell"],
    force: Float[np.ndarray, "dwell 3"],
    rate: Float[np.ndarray, "dwell 3"],
    valid: Bool[np.ndarray, " dwell"],
) -> _Rests | None:
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
    return _Rests(axes, earth, float(np.mean(size[told])))


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


def _plateau(
    force: Float[np.ndarray, "3"],
    rate: Float[np.ndarray, "3"],
    rests: _Rests,
    rest: int,
    rig: Rig,
) -> tuple[np.ndarray, np.ndarray] | None:
    """The errors at a plateau beside a rest; `None` where that rest does not tell how the axis of rotation stands."""
    axis = rate / np.linalg.norm(rate)
    told = bool(np.any(force != 0.0))
    upright = float(axis @ force) / rests.gravity if told else np.nan
    in_room, accel, gyro = None, np.zeros((3, 3)), np.zeros((3, 3))
    carried = None  # the two axes, where the inner one turns
    if rig.axes is not None:
        outer, inner = np.array(rig.axes[0]), np.array(rig.axes[1])
        seen = rests.axes[rest] @ outer  # the outer axis in the case
        along = float(seen @ axis)
        if abs(along) > 1.0 - ALIKE:
            in_room = np.sign(along) * outer
            normal = _normal(seen, inner)
            accel[:, 2], gyro[:, 2] = np.cross(normal, force), np.cross(normal, rate)
        elif abs(float(axis @ inner)) > 1.0 - ALIKE:
            beside = rests.axes[rest].T @ axis
            if not told or abs(beside[2] - upright) < ALIKE:
                in_room, carried = beside, (outer, inner)
    if in_room is None and abs(upright) > 1.0 - ALIKE**2:  # a vertical axis has no azimuth
        in_room = np.array([0.0, 0.0, np.sign(upright)])
    if in_room is None:
        return None
    up = np.array([0.0, 0.0, rests.gravity])
    seen_across = (force - axis * float(axis @ force)) / rests.gravity
    mean = _Mean(axis, in_room, np.array([0.0, 0.0, 1.0]) - in_room * in_room[2], seen_across)
    for j, e in enumerate(np.eye(3)[:2]):
        accel[:, j] = mean.of(np.cross(e, up)) * told
        gyro[:, j] = mean.of(np.cross(e, rests.earth))
    if carried:  # n = o × i turns with the outer axis o about i: n × f = i (o · f) − o (i · f)
        outer, inner = carried
        turning = mean.of(outer) - axis * float(in_room @ outer)
        for to, f in ((accel, up * told), (gyro, rests.earth)):
            along = float(in_room @ f) * float(inner @ axis)  # i · f
            to[:, 2] = inner * float(outer @ f) - turning * along
    sizes = np.array([rig.level_uncertainty or 0.0] * 2 + [rig.orthogonality_uncertainty or 0.0])
    return accel * sizes, gyro * sizes


def leans_of_part_turns(
    position: Int[np.ndarray, "*dwell"],
    force: Float[np.ndarray, "*dwell 3"],
    rate: Float[np.ndarray, "*dwell 3"],
    duration: Float[np.ndarray, "*dwell"],
    rig: Rig,
) -> Float[np.ndarray, "*dwell 3 3"]:
    """λ² |f|² sinc²(ω T / 2) (E − â âᵀ), (m/s²)², of plateaus about the vertical, by the level λ: of a lean that stands
    in the room the mean over a part of a turn keeps sin(ω T / 2) / (ω T / 2), in a direction that gravity does not
    tell. Zero elsewhere.

    **Arguments:** `position` is −1 while the table turns; `force`, m/s², is zero where it is not told; `rate` in rad/s;
    `duration` in s.

    **Example:** a quarter of a turn keeps 0.9 of it.
    """
    speed, size = np.linalg.norm(rate, axis=-1), np.linalg.norm(force, axis=-1)
    axis = rate / np.where(speed > 0.0, speed, 1.0)[..., None]
    across = np.linalg.norm(np.cross(axis, force), axis=-1)
    upright = (position < 0) & (speed > 0.0) & (size > 0.0) & (across < ALIKE * size)
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
