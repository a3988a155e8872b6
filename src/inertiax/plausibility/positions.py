"""Positions that are not what they are called: a face twice and its opposite missing, a label in two attitudes."""

import re

import numpy as np
from jaxtyping import Float, Int

from ..physics.vectors import angle_between
from .evidence import DeviceLogs
from .finding import Finding, finding
from .thresholds import Thresholds


_FACES = np.concatenate([np.eye(3), -np.eye(3)])
_FACE_NAMES = ("+x", "+y", "+z", "−x", "−y", "−z")
_NAMED = re.compile(
    r"(pos|neg|plus|minus|up|down|[+-])[^a-z]*([xyz])|([xyz])[^a-z]*(pos|neg|plus|minus|up|down)",
    re.I,
)


def check_positions(device: DeviceLogs, limits: Thresholds) -> list[Finding]:
    """Six faces of which one is missing, and labels that name two attitudes."""
    return [*_faces(device, limits), *_labels(device, limits)]


def _directions(
    device: DeviceLogs,
) -> tuple[Float[np.ndarray, "rest 3"], list[tuple[int, int]]]:
    """Unit vectors of all rests, and the recording and rest that each is of."""
    vectors, places = [], []
    for number, log in enumerate(device.logs):
        force = log.over_rests("accel")
        if force is None:
            continue
        vectors.append(force.mean)
        places += [(number, k) for k in range(log.num_rests)]
    if not vectors:
        return np.zeros((0, 3)), []
    all_ = np.concatenate(vectors)
    return all_ / np.maximum(np.linalg.norm(all_, axis=1, keepdims=True), 1e-300), places


def _faces(device: DeviceLogs, limits: Thresholds) -> list[Finding]:
    """A campaign of faces only, in which all but one stand opposite each other."""
    vectors, places = _directions(device)
    if not 5 <= len(vectors) <= 24:
        return []
    near = angle_between(vectors[:, None], _FACES[None]) < limits.same_face
    if not near.any(axis=1).all():
        return []
    face = near.argmax(axis=1)
    counts = np.bincount(face, minlength=6)
    missing = [k for k in range(6) if counts[k] == 0]
    if len(missing) != 1 or counts[(missing[0] + 3) % 6] < 2:
        return []
    other = (missing[0] + 3) % 6
    rests = [places[k] for k in np.flatnonzero(face == other)]
    if counts[other] <= np.median(counts[counts > 0]):
        return []
    names = [_rest_name(device, r) for r in rests]
    contradicts = _named_otherwise(device, rests, other)
    return [
        finding(
            "positions",
            "error" if contradicts else "warning",
            "accel",
            f"{' and '.join(names[:4])} show the same face ({_FACE_NAMES[other]} up), and no rest shows the opposite "
            f"one ({_FACE_NAMES[missing[0]]} up): one of them was recorded the wrong way up. Six different faces tell "
            "bias and scale factors only; misalignments need more positions, or reference_accel.",
            face=_FACE_NAMES[other],
            missing=_FACE_NAMES[missing[0]],
            rests=len(rests),
        )
    ]


def _rest_name(device: DeviceLogs, place: tuple[int, int]) -> str:
    log = device.logs[place[0]]
    if log.num_rests == 1:
        return log.name
    return f"{log.name} at {log.moment(log.recording.time[log.start[place[1]]])}"


def _named_otherwise(device: DeviceLogs, rests: list[tuple[int, int]], face: int) -> bool:
    """Whether file names say of one of the rests that the opposite face is up."""
    signs = set()
    for number, _ in rests:
        if device.logs[number].num_rests > 1:
            return False
        match = _NAMED.search(device.logs[number].name)
        if match is None:
            return False
        sign = (match.group(1) or match.group(4)).lower()
        axis = (match.group(2) or match.group(3)).lower()
        if "xyz".index(axis) != face % 3:
            return False
        signs.add(sign in ("pos", "plus", "up", "+"))
    return len(signs) == 2


def _labels(device: DeviceLogs, limits: Thresholds) -> list[Finding]:
    """Numbers of positions that nearly always mean one attitude, and once another."""
    vectors, places = _directions(device)
    labels: list[int] = []
    for number, k in places:
        position = device.logs[number].labels("position")
        if position is None:
            return []
        labels.append(int(position[k]))
    return _contradicting(device, vectors, np.array(labels, np.int64), places, limits)


def _contradicting(
    device: DeviceLogs,
    vectors: Float[np.ndarray, "rest 3"],
    labels: Int[np.ndarray, " rest"],
    places: list[tuple[int, int]],
    limits: Thresholds,
) -> list[Finding]:
    groups = [np.flatnonzero(labels == n) for n in np.unique(labels)] if len(labels) else []
    groups = [g for g in groups if len(g) >= 3]
    if len(groups) < 3:
        return []
    off: list[int] = []
    for g in groups:
        apart = angle_between(vectors[g][:, None], vectors[g][None])
        usual = int(np.argmin(np.median(apart, axis=1)))
        if np.median(apart[usual]) > 0.5 * limits.same_face:
            return []  # numbers do not name attitudes here
        off += [int(g[k]) for k in np.flatnonzero(apart[usual] > limits.same_face)]
    if not off or len(off) > 0.25 * sum(map(len, groups)):
        return []
    said = ", ".join(f"{labels[k]} in {_rest_name(device, places[k])}" for k in off[:4])
    return [
        finding(
            "positions",
            "warning",
            "position",
            f"{len(off)} rests stand otherwise than the other rests of their position do (position {said}): "
            "mislabelled, exchanged, or the device was mounted otherwise.",
            rests=len(off),
        )
    ]
