"""Means over segments, cut where they are long: one row per dwell, with the covariance of its mean."""

import dataclasses
import math
from collections.abc import Iterator, Sequence
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float, Int

from .._records import Module
from ..data.recording import Recording
from ..data.stored_recording import StoredRecording
from ..numerics.side_by_side import side_by_side
from .device_segments import segment_all
from .dwells import Dwells, is_told
from .held_rests import variance_by_parts
from .host_stamps import remark
from .manual_turns import turned_by_hand, with_known_angles
from .mean_covariance import covariances_of_means
from .rests import ALWAYS_MOVES, TURNED_SLOWLY, usual_step
from .rounded_temperature import hidden_by_steps, with_courses
from .sample_sums import joined_means, outputs_of, Reduced, reduced, scatter_of
from .segments import Segments
from .turning_hand import less_turning
from .wandering_rest import wander_of_rest


# Which dwells' scatter is pooled: that of plateaus (0), of rests (1), and these.
UNTOLD, MOVE, HELD = 2, 3, 4


def reduce_to_dwells(
    recordings: Recording | Sequence[Recording],
    *,
    longest: float | None = None,
    temperature_step: float | None = 1.0,
    window: float = 1.0,
    segments: Sequence[Segments] | None = None,
) -> Dwells:
    """Means over the rests and constant-rate plateaus of one device's recording or recordings, with covariances.

    **Arguments:**

    - `longest`: dwells are cut into equal blocks of at most this many seconds. `None`: no limit.
    - `temperature_step`: dwells are cut into equal blocks in which the temperature moves by at most
      about this much, °C, so that a sweep of hours in one pose is not one mean. `None`: never.
    - `window`: s, see `segment`.
    - `segments`: what `segment_all` gave for these recordings, where it is known already.

    Experiments without a column are numbered by recording. At a plateau (position −1) the
    accelerometers turn through gravity: their mean is right for linear terms such as
    g-sensitivity, their covariance large, and the invariant estimator has no use for them. Rests that a hand held are
    one dwell each, marked in `held`, and count for |a| alone (`AbstractEstimator.usable`). A probe's readings in whole
    steps are put between these (`rounded_temperature`).

    **Returns** one row per block in order of time within each recording, as NumPy arrays. For the
    covariances see `mean_covariance.covariances_of_means`: they hold what the scatter within a dwell
    says about its mean, not what changes from dwell to dwell (positioning, bias wander), but for a log of one
    rest (`wandering_rest`).

    Raises `ValueError` for several devices, for recordings with different columns, and where
    nothing rests.
    """
    recordings = [recordings] if isinstance(recordings, Recording) else list(recordings)
    _check_together(recordings)
    for name, value in (("longest", longest), ("temperature_step", temperature_step)):
        if value is not None and not value > 0:
            raise ValueError(f"`reduce_to_dwells({name}=...)` must be positive; got {value}.")
    hidden, recordings = hidden_by_steps(recordings), with_courses(recordings)
    labels = _experiments(recordings)
    found = segment_all(recordings, window=window, held=True) if segments is None else segments
    parts = [
        _blocks(recording, part, experiment, longest, temperature_step)
        for recording, part, experiment in zip(recordings, found, labels, strict=True)
    ]
    if not any(len(p.start) for p in parts):
        slowly = any(f.statement.endswith(TURNED_SLOWLY) for f in found)
        why = " (it moves all along and never lies still)" if slowly else ""
        # The reason is the statement's end: that the device moves, and how much where it moves least.
        moved = next((f.statement for f in found if ALWAYS_MOVES in f.statement), "")
        why = f" ({moved.removeprefix('no rest: ')})" if moved else why
        raise ValueError(
            f"{', '.join(r.name or 'recording' for r in recordings)}: no rest and no plateau of "
            f"constant rate{why}; let it lie for seconds in each orientation, or give a column 'position' of 0 or more "
            f"at rest (or reference_gyro).{next(filter(None, map(remark, recordings)), '')}"
        )
    dwells = _with_wander(_means(recordings, parts), recordings, parts)
    if not hidden:
        return dwells
    return dataclasses.replace(dwells, hidden_by_steps=np.full(dwells.num_dwells, hidden))


def _check_together(recordings: Sequence[Recording]) -> None:
    if not recordings:
        raise ValueError("`reduce_to_dwells(recordings)`: no recordings; at least one is needed.")
    for recording in recordings:
        if not isinstance(recording, Recording):
            raise ValueError(
                f"`reduce_to_dwells(recordings)`: {type(recording).__name__} is no Recording; make one by "
                f"`Recording.from_arrays(time, accel, gyro)`."
            )
    devices = list(dict.fromkeys(r.device for r in recordings))
    if len(devices) > 1:
        raise ValueError(
            f"`reduce_to_dwells(recordings)`: {len(devices)} devices {devices[:6]}; reduce each "
            "alone, with `Campaign.of_device`."
        )
    for column in ("accel", "gyro", "temperature", "reference_accel", "reference_gyro"):
        absent = [r.name for r in recordings if getattr(r, column) is None]
        if absent and len(absent) < len(recordings):
            other = next(r.name for r in recordings if getattr(r, column) is not None)
            raise ValueError(
                f"recording '{absent[0]}' has no {column} but '{other}' has; recordings of one "
                "device must have the same columns, so calibrate them as separate campaigns."
            )


def _experiments(recordings: Sequence[Recording]) -> Iterator[Int[np.ndarray, " time"]]:
    """Experiment numbers of every row; recordings without any get the numbers after the last.

    Parts of one log are one experiment.
    """
    known = [int(r.experiment.max()) for r in recordings if r.experiment is not None]
    fresh, before = max(known, default=-1), ""
    for recording in recordings:
        if recording.experiment is not None:
            yield recording.experiment
            continue
        whole = recording.whole if isinstance(recording, StoredRecording) else ""
        fresh += not whole or whole != before
        before = whole
        yield np.broadcast_to(fresh, recording.num_samples)


class _Blocks(Module):
    """Ranges of rows of one recording, one for each dwell, and which rows of the recording count."""

    start: Int[np.ndarray, " block"]
    stop: Int[np.ndarray, " block"]
    segment: Int[np.ndarray, " block"]
    position: Int[np.ndarray, " block"]
    experiment: Int[np.ndarray, " block"]
    used: Bool[np.ndarray, " time"]
    turning: float | None  # m/s², see `Segments`
    move: Bool[np.ndarray, " block"]
    held: Bool[np.ndarray, " block"]  # by hand

    @property
    def counts(self) -> Int[np.ndarray, " block"]:
        """Rows of each range that count."""
        total = np.append(0, np.cumsum(self.used))
        return total[self.stop] - total[self.start]


def _blocks(
    recording: Recording,
    segments: Segments,
    experiment: Int[np.ndarray, " time"],
    longest: float | None,
    temperature_step: float | None,
) -> _Blocks:
    counts = segments.stop - segments.start
    pieces = np.ones(len(counts), np.int64)
    if longest is not None:
        duration = counts * usual_step(recording)
        pieces = np.maximum(pieces, np.ceil(duration / longest * (1 - 1e-9)).astype(np.int64))
    if temperature_step is not None and recording.temperature is not None:
        by_temperature = _pieces_by_temperature(recording, segments, temperature_step)
        pieces = np.maximum(pieces, by_temperature)
    whole = segments.known_moves | segments.held_by_hand
    pieces = np.where(whole, 1, np.minimum(pieces, counts))
    owner = np.repeat(np.arange(len(counts)), pieces)
    within = np.arange(len(owner)) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    start = segments.start[owner] + within * counts[owner] // pieces[owner]
    stop = segments.start[owner] + (within + 1) * counts[owner] // pieces[owner]
    total = np.append(0, np.cumsum(segments.used))
    filled = total[stop] > total[start]  # a piece may be disturbed from end to end
    start, stop, owner = start[filled], stop[filled], owner[filled]
    where = segments.position[owner]
    move, held = segments.known_moves[owner], segments.held_by_hand[owner]
    return _Blocks(
        start, stop, owner, where, experiment[start], segments.used, segments.turning, move, held
    )


def _pieces_by_temperature(
    recording: Recording, segments: Segments, step: float
) -> Int[np.ndarray, " segment"]:
    """Equal pieces of a segment in which even the steepest part moves by `step` °C at most."""
    assert recording.temperature is not None
    probe = recording.temperature[:, 0]
    pieces = np.ones(segments.num_segments, np.int64)
    if not len(pieces):
        return pieces
    edges = np.column_stack([segments.start, segments.stop]).ravel()
    last = edges[-1] == len(probe)  # reduceat takes no edge past the end
    spread = np.maximum.reduceat(probe, edges[:-1] if last else edges)[::2]
    spread = spread - np.minimum.reduceat(probe, edges[:-1] if last else edges)[::2]
    for k in np.flatnonzero(spread > step):
        t = probe[segments.start[k] : segments.stop[k]]
        chunks = min(64, max(2, len(t) // 32))
        bounds = np.arange(chunks + 1) * len(t) // chunks
        means = np.add.reduceat(t, bounds[:-1]) / np.diff(bounds)
        noise = np.std(np.diff(t)) / math.sqrt(bounds[1])  # of a difference of two chunk means
        steepest = float(np.abs(np.diff(means)).max()) - 4.0 * noise
        pieces[k] = min(math.ceil(max(steepest * chunks / step, 1.0)), max(1, len(t) // 8))
    return pieces


def _means(recordings: Sequence[Recording], parts: list[_Blocks]) -> Dwells:
    # Recording by recording, so that no more than the samples of a few are held.
    of_one = lambda pair: reduced(pair[0], pair[1].start, pair[1].stop, pair[1].used)
    rows = sum(r.num_samples for r in recordings)
    found = side_by_side(of_one, zip(recordings, parts, strict=True), rows=rows)
    counts = np.concatenate([p.counts for p in parts])
    pairs = list(zip(recordings, parts, strict=True))
    step = np.concatenate([np.full(len(p.start), usual_step(r)) for r, p in pairs])
    position = np.concatenate([p.position for p in parts])
    mean = lambda column: joined_means(found, column)
    time, temperature = mean("time"), mean("temperature")
    assert time is not None
    move, force = np.concatenate([p.move for p in parts]), mean("reference_accel")
    if force is not None:  # of a point beside the axes only plateaus tell the force
        force = np.where(move[:, None], 0.0, force)
    held = np.concatenate([p.held for p in parts])
    kind = np.where(move, MOVE, np.where(held, HELD, position >= 0))
    return Dwells(
        time=time,
        duration=counts * step,
        count=counts.astype(float),
        temperature=np.zeros(len(counts)) if temperature is None else temperature[:, 0],
        experiment=np.concatenate([p.experiment for p in parts]),
        position=position,
        valid=np.ones(len(counts), bool),
        accel=_of_full_length(found, position),
        accel_covariance=_with_turning(
            parts, _with_parts(pairs, "accel", _covariances(found, "accel", kind, counts * step))
        ),
        gyro=mean("gyro"),
        gyro_covariance=_with_parts(
            pairs, "gyro", _covariances(found, "gyro", kind, counts * step)
        ),
        reference_accel=force,
        reference_gyro=mean("reference_gyro"),
        rows=_ranges(parts),
        move=move if move.any() else None,
        held=held if held.any() else None,
    )


def _with_wander(dwells: Dwells, recordings: Sequence[Recording], parts: list[_Blocks]) -> Dwells:
    """The dwells with what slow noise makes of the only rest's means, which no other rest can tell."""
    if dwells.num_dwells > 1 or dwells.position[0] < 0 or dwells.held is not None:
        return dwells
    assert dwells.rows is not None
    number, first, stop, _ = dwells.rows[0]
    if parts[number].turning is not None:
        return dwells
    rows = first + np.flatnonzero(parts[number].used[first:stop])
    wander, changed = np.zeros(6), {}
    for k, triad in enumerate(("accel", "gyro")):
        covariance = getattr(dwells, f"{triad}_covariance")
        if covariance is None:
            continue
        outputs = outputs_of(recordings[number], triad, rows)
        more = wander_of_rest(outputs, np.diagonal(covariance[0]))
        changed[f"{triad}_covariance"] = covariance + np.diag(more)
        wander[3 * k : 3 * k + 3] = np.sqrt(more)
    if not wander.any():
        return dwells
    return dataclasses.replace(dwells, **changed, wander=wander[None])


def _of_full_length(
    found: Sequence[Reduced], position: Int[np.ndarray, " dwell"]
) -> Float[np.ndarray, "dwell 3"] | None:
    """Mean forces, at rest of the length that they have at each moment, not of their mean where a hand turns them."""
    mean = joined_means(found, "accel")
    shorter = [f.shorter for f in found if f.shorter is not None]
    if mean is None or len(shorter) < len(found):
        return mean
    return mean * (1.0 + np.where(position >= 0, np.concatenate(shorter), 0.0))[:, None]


def _with_turning(
    parts: list[_Blocks], covariance: Float[np.ndarray, "dwell 3 3"] | None
) -> Float[np.ndarray, "dwell 3 3"] | None:
    """Where a device turns slowly all along, the scatter about the ellipsoid says what each stretch is worth."""
    if covariance is None or all(p.turning is None for p in parts):
        return covariance
    own = [np.full(len(p.start), np.nan if p.turning is None else p.turning) for p in parts]
    sigma = np.concatenate(own)[:, None, None]
    return np.where(np.isnan(sigma), covariance, sigma**2 * np.eye(3))


def _with_parts(
    pairs: Sequence[tuple[Recording, _Blocks]],
    triad: Literal["accel", "gyro"],
    covariance: Float[np.ndarray, "dwell 3 3"] | None,
) -> Float[np.ndarray, "dwell 3 3"] | None:
    """The covariances, of rests held by hand at least the variances that their parts show."""
    if covariance is None or not any(part.held.any() for _, part in pairs):
        return covariance
    of_parts = np.zeros((len(covariance), 3))
    ends = np.cumsum([len(part.start) for _, part in pairs])
    for (recording, part), end in zip(pairs, ends, strict=True):
        held = np.flatnonzero(part.held)
        rows = end - len(part.start) + held
        of_parts[rows] = variance_by_parts(
            getattr(recording, triad), part.start[held], part.stop[held]
        )
    missing = np.maximum(of_parts - np.diagonal(covariance, axis1=1, axis2=2), 0.0)
    return covariance + missing[:, :, None] * np.eye(3)


def _ranges(parts: list[_Blocks]) -> Int[np.ndarray, "dwell 4"]:
    """Number of the recording, first row, one past the last, and number of the segment of each dwell."""
    ranges = [
        np.column_stack([np.full(len(p.start), k), p.start, p.stop, p.segment])
        for k, p in enumerate(parts)
    ]
    return np.concatenate(ranges).astype(np.int64)


def _covariances(
    found: Sequence[Reduced],
    triad: Literal["accel", "gyro"],
    kind: Int[np.ndarray, " dwell"],
    duration: Float[np.ndarray, " dwell"],
) -> Float[np.ndarray, "dwell 3 3"] | None:
    scatter = scatter_of(found, triad)
    if scatter is None:
        return None
    resting = kind == 1
    ideal, pool = joined_means(found, f"reference_{triad}"), kind
    if triad == "accel" and ideal is not None:
        # Without its reference the force that turns in the case would pass for noise of the other plateaus.
        pool = np.where(is_told(ideal), pool, UNTOLD)
    covariance = covariances_of_means(scatter, pool)
    if triad == "accel" and ideal is None and (output := joined_means(found, "accel")) is not None:
        covariance = less_turning(covariance, scatter, output, resting)
    if triad == "accel" or ideal is None:
        return covariance
    spread = np.concatenate([f.spread for f in found if f.spread is not None])
    moves = kind == MOVE
    turns = turned_by_hand(spread, ideal, resting | moves)
    covariance = with_known_angles(covariance, duration, turns, resting)
    # The errors of a move's two positionings are the rig's: `rig_errors`.
    return with_known_angles(covariance, duration, moves, resting, 0.0)
