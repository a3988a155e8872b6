"""How the device was turned in the room: by integration of the reference rates, recording by recording.

Integration gives each recording's attitude from its own first sample. Recordings are put into one room by the
positions that they share, a measuring position being one pose of the table; where they share none,
the table may start every recording from its home, which the specific force must confirm.
"""

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from .blocks import EARTH_RATE, Log


SAME_POSE = 0.01  # rad, between attitudes that one position number should have
SAME_UP = 0.998  # cosine between directions that should be one


def attitude(
    log: Log, force: Float[np.ndarray, "time 3"] | None = None
) -> Float[np.ndarray, "time 3 3"] | None:
    """Rotation from the room to the device, `(time, 3, 3)`; the room's axes are the first sample's of the device.

    `force` is the specific force in g. `None` without reference rates, where the recordings cannot be put into
    one room, or where the integration does not bring the Earth rate of the rests back to one direction.
    """
    if log.reference_gyro is None:
        return None
    rest = log.position >= 0
    if not rest.any():
        return None
    pieces = [_integrated(log, k) for k in _recordings(log)]
    device = _in_one_room(log, pieces, force)
    if device is None:
        return None
    earth = np.einsum("tij,ti->tj", device[rest], log.reference_gyro[rest])
    size = np.linalg.norm(earth, axis=1)
    if size.max() < 0.5 * EARTH_RATE:
        return device  # rests without Earth rate: nothing to check against
    mean = earth.mean(axis=0)
    return (
        device if np.linalg.norm(earth - mean, axis=1).max() < 0.1 * np.linalg.norm(mean) else None
    )


def _recordings(log: Log) -> list[int]:
    return [int(k) for k in np.unique(log.recording)]


def _integrated(log: Log, recording: int) -> np.ndarray:
    """Rotations of one recording from its first sample's axes, which stay with the room.

    The reference rates of rests are Earth's, where they hold it: the integral is against the stars, and the room
    turns among them.
    """
    assert log.reference_gyro is not None
    mine = log.recording == recording
    rate, time = log.reference_gyro[mine], log.time[mine]
    step = np.diff(time)[:, None]
    turns = Rotation.from_rotvec(0.5 * (rate[1:] + rate[:-1]) * step).as_matrix()
    device = np.empty((len(rate), 3, 3))
    device[0] = np.eye(3)
    for k, turn in enumerate(turns):
        device[k + 1] = turn.T @ device[k]
    rest = log.position[mine] >= 0
    if not rest.any():
        return device
    earth = np.einsum("tij,ti->tj", device[rest], rate[rest]).mean(axis=0)
    if not 0.5 * EARTH_RATE < np.linalg.norm(earth) < 1.5 * EARTH_RATE:
        return device
    return device @ Rotation.from_rotvec(earth * (time - time[0])[:, None]).as_matrix()


def _in_one_room(log: Log, pieces: list[np.ndarray], force: np.ndarray | None) -> np.ndarray | None:
    """All recordings' attitudes from the first one's axes; `None` where nothing joins them."""
    if len(pieces) == 1:
        return pieces[0]
    poses = [_poses(log, k, piece) for k, piece in zip(_recordings(log), pieces)]
    known, joined = dict(poses[0]), [pieces[0]]
    for piece, mine in zip(pieces[1:], poses[1:]):
        turn = _between(known, mine)
        if turn is None:
            break
        joined.append(piece @ turn)
        known = {**{p: pose @ turn for p, pose in mine.items()}, **known}
    if len(joined) == len(pieces):
        return np.concatenate(joined)
    device = np.concatenate(pieces)
    return device if _one_home(log, device, force) else None


def _poses(log: Log, recording: int, device: np.ndarray) -> dict[int, np.ndarray]:
    """Attitude at the middle of the first visit to each position."""
    position = log.position[log.recording == recording]
    edges = np.r_[0, np.flatnonzero(np.diff(position) != 0) + 1, len(position)]
    made: dict[int, np.ndarray] = {}
    for a, b in zip(edges[:-1], edges[1:]):
        if position[a] >= 0:
            made.setdefault(int(position[a]), device[(a + b) // 2])
    return made


def _between(first: dict[int, np.ndarray], second: dict[int, np.ndarray]) -> np.ndarray | None:
    """The turn of the room that makes the poses of shared positions equal; `None` unless three or more agree."""
    shared = sorted(first.keys() & second.keys())
    if len(shared) < 3:
        return None
    turns = Rotation.from_matrix(np.stack([second[p].T @ first[p] for p in shared]))
    mean = turns.mean()
    off = (mean.inv() * turns).magnitude()
    return mean.as_matrix() if off.max() < SAME_POSE else None


def _one_home(log: Log, device: np.ndarray, force: np.ndarray | None) -> bool:
    """Whether the specific force of the rests has one direction in the room, the same in all recordings."""
    if force is None:
        return False
    ups = []
    for number in np.unique(log.recording):
        mine = (log.recording == number) & (log.position >= 0)
        if not mine.any():
            return False
        ups.append(np.einsum("tij,ti->tj", device[mine], force[mine]).mean(axis=0))
    return all(np.linalg.norm(up) > 0.98 and up @ ups[0] > SAME_UP for up in ups)
