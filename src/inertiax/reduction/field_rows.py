"""Rows for the magnetometers' estimate: means over rests, and single samples of the motions between them.

A rest tells the field's magnitude and its angle to the vertical; a sample in motion the magnitude, which needs neither
a clock nor accelerometers. Samples in motion are thinned to one per few degrees of turn: neighbours tell the same, and
share what the model leaves out. Rows in which the magnetometers were not read are gaps; values that a slower sensor
repeats are averaged as they are, and the noise of the mean knows of it by their correlation.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from .._jax import eqx
from ..data.recording import Recording
from .dwells import Dwells
from .mean_covariance import covariances_of_means
from .mean_noise import converter_steps
from .sample_sums import joined_means, Reduced, reduced, scatter_of
from .steady_field import without_current_changes


TURN = np.radians(5.0)  # between samples in motion (convention: 500 of them cover the sphere)
_MOST_LOOKED_AT = 20_000  # samples of a recording that are looked at, evenly spread: hours at 1 Hz
# rad, of the field within a rest: the mean is shorter by 1e-4 then (convention: a hand that means to hold still).
STILL = np.radians(2.0)
MOST_IN_MOTION = 2000  # rows of a recording; more only repeat what the model leaves out


class _Rests(NamedTuple):
    """Rests of one recording in which the magnetometers were read."""

    own: Int[np.ndarray, " rest"]  # their numbers among all dwells
    sums: Reduced
    current: Float[np.ndarray, " rest"] | None


def field_rows(
    recordings: Sequence[Recording],
    dwells: Dwells | None,
    inside: Sequence[Bool[np.ndarray, " time"]] | None = None,
) -> Dwells:
    """Rests (position ≥ 0) and samples in motion (position −1) of one device, with `mag` and its covariance, T.

    **Arguments:** `dwells` are the rests as `reduce_to_dwells` made them of the same recordings, whose `accel` shows
    the vertical; plateaus of constant rate among them are left to the samples in motion. `inside` says which rows of
    each recording belong to a rest that nothing disturbs. Without them all samples are in motion.

    Raises `ValueError` where no sample of the magnetometers is left.
    """
    parts: list[Dwells] = []
    found: list[_Rests] = []
    noise: list[np.ndarray] = []
    for number, recording in enumerate(recordings):
        if recording.mag is None:
            continue
        read = np.flatnonzero(np.isfinite(recording.mag).all(axis=1))
        if not len(read):
            continue
        mine = recording[read]
        noise.append(sample_noise(_mag(mine)))
        resting = np.zeros(recording.num_samples, bool) if inside is None else inside[number]
        if dwells is not None:
            rests = _rests(mine, read, resting, dwells, number)
            found += [] if rests is None else [rests]
            resting = _rows_of(rests, dwells, recording) & resting
        moving = _spread_out(_mag(mine), ~resting[read])
        if len(moving):  # a log of labelled rests alone has none
            parts.append(_in_motion(mine[moving], noise[-1]))
    if dwells is not None and found:
        parts.insert(0, _at_rest(dwells, found))
    if not parts or not sum(p.num_dwells for p in parts):
        raise ValueError("the mag columns hold no sample.")
    return _joined(parts)


def _mag(recording: Recording) -> Float[np.ndarray, "time 3"]:
    assert recording.mag is not None
    return recording.mag


def sample_noise(mag: Float[np.ndarray, "time 3"]) -> Float[np.ndarray, "3"]:
    """1 sigma of single samples, T, also in motion: from the median of squared second differences.

    (x₁ − 2 x₂ + x₃)² has the mean 6 σ², and of a Gaussian 0.4549 of that is the median; turns are slow beside the
    sampling. Never below what a converter's step leaves.
    """
    step = converter_steps(mag)
    fresh = np.append(True, (np.diff(mag, axis=0) != 0.0).any(axis=1))  # not a repeated value
    second = np.diff(mag[fresh], 2, axis=0)
    variance = np.median(np.square(second), axis=0) / (6.0 * 0.4549) if len(second) else 0.0
    return np.sqrt(np.maximum(variance, step**2 / 12.0))


def _rests(
    mine: Recording,
    read: Int[np.ndarray, " row"],
    resting: Bool[np.ndarray, " time"],
    dwells: Dwells,
    number: int,
) -> _Rests | None:
    """Sums over the rests of a recording in which its magnetometers read the same throughout.

    In a log that is turned all along the search for rests finds its slowest turns; their means would be too short. What
    a current that was logged moves the field by does not count.
    `read` are the rows that `mine` keeps of the recording.
    """
    assert dwells.rows is not None  # `reduce_to_dwells` says where they are
    where = np.asarray(dwells.rows)
    own = np.flatnonzero((where[:, 0] == number) & (np.asarray(dwells.position) >= 0))
    start, stop = np.searchsorted(read, where[own, 1]), np.searchsorted(read, where[own, 2])
    used = resting[read]
    total = np.append(0, np.cumsum(used))
    filled = total[stop] > total[start]
    own, start, stop = own[filled], start[filled], stop[filled]
    held = None if mine.current is None else held_current(mine)
    if len(own):
        if held is not None:
            noise = sample_noise(_mag(mine))
            mine = without_current_changes(mine, held, start, stop, used, noise)
        still = _still(reduced(mine, start, stop, used, ("time", "mag")), mine)
        own, start, stop = own[still], start[still], stop[still]
    if not len(own):
        return None
    sums = reduced(mine, start, stop, used, ("time", "mag"))
    if held is None:
        return _Rests(own, sums, None)
    return _Rests(own, sums, np.add.reduceat(held[sums.rows], _starts(sums)) / sums.counts)


def _still(sums: Reduced, mine: Recording) -> Bool[np.ndarray, " rest"]:
    """Rests in which the field does not turn by more than `STILL`, in a straight line or otherwise."""
    line, mag = sums.mag, _mag(mine)
    assert line is not None
    size = np.median(np.linalg.norm(mag - _middle(mag), axis=1))
    duration = mine.time[sums.stop - 1] - mine.time[sums.start]
    drift = np.linalg.norm(line.slope, axis=1) * duration
    spread = np.trace(line.products, axis1=1, axis2=2) / sums.counts
    beyond = np.sqrt(np.maximum(spread - 4.0 * np.sum(sample_noise(mag) ** 2), 0.0))
    return np.maximum(drift, beyond) < STILL * size


def _rows_of(
    rests: _Rests | None, dwells: Dwells, recording: Recording
) -> Bool[np.ndarray, " time"]:
    """Rows of a recording that belong to one of its rests."""
    inside = np.zeros(recording.num_samples, bool)
    for first, stop in np.asarray(dwells.rows)[rests.own, 1:3] if rests is not None else ():
        inside[first:stop] = True
    return inside


def _middle(mag: Float[np.ndarray, "time 3"]) -> Float[np.ndarray, "3"]:
    """Near the hard iron, which may be larger than the field."""
    return 0.5 * (mag.min(axis=0) + mag.max(axis=0))


def _starts(sums: Reduced) -> Int[np.ndarray, " rest"]:
    return np.cumsum(sums.counts) - sums.counts


def held_current(recording: Recording) -> Float[np.ndarray, " time"]:
    """The current of every row as it was read last, A."""
    current = recording.current
    assert current is not None
    last = np.maximum.accumulate(np.where(np.isfinite(current), np.arange(len(current)), -1))
    first = np.flatnonzero(np.isfinite(current))
    return np.zeros(len(current)) if not len(first) else current[np.where(last < 0, first[0], last)]


def _at_rest(dwells: Dwells, found: list[_Rests]) -> Dwells:
    own = np.concatenate([f.own for f in found])
    sums = [f.sums for f in found]
    scatter, mean = scatter_of(sums, "mag"), joined_means(sums, "mag")
    assert scatter is not None and mean is not None
    currents = [f.current for f in found]
    rest = Dwells(
        time=np.asarray(dwells.time)[own],
        duration=np.asarray(dwells.duration)[own],
        count=np.concatenate([s.counts for s in sums]).astype(float),
        temperature=np.asarray(dwells.temperature)[own],
        experiment=np.asarray(dwells.experiment)[own],
        position=np.asarray(dwells.position)[own],
        valid=np.ones(len(own), bool),
        accel=None if dwells.accel is None else np.asarray(dwells.accel)[own],
        accel_covariance=None if dwells.accel is None else np.asarray(dwells.accel_covariance)[own],
        mag=mean,
        mag_covariance=covariances_of_means(scatter, np.zeros(len(own), int)),
    )
    if any(c is None for c in currents):
        return rest
    joined = np.concatenate([c for c in currents if c is not None])
    return eqx.tree_at(lambda d: d.current, rest, joined, is_leaf=lambda x: x is None)


def _spread_out(
    mag: Float[np.ndarray, "time 3"], moving: Bool[np.ndarray, " time"]
) -> Int[np.ndarray, " kept"]:
    """Samples in motion, each turned by `TURN` from the one kept before it."""
    rows = np.flatnonzero(moving)
    rows = rows[:: max(1, -(-len(rows) // _MOST_LOOKED_AT))]
    if not len(rows):
        return rows
    about = mag[rows] - _middle(mag)
    unit = about / np.maximum(np.linalg.norm(about, axis=1, keepdims=True), 1e-300)
    least, kept = np.cos(TURN), [0]
    for k in range(1, len(unit)):
        if unit[k] @ unit[kept[-1]] < least:
            kept.append(k)
    return rows[np.array(kept)][:: max(1, -(-len(kept) // MOST_IN_MOTION))]


def _in_motion(mine: Recording, noise: Float[np.ndarray, "3"]) -> Dwells:
    count = mine.num_samples
    probe = mine.temperature
    return Dwells(
        time=mine.time,
        duration=np.zeros(count),
        count=np.ones(count),
        temperature=np.zeros(count) if probe is None else probe[:, 0],
        experiment=np.zeros(count, int) if mine.experiment is None else mine.experiment,
        position=np.full(count, -1),
        valid=np.ones(count, bool),
        mag=mine.mag,
        mag_covariance=np.broadcast_to(np.diag(noise**2), (count, 3, 3)),
        current=None if mine.current is None else held_current(mine),
    )


def _joined(parts: list[Dwells]) -> Dwells:
    """One after the other. Where the vertical is known at the rests alone, others have any."""
    with_force = any(p.accel is not None for p in parts)
    with_current = all(p.current is not None for p in parts)

    def column(part: Dwells, name: str) -> np.ndarray:
        value = getattr(part, name)
        if value is not None:
            return np.asarray(value)
        unit = np.array([0.0, 0.0, 1.0]) if name == "accel" else np.zeros((3, 3))
        return np.broadcast_to(unit, (part.num_dwells, *unit.shape))

    names = ["time", "duration", "count", "temperature", "experiment", "position", "valid"]
    names += ["mag", "mag_covariance", *(["accel", "accel_covariance"] if with_force else [])]
    names += ["current"] if with_current else []
    made: dict[str, Any] = {n: np.concatenate([column(p, n) for p in parts]) for n in names}
    return Dwells(**made)
