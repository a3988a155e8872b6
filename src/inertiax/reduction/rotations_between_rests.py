"""The turns between rests, gathered from recordings for the gyro estimator by gravity rotation."""

from collections.abc import Callable, Mapping, Sequence
from typing import NoReturn

import numpy as np
from jaxtyping import Bool, Float, Int

from .._jax import eqx
from ..data.recording import Recording
from ..numerics.paule_mandel import excess_deviation
from ..physics.vectors import angle_between, unit_vector
from .clipping import clipped_rows
from .contradicted_motions import ANY_GYRO, Contradiction, contradiction
from .dwells import Dwells, without_held
from .missed_turns import missed
from .motion_clock import motion_clock, MotionClock, step_angles, Turn
from .motions import Motions
from .rests import PAUSE, usual_step
from .turned_direction import turned


_LONGEST = 60.0  # s; by then a consumer gyro's bias has wandered off by degrees
_LARGEST_STEP = 0.5  # rad; beyond, samples are too sparse to follow the motion
_FEWEST_SAMPLES = 4
_SHORTEST_ARRAY = 64  # samples; lengths are rounded up, since each one compiles anew
_LEAST_SIGMA = 1e-8  # rad/s, 2e-3 °/h: a floor where a recording is free of noise
_BEYOND = "at rates beyond 4000 deg/s, which no such gyro reads: look at the unit of each axis"
_DIFFERENT_TILT = np.deg2rad(10.0)


Force = Callable[[Recording], Float[np.ndarray, "time 3"]]


class _Rest(eqx.Module):
    """Rows `[start, stop)` of one recording that a dwell is the mean of."""

    recording: int = eqx.field(static=True)
    start: int = eqx.field(static=True)
    stop: int = eqx.field(static=True)
    segment: int = eqx.field(static=True)


class Turns(eqx.Module):
    """Rests with the motions between them, and what became of those."""

    dwells: Dwells  # the rests, each with its `motion`
    statement: str = eqx.field(static=True)  # how many motions are used and why others are not
    # Where most motions that tilt the device miss gravity's turn.
    contradicted: Contradiction | None = eqx.field(static=True, default=None)

    @property
    def num_motions(self) -> int:
        """Motions that are used."""
        return int(np.sum(np.asarray(_motions(self.dwells).valid)))


def with_motions(
    recordings: Sequence[Recording],
    dwells: Dwells,
    *,
    force: Force | None = None,
) -> Turns:
    """The rests among `dwells`, each with the motion that led to it from the rest before.

    **Arguments:**

    - `dwells`: all that `reduce_to_dwells(recordings)` gave, in its order, with
      accelerometer means that have been compensated (and covariances that say how well). Rests that a hand held are
      parts of motions.
    - `force`: gives the compensated specific force of every sample of a recording, m/s² (time, 3); needed
      for g-sensitivity alone.

    A motion is left out where time pauses, where it is longer than a minute, where samples are
    more than half a radian apart, where a gyro is at the end of its range, where there are
    fewer than four samples, and where it alone misses gravity's turn (see `missed`). Uneven stamps
    give way to counted rows where gravity says so (see `motion_clock`). The variance of the
    integrated rate about each axis is N² T + τ² T²: N² is the angle random walk that the rests'
    covariances imply, τ the scatter of the bias between rests (see `bias_scatter`), T the
    motion's duration; τ² is added to the covariance of the rests' mean rates too.

    Raises `ValueError` where a triad is missing or `dwells` are of other recordings.
    """
    if dwells.accel is None or dwells.gyro is None:
        absent = "accel" if dwells.accel is None else "gyro"
        raise ValueError(
            f"`with_motions(recordings, dwells)`: gravity's rotation needs both triads, but there are "
            f"no {absent} columns; use the gyro estimator 'static'."
        )
    dwells = without_held(dwells)
    found = _rows_of(recordings, dwells)
    resting = np.flatnonzero(np.asarray(dwells.position) >= 0)
    rests = [found[k] for k in resting]
    dwells = dwells[resting]
    wander = bias_scatter(dwells, g_sensitivity=force is not None)
    extra = max(wander, _LEAST_SIGMA) ** 2 * np.eye(3)
    walk = _angle_random_walk(dwells)
    dwells = eqx.tree_at(
        lambda d: d.gyro_covariance, dwells, np.asarray(dwells.gyro_covariance) + extra
    )
    pairs, dropped, beyond = _pairs(recordings, rests, np.asarray(dwells.gyro))
    looked_at = pairs | beyond
    misfit, path = _misfits(recordings, rests, looked_at, dwells)
    contradicted = _contradicted(recordings, rests, looked_at, dwells, misfit, path)
    off = np.zeros(len(rests), bool)
    off[pairs] = missed(misfit[pairs], path[pairs])
    if off.any():
        pairs &= ~off
        began = sorted(
            recordings[rests[k].recording].time[rests[k - 1].stop - 1] for k in np.flatnonzero(off)
        )
        where = ", ".join(f"{t:.1f} s" for t in began[:3]) + ", …" * (len(began) > 3)
        dropped[f"that miss gravity's turn while the others do not (from {where})"] = int(off.sum())
    times, said = {}, {}  # of recordings whose stamps give way; the others' need not be held
    for k, recording in enumerate(recordings):
        clock = _clock(k, recording, rests, pairs, dwells)
        said[clock.statement] = None
        if clock.rate is not None:
            times[k] = clock.time
    motion = _gather(recordings, times, rests, pairs, dwells, walk, wander, force)
    statement = f"{int(pairs.sum())} motions between {len(rests)} rests"
    if dropped:
        statement += f"; left out: {', '.join(f'{n} {why}' for why, n in dropped.items())}"
    statement += "".join(f"; {text}" for text in said if text)
    dwells = eqx.tree_at(lambda d: d.motion, dwells, motion, is_leaf=lambda x: x is None)
    return Turns(dwells, statement, contradicted)


def bias_scatter(dwells: Dwells, *, g_sensitivity: bool = False) -> float:
    """Scatter of the gyros' mean outputs from rest to rest beyond their own noise, rad/s.

    What is left of a line in temperature (and of D a, with `g_sensitivity`) by Paule and Mandel. It
    holds bias wander, Earth rate in changing attitudes and, where D is not estimated, D too.
    """
    gyro, covariance = np.asarray(dwells.gyro), np.asarray(dwells.gyro_covariance)
    temperature = np.asarray(dwells.temperature)
    columns = [np.ones(len(gyro))]
    if np.ptp(temperature) >= 1.0:
        columns.append((temperature - temperature.mean()) / np.ptp(temperature))
    if g_sensitivity:
        force = np.asarray(dwells.accel)
        columns += list(force.T / np.linalg.norm(force, axis=1).mean())
    design = np.stack(columns, axis=1)
    if len(gyro) <= design.shape[1]:
        design = design[:, :1]
    misfit = gyro - design @ np.linalg.lstsq(design, gyro, rcond=None)[0]
    sigma = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    return float(excess_deviation(misfit.ravel(), sigma.ravel(), 3 * design.shape[1]))


def shortfall(turns: Turns) -> str | None:
    """Why the motions cannot tell scale factors and misalignments, in words; `None` where they may.

    Asked for are five motions (two equations each for nine unknowns) from one rest's direction to
    another, 10° or more away, about axes that do not lie in a plane.
    """
    motion = _motions(turns.dwells)
    used = np.asarray(motion.valid)
    before, after = (
        unit_vector(motion.start_force)[used],
        unit_vector(np.asarray(turns.dwells.accel))[used],
    )
    axes = np.cross(before, after)
    tilted = angle_between(before, after) > _DIFFERENT_TILT
    if tilted.sum() < 5:
        others = turns.statement.partition("; ")[2]
        return (
            f"{int(tilted.sum())} motions tilt the device by 10° or more; at least 5 are needed"
            + (f" ({others})" if others else "")
        )
    spread = np.linalg.svd(axes[tilted], compute_uv=False)
    if spread[-1] < 0.1 * spread[0]:
        return (
            "the motions between rests turn about axes in one plane; tilts about a third are needed"
        )
    return None


def _motions(dwells: Dwells) -> Motions:
    assert dwells.motion is not None
    return dwells.motion


def _rows_of(recordings: Sequence[Recording], dwells: Dwells) -> list[_Rest]:
    """The rows that each dwell is the mean of."""
    if dwells.rows is None:
        _refuse_dwells()
    rows = np.asarray(dwells.rows)
    ends = np.array([r.num_samples for r in recordings])
    if np.any(rows[:, 0] >= len(ends)) or np.any(rows[:, 2] > ends[rows[:, 0] % len(ends)]):
        _refuse_dwells()
    return [_Rest(*(int(x) for x in row)) for row in rows]


def _refuse_dwells() -> NoReturn:
    raise ValueError(
        "`with_motions(recordings, dwells)`: the dwells are not those of these recordings; give what "
        "`reduce_to_dwells(recordings)` returned, all of it and in its order."
    )


def _angle_random_walk(dwells: Dwells) -> Float[np.ndarray, " dwell"]:
    """N², rad²/s: variance of the mean rate times the duration, mean over the axes."""
    covariance = np.asarray(dwells.gyro_covariance)
    return np.trace(covariance, axis1=1, axis2=2) / 3.0 * np.asarray(dwells.duration)


def _pairs(
    recordings: Sequence[Recording], rests: list[_Rest], bias: Float[np.ndarray, "dwell 3"]
) -> tuple[Bool[np.ndarray, " dwell"], dict[str, int], Bool[np.ndarray, " dwell"]]:
    """Which rests a usable motion led to, how many were left out for what, and for rates that no gyro reads."""
    kept, beyond = np.zeros(len(rests), bool), np.zeros(len(rests), bool)
    dropped: dict[str, int] = {}
    ended = [np.zeros(0, bool) if r.gyro is None else clipped_rows(r.gyro) for r in recordings]
    for k in range(1, len(rests)):
        before, after = rests[k - 1], rests[k]
        if (before.recording, before.segment) == (after.recording, after.segment):
            continue  # the same rest cut in blocks
        if before.recording != after.recording or before.stop == after.start:
            continue  # no motion, or another recording
        why = _flaw(recordings[after.recording], before.stop - 1, after.start, bias[k])
        if why is None and ended[after.recording][before.stop - 1 : after.start + 1].any():
            why = "with rates beyond the gyros' range"
        kept[k], beyond[k] = why is None, why == _BEYOND
        if why is not None:
            dropped[why] = dropped.get(why, 0) + 1
    return kept, dropped, beyond


def _flaw(recording: Recording, first: int, last: int, bias: Float[np.ndarray, "3"]) -> str | None:
    """Why the motion over the rows `first` to `last` cannot be integrated."""
    assert recording.gyro is not None
    steps = np.diff(recording.time[first : last + 1])
    if last - first < _FEWEST_SAMPLES:
        return f"with fewer than {_FEWEST_SAMPLES} samples"
    if np.any(steps > PAUSE * usual_step(recording)):
        return "with a pause in the time stamps"
    if recording.time[last] - recording.time[first] > _LONGEST:
        return f"longer than {_LONGEST:g} s"
    rate = np.linalg.norm(recording.gyro[first : last + 1] - bias, axis=1)
    if np.any(np.maximum(rate[1:], rate[:-1]) * steps > _LARGEST_STEP):
        return _BEYOND if rate.max() > ANY_GYRO else "too fast for the sampling rate"
    return None


def _clock(
    number: int,
    recording: Recording,
    rests: list[_Rest],
    pairs: Bool[np.ndarray, " dwell"],
    dwells: Dwells,
) -> MotionClock:
    """By what one recording's motions are integrated."""
    assert recording.gyro is not None
    turns = _turns_of(rests, np.flatnonzero(pairs & _of_recording(rests, number)), dwells)
    return motion_clock(recording.time, recording.gyro, turns)


def _misfits(
    recordings: Sequence[Recording],
    rests: list[_Rest],
    looked_at: Bool[np.ndarray, " dwell"],
    dwells: Dwells,
) -> tuple[Float[np.ndarray, " dwell"], Float[np.ndarray, " dwell"]]:
    """By how much the motion that led to each rest misses gravity's turn, and through which angle it turned, rad."""
    misfit, path = np.zeros(len(rests)), np.zeros(len(rests))
    for number, recording in enumerate(recordings):
        led = np.flatnonzero(looked_at & _of_recording(rests, number))
        if not len(led):
            continue
        assert recording.gyro is not None
        turns = _turns_of(rests, led, dwells)
        angle = step_angles(recording.time, recording.gyro, turns)
        before, after = (
            np.stack([getattr(t, name) for t in turns]) for name in ("before", "after")
        )
        end = np.einsum("mij,mj->mi", turned(angle), before)
        misfit[led] = angle_between(end, after)
        path[led] = np.linalg.norm(angle, axis=2).sum(axis=1)
    return misfit, path


def _contradicted(
    recordings: Sequence[Recording],
    rests: list[_Rest],
    looked_at: Bool[np.ndarray, " dwell"],
    dwells: Dwells,
    misfit: Float[np.ndarray, " dwell"],
    path: Float[np.ndarray, " dwell"],
) -> Contradiction | None:
    """Of the motions that tilt the device; the others tell of gravity's turn what any gyros do."""
    up = unit_vector(np.asarray(dwells.accel))
    tilt = angle_between(np.concatenate([up[:1], up[:-1]]), up)
    chosen = np.flatnonzero(looked_at & (tilt > _DIFFERENT_TILT))
    clock = lambda k, row: float(recordings[rests[k].recording].time[row])
    spans = [(clock(k, rests[k - 1].stop - 1), clock(k, rests[k].start)) for k in chosen]
    return contradiction(misfit[chosen], path[chosen], spans)


def _of_recording(rests: list[_Rest], number: int) -> Bool[np.ndarray, " dwell"]:
    return np.array([rest.recording == number for rest in rests], bool)


def _turns_of(rests: list[_Rest], led: Int[np.ndarray, " motion"], dwells: Dwells) -> list[Turn]:
    up, gyro = unit_vector(np.asarray(dwells.accel)), np.asarray(dwells.gyro)
    return [Turn(rests[k - 1].stop - 1, rests[k].start, up[k - 1], up[k], gyro[k]) for k in led]


def _gather(
    recordings: Sequence[Recording],
    times: Mapping[int, Float[np.ndarray, " time"]],
    rests: list[_Rest],
    pairs: Bool[np.ndarray, " dwell"],
    dwells: Dwells,
    walk: Float[np.ndarray, " dwell"],
    wander: float,
    force: Force | None,
) -> Motions:
    """All motions at one padded length; a rest without one stands still at its own mean."""
    before = np.maximum(np.arange(len(rests)) - 1, 0)
    before = np.where(pairs, before, np.arange(len(rests)))
    rows = [
        (rests[b].stop - 1, rests[k].start) if pairs[k] else (rests[k].start, rests[k].start)
        for k, b in enumerate(before)
    ]
    index = _padded_rows(rows, _array_length(max((b - a + 1 for a, b in rows), default=1)))
    pick = lambda column: np.stack(
        [getattr(recordings[rest.recording], column)[i] for rest, i in zip(rests, index)]
    )
    clock = lambda k: times[k] if k in times else recordings[k].time
    step = np.diff([clock(rest.recording)[i] for rest, i in zip(rests, index)], axis=1)
    duration = step.sum(axis=1)
    start, covariance = np.asarray(dwells.accel)[before], np.asarray(dwells.accel_covariance)
    if dwells.reference_gyro is not None:
        # The Earth turns the vertical against what the gyros keep: u ← u + T Ω × u, 3 mrad a minute.
        start = start + np.cross(
            duration[:, None] * np.asarray(dwells.reference_gyro)[before], start
        )
    return Motions(
        gyro=pick("gyro"),
        step=step,
        start_force=start,
        start_covariance=covariance[before],
        noise=0.5 * (walk + walk[before]) * duration + (max(wander, _LEAST_SIGMA) * duration) ** 2,
        valid=pairs,
        force=None if force is None else _forces(force, recordings, rests, index),
        wander=np.full(len(rests), max(wander, _LEAST_SIGMA)),
    )


def _forces(
    force: Force, recordings: Sequence[Recording], rests: list[_Rest], index: np.ndarray
) -> Float[np.ndarray, "dwell sample 3"]:
    """The specific force at the rows of each motion; one recording after the other."""
    found = np.empty((*index.shape, 3))
    owner = np.array([rest.recording for rest in rests], int)
    for k in np.unique(owner):
        found[owner == k] = force(recordings[k])[index[owner == k]]
    return found


def _array_length(samples: int) -> int:
    """The next of 64, 80, 96, 112, 128, 160, …: four lengths from each power of two to the next."""
    grain = max(2 ** ((samples - 1).bit_length() - 3), _SHORTEST_ARRAY // 4)
    return max(-(-samples // grain) * grain, _SHORTEST_ARRAY)


def _padded_rows(rows: list[tuple[int, int]], length: int) -> Int[np.ndarray, "dwell sample"]:
    """Each range's rows, both ends included, the last repeated up to `length`."""
    first, last = np.array(rows, dtype=np.int64).T
    return np.minimum(first[:, None] + np.arange(length), last[:, None])
