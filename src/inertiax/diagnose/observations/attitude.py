"""How the device was turned in the room: by integration of the reference rates, recording by recording.

Integration gives each recording's attitude from its own first sample. Recordings are put into one room by the
positions that they share, a measuring position being one pose of the table; where they share none,
the table may start every recording from its home, which the specific force must confirm.

Where the table is moved unseen between experiments, or an integral over hundreds of slews drifts, references that hold
both gravity and the Earth's rate tell each rest's attitude by themselves (the TRIAD method); rates are then integrated
from rest to rest alone.

**Reference:** Black, AIAA J. 2 (1964) 1350, for attitude from two vectors.
"""

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from .blocks import EARTH_RATE, Log


SAME_POSE = 0.01  # rad, between attitudes that one position number should have
LOST = 0.02  # rad, by which a motion may miss the next rest: slews written with a sample too few
SAME_UP = 0.998  # cosine between directions that should be one


def attitude(
    log: Log, force: Float[np.ndarray, "time 3"] | None = None
) -> Float[np.ndarray, "time 3 3"] | None:
    """Rotation from the room to the device, `(time, 3, 3)`; the room's axes are the first sample's of the device.

    `force` is the specific force in g. Where the recordings cannot be put into one room, or where the integration does
    not bring the Earth rate of the rests back to one direction, the references of the rests tell their attitudes, and
    the room's axes are north, west and up. `None` where neither is possible.
    """
    if log.reference_gyro is None:
        return None
    rest = log.position >= 0
    if not rest.any():
        return None
    pieces = [_integrated(log, k) for k in _recordings(log)]
    device = _in_one_room(log, pieces, force)
    return device if device is not None and _steady(log, device) else _from_rests(log)


def _steady(log: Log, device: Float[np.ndarray, "time 3 3"]) -> bool:
    """Whether the Earth rate of the rests keeps its direction in the room, where they hold it."""
    assert log.reference_gyro is not None
    rest = log.position >= 0
    earth = np.einsum("tij,ti->tj", device[rest], log.reference_gyro[rest])
    size = np.linalg.norm(earth, axis=1)
    if size.max() < 0.5 * EARTH_RATE:
        return True  # rests without Earth rate: nothing to check against
    mean = earth.mean(axis=0)
    return bool(np.linalg.norm(earth - mean, axis=1).max() < 0.1 * np.linalg.norm(mean))


def _from_rests(log: Log) -> Float[np.ndarray, "time 3 3"] | None:
    """Each rest's attitude from its references of gravity and the Earth's rate, and the motions beside it.

    `None` where a rest tells no two directions, where the angle between them is not one, or where a motion within an
    experiment does not lead to the next rest.
    """
    if log.reference_accel is None or log.reference_gyro is None:
        return None
    place = log.position
    change = np.diff(place) != 0
    change |= (np.diff(log.recording) != 0) | (np.diff(log.experiment) != 0)
    edges = np.r_[0, np.flatnonzero(change) + 1, len(place)]
    rests = [(int(a), int(b)) for a, b in zip(edges[:-1], edges[1:]) if place[a] >= 0]
    # Medians: rates that were differentiated or filtered reach into the first samples of a rest.
    middle = lambda x: np.array([np.median(x[a:b], axis=0) for a, b in rests])
    up, earth = middle(log.reference_accel), middle(log.reference_gyro)
    poses = _two_vectors(up, earth)
    if poses is None:
        return None
    run = np.cumsum(np.r_[True, (np.diff(log.recording) != 0) | (np.diff(log.experiment) != 0)])
    middles = np.array([(a + b) // 2 for a, b in rests])
    start, of_run = np.array([a for a, _ in rests]), run[middles]
    # The rest before; at the beginning of an experiment the first one after.
    near = np.clip(np.searchsorted(start, np.arange(len(place)), side="right") - 1, 0, None)
    near += (of_run[np.minimum(near + 1, len(rests) - 1)] == run) & (of_run[near] != run)
    moved = np.concatenate([_among_stars(log, k) for k in _recordings(log)])
    earth_in_room = np.einsum("rij,ri->j", poses, earth) / len(rests)

    def reached(row: np.ndarray, rest: np.ndarray) -> np.ndarray:
        """Attitude of rows from those of rests: the room turns among the stars meanwhile."""
        passed = (log.time[row] - log.time[middles[rest]])[:, None]
        room = Rotation.from_rotvec(passed * earth_in_room).as_matrix()
        return moved[row] @ moved[middles[rest]].transpose(0, 2, 1) @ poses[rest] @ room

    same = np.flatnonzero(np.diff(of_run) == 0)
    missed = reached(middles[same + 1], same).transpose(0, 2, 1) @ poses[same + 1]
    if len(same) and Rotation.from_matrix(missed).magnitude().max() > LOST:
        return None
    return reached(np.arange(len(place)), near)


def _two_vectors(
    up: Float[np.ndarray, "rest 3"], earth: Float[np.ndarray, "rest 3"]
) -> Float[np.ndarray, "rest 3 3"] | None:
    """Rotations from north, west and up to the device's axes, which see gravity and the Earth's rate so."""
    sizes = np.linalg.norm(up, axis=1), np.linalg.norm(earth, axis=1) / EARTH_RATE
    if not len(up) or sizes[0].min() == 0.0 or sizes[1].min() < 0.5 or sizes[1].max() > 1.5:
        return None
    up = up / sizes[0][:, None]
    vertical = np.einsum("ri,ri->r", up, earth)
    north = earth - vertical[:, None] * up
    level = np.linalg.norm(north, axis=1)
    if level.min() < 0.1 * EARTH_RATE or np.ptp(vertical) > LOST * EARTH_RATE:
        return None
    north = north / level[:, None]
    return np.stack([north, np.cross(up, north), up], axis=2)


def _recordings(log: Log) -> list[int]:
    return [int(k) for k in np.unique(log.recording)]


def _among_stars(log: Log, recording: int) -> np.ndarray:
    """Rotations of one recording from its first sample's axes: the integral of the rates as they are."""
    assert log.reference_gyro is not None
    mine = log.recording == recording
    rate, time = log.reference_gyro[mine], log.time[mine]
    step = np.diff(time)[:, None]
    turns = Rotation.from_rotvec(0.5 * (rate[1:] + rate[:-1]) * step).as_matrix()
    return np.concatenate([np.eye(3)[None], _one_after_another(turns.transpose(0, 2, 1))])


def _one_after_another(turns: Float[np.ndarray, "step 3 3"]) -> Float[np.ndarray, "step 3 3"]:
    """Tₖ … T₁ for every k: within blocks of about √n steps side by side, and then over the blocks."""
    count = len(turns)
    length = max(int(np.sqrt(count)), 1)
    blocks = -(-count // length)
    made = np.broadcast_to(np.eye(3), (blocks * length, 3, 3)).copy()
    made[:count] = turns
    made = made.reshape(blocks, length, 3, 3)
    for k in range(1, length):
        made[:, k] = made[:, k] @ made[:, k - 1]
    for k in range(1, blocks):
        made[k] = made[k] @ made[k - 1, -1]
    return made.reshape(-1, 3, 3)[:count]


def _integrated(log: Log, recording: int) -> np.ndarray:
    """Rotations of one recording from its first sample's axes, which stay with the room.

    The reference rates of rests are Earth's, where they hold it: the integral is against the stars, and the room
    turns among them.
    """
    assert log.reference_gyro is not None
    mine = log.recording == recording
    rate, time, device = log.reference_gyro[mine], log.time[mine], _among_stars(log, recording)
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
