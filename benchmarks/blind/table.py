"""The table: how a programme turns the device, sample by sample.

Nothing here knows of sensors. A plan is sampled at the rate of the log; `up` and `north` are unit
vectors of the room seen from the case, `rate` is the table's angular rate in case axes (rad/s).
"""

from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation


@dataclass
class Plan:
    """A sampled test plan; every array has one row a sample."""

    name: str
    time: np.ndarray  # s
    up: np.ndarray  # (n, 3)
    north: np.ndarray  # (n, 3)
    rate: np.ndarray  # (n, 3) rad/s, table only
    chamber: np.ndarray  # °C, air
    experiment: np.ndarray
    position: np.ndarray  # -1 while the table turns
    session: np.ndarray  # one power cycle, one recording file
    dwell: np.ndarray  # number of the rest or plateau, -1 in between
    resting: np.ndarray  # bool: the dwell is a rest
    move_size: np.ndarray  # (n, 3) change of `up` at the move that came before this dwell
    angles: np.ndarray  # (n, 2) outer and inner table angle at rests, rad
    model: dict  # the [model] section
    block_seconds: float
    references: tuple = ()  # "accel", "gyro": which reference columns are logged
    options: dict = field(default_factory=dict)

    @property
    def triads(self) -> list[str]:
        return [k for k in ("accel", "gyro") if f"{k}_estimator" in self.model]


class Table:
    """Builds a plan move by move, as an operator writes a programme."""

    def __init__(self, fs: float):
        self.fs = fs
        self.rows: list[dict] = []
        self.clock = 0.0
        self.room_to_case = Rotation.identity()
        self.session = self.experiment = 1
        self.dwells = 0
        self.last_up = np.array([0.0, 0.0, 1.0])
        self.angles = np.zeros(2)

    def _emit(self, rotations, rates, position, dwell, resting, change):
        n = len(rates)
        case = rotations.as_matrix()
        self.rows.append(
            dict(
                time=self.clock + (np.arange(n) + 0.5) / self.fs,
                up=case[:, :, 2],
                north=case[:, :, 1],
                rate=rates,
                position=np.full(n, position),
                dwell=np.full(n, dwell),
                resting=np.full(n, resting),
                session=np.full(n, self.session),
                experiment=np.full(n, self.experiment),
                move_size=np.broadcast_to(change, (n, 3)),
                angles=np.broadcast_to(self.angles, (n, 2)),
            )
        )
        self.clock += n / self.fs

    def _samples(self, seconds: float) -> int:
        return max(int(round(seconds * self.fs)), 1)

    def move(self, target: Rotation, seconds: float | None = None, top_rate: float = 0.6):
        """Turn to an attitude about one axis, smoothly (sin² rate), at most `top_rate` rad/s."""
        turn = (target * self.room_to_case.inv()).as_rotvec()
        angle = float(np.linalg.norm(turn))
        seconds = seconds or max(1.5, 2 * angle / top_rate)
        n = self._samples(seconds)
        s = (np.arange(n) + 0.5) / n
        gone = s - np.sin(2 * np.pi * s) / (2 * np.pi)
        speed = (1 - np.cos(2 * np.pi * s)) * self.fs / n
        path = Rotation.from_rotvec(gone[:, None] * turn) * self.room_to_case
        # The case turns by +φ when room vectors, seen from it, turn by -φ.
        self._emit(path, -speed[:, None] * turn, -1, -1, False, np.zeros(3))
        self.room_to_case = target

    def rest(self, seconds: float, position: int):
        n = self._samples(seconds)
        up = self.room_to_case.as_matrix()[:, 2]
        path = Rotation.concatenate([self.room_to_case] * n)
        self._emit(path, np.zeros((n, 3)), position, self.dwells, True, up - self.last_up)
        self.last_up = up
        self.dwells += 1

    def spin(self, axis: np.ndarray, rate: float, seconds: float, ramp: float = 3.0):
        """A plateau at `rate` (rad/s) about a case axis, with a linear run-up and run-down."""
        axis = np.asarray(axis, float) / np.linalg.norm(axis)
        for kind, t in (("up", ramp), ("flat", seconds), ("down", ramp)):
            n = self._samples(t)
            s = (np.arange(n) + 0.5) / self.fs
            end = n / self.fs
            if kind == "up":
                w, th, total = rate * s / end, rate * s**2 / (2 * end), rate * end / 2
            elif kind == "flat":
                w, th, total = np.full(n, rate), rate * s, rate * end
            else:
                w, th, total = rate * (1 - s / end), rate * (s - s**2 / (2 * end)), rate * end / 2
            path = Rotation.from_rotvec(-th[:, None] * axis) * self.room_to_case
            dwell = self.dwells if kind == "flat" else -1
            self._emit(path, w[:, None] * axis, -1, dwell, False, np.zeros(3))
            self.dwells += kind == "flat"
            self.room_to_case = Rotation.from_rotvec(-total * axis) * self.room_to_case

    def pause(self, seconds: float):
        """Power off: the log stops and a new session begins."""
        self.clock += seconds
        self.session += 1

    def plan(self, name, chamber_at, **rest) -> Plan:
        columns = {k: np.concatenate([r[k] for r in self.rows]) for k in self.rows[0]}
        return Plan(name=name, chamber=chamber_at(columns["time"]), **columns, **rest)


def attitude(up: np.ndarray, heading: float) -> tuple[Rotation, np.ndarray]:
    """Room-to-case rotation that puts `up` (case axes) upward, the table base turned by `heading`.

    Outer angle a about room x, inner angle b about case z: case to room is Rz(h) Rx(a) Rz(b), so
    up = (sin a sin b, sin a cos b, cos a). **Returns** the rotation and (a, b).
    """
    up = np.asarray(up, float) / np.linalg.norm(up)
    a = np.arccos(np.clip(up[2], -1, 1))
    b = np.arctan2(up[0], up[1]) if abs(up[2]) < 1 - 1e-12 else 0.0
    case_to_room = (
        Rotation.from_euler("z", heading)
        * Rotation.from_euler("x", a)
        * Rotation.from_euler("z", b)
    )
    return case_to_room.inv(), np.array([a, b])


def directions(count: int) -> np.ndarray:
    """Where `up` points in the case, for the usual tumbles of 6, 12, 18, 24 or 36 positions."""
    eye = np.eye(3)
    if count in (6, 18):
        faces = np.concatenate([eye, -eye])
        if count == 6:
            return faces
        edges = [
            s * eye[i] + t * eye[j]
            for i in range(3)
            for j in range(i)
            for s in (1, -1)
            for t in (1, -1)
        ]
        return np.concatenate([faces, np.array(edges) / np.sqrt(2)])
    per_plane = count // 3
    out = []
    for i, j in ((0, 1), (1, 2), (2, 0)):
        for k in range(per_plane):
            angle = 2 * np.pi * k / per_plane
            out.append(np.cos(angle) * eye[i] + np.sin(angle) * eye[j])
    return np.array(out)


def scattered(count: int, rng) -> np.ndarray:
    """Random but even directions: spread out a random start by a golden spiral, turned at random."""
    k = np.arange(count) + 0.5
    z, phi = 1 - 2 * k / count, np.pi * (1 + np.sqrt(5)) * k
    ring = np.sqrt(1 - z**2)
    points = np.stack([ring * np.cos(phi), ring * np.sin(phi), z], 1)
    return Rotation.random(rng=rng).apply(points)
