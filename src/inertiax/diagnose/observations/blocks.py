"""Recordings reduced to blocks: short means over rests and constant-rate plateaus.

A block is short against everything that a diagnosis looks for (a few seconds), and several blocks
make a dwell, so that what happens within a positioning stays visible. The scatter inside blocks
tells the white noise.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped

from ..._jax import eqx, jax
from ...data.recording import Campaign, Recording
from ...data.recording_order import in_order
from ...physics.wgs84 import EARTH_RATE as EARTH_RATE
from ...reduction.block_length import length_beyond_tremor
from ...reduction.chord import shortening_within
from ...reduction.device_segments import of_one_device
from ...reduction.dwells import is_told
from ...reduction.held_rests import variance_by_parts
from ...reduction.known_moves import take_moves
from ...reduction.mean_noise import converter_steps
from ...reduction.positionings import attitudes
from ...reduction.segments import joined, rests_are_searched, segment_each, Segments
from .without_earth import earth_taken_away


MOST_BLOCKS = 1600
PER_DWELL = 6  # blocks wanted in a dwell
FEWEST_SAMPLES = 4  # in a block
PAUSE = 30.0  # s between recordings, from which on the power may have been off (convention)
# Changes of a channel from row to row from which they tell its step: more than such logs have rests (convention).
FEWEST_CHANGES = 200
# Times the usual variance of a dwell, on every axis, from which it is shaken: an amplitude of ten. Steps of a converter
# make variances of quiet dwells differ by less, and not on all axes at once. Convention.
SHAKEN = 100.0


class Log(eqx.Module):
    """All recordings of one device in one row order, with a common clock."""

    time: Float[np.ndarray, " time"]  # s since the first sample, increasing across recordings
    clock: Float[np.ndarray, " time"]  # s, as recorded
    recording: Int[np.ndarray, " time"]
    experiment: Int[np.ndarray, " time"]
    position: Int[np.ndarray, " time"]
    temperature: Float[np.ndarray, " time"] | None
    accel: Float[np.ndarray, "time 3"] | None
    gyro: Float[np.ndarray, "time 3"] | None
    reference_accel: Float[np.ndarray, "time 3"] | None
    reference_gyro: Float[np.ndarray, "time 3"] | None
    segments: Segments  # in rows of the log
    # rad/s, of the gyros at rest: not in the blocks' means
    earth: Float[np.ndarray, "time 3"] | None = None
    latitude: float | None = None  # rad
    supply: Float[np.ndarray, " time"] | None = None  # V
    searched: bool = False  # whether rests were found in the data, so that nobody vouches for them
    names: tuple[str, ...] = eqx.field(static=True, default=())  # of the recordings, in order

    @property
    def cycle(self) -> Int[np.ndarray, " time"]:
        """Number of the power cycle: a new recording after a pause of 30 s or more."""
        late = np.r_[False, (np.diff(self.recording) != 0) & (np.diff(self.time) > PAUSE)]
        return np.cumsum(late)

    @property
    def step(self) -> float:
        """Typical sampling interval, s."""
        return float(np.median(np.diff(self.time)))


class Blocks(eqx.Module):
    """Means over blocks; rows are in time order."""

    start: Int[np.ndarray, " block"]  # first row of the log
    stop: Int[np.ndarray, " block"]  # one past the last
    dwell: Int[np.ndarray, " block"]
    moving: Bool[np.ndarray, " block"]  # on a constant-rate plateau
    held: Bool[np.ndarray, " block"]  # a rest held by hand, one block each
    move: Bool[np.ndarray, " block"]  # from rest to rest at known rates, one block each
    time: Float[np.ndarray, " block"]  # s, middle
    experiment: Int[np.ndarray, " block"]
    position: Int[np.ndarray, " block"]
    attitude: Int[np.ndarray, " block"]  # the dwell in which the device came to stand as it does
    cycle: Int[np.ndarray, " block"]
    temperature: Float[np.ndarray, " block"] | None
    accel: Float[np.ndarray, "block 3"] | None
    gyro: Float[np.ndarray, "block 3"] | None
    reference_accel: Float[np.ndarray, "block 3"] | None
    reference_gyro: Float[np.ndarray, "block 3"] | None
    # Variance of the mean by scatter inside blocks
    accel_white: Float[np.ndarray, "block 3"] | None
    gyro_white: Float[np.ndarray, "block 3"] | None

    @property
    def num_blocks(self) -> int:
        """Number of blocks."""
        return len(self.start)

    @property
    def count(self) -> Int[np.ndarray, " block"]:
        """Samples in each block."""
        return self.stop - self.start

    def mean(self, values: Shaped[np.ndarray, "time ..."]) -> Float[np.ndarray, "block ..."]:
        """Means over the blocks of anything sampled as the log is."""
        return block_mean(np.asarray(values, float), self.start, self.stop)

    def felt(
        self, addition: Float[np.ndarray, "time channels column"]
    ) -> Float[np.ndarray, "block ..."]:
        """What an addition to the outputs does at the blocks, channel by channel: here its means."""
        return self.mean(addition)

    def __getitem__(self, rows: np.ndarray) -> "Blocks":
        """The same columns, only those blocks."""
        return jax.tree.map(lambda column: column[rows], self)


def block_mean(values: np.ndarray, start: np.ndarray, stop: np.ndarray) -> np.ndarray:
    """Means of `values[start:stop]` along the first axis; where all of a block are zero, so is its mean."""
    edges = np.stack([start, stop], axis=1).ravel()
    # Sums between successive edges: every other one is of a block. The end of the rows is no edge to begin at.
    if len(edges) and edges[-1] == len(values):
        edges = edges[:-1]
    # The rows along the last axis, as they lie in memory where speed matters (`signals.by_axis`).
    sums = np.add.reduceat(np.moveaxis(values, 0, -1), edges, axis=-1)[..., ::2]
    return np.ascontiguousarray(np.moveaxis(sums / (stop - start), -1, 0))


def join(
    campaign: Campaign, *, handling: bool = True, found: Sequence[Segments] | None = None
) -> Log:
    """Put the recordings of a one-device campaign behind each other.

    With `handling`, rows in which a rest was disturbed have no part in blocks, and what is cut off its ends is no rest;
    rests held by hand stay, marked. `found` are the segments of each recording (`segment_each(..., held=True)`), where
    they are known already.
    A recording whose clock starts again is set 60 s after the one before. Raises `ValueError`
    where recordings of several devices come together, or where only some carry a column.
    """
    if len(campaign.devices) != 1:
        raise ValueError(
            f"`diagnose(campaign)`: one device at a time; found {list(campaign.devices)}, so take "
            "`campaign.of_device(...)`."
        )
    recordings = in_order(campaign.recordings)
    times, end = [], None
    for recording in recordings:
        shift = 0.0 if end is None or recording.time[0] > end else end + 60.0 - recording.time[0]
        times.append(recording.time + shift)
        end = times[-1][-1]
    time = np.concatenate(times)
    experiment = [
        np.full(r.num_samples, k) if r.experiment is None else r.experiment
        for k, r in enumerate(recordings)
    ]
    probe = _column(recordings, "temperature")
    if found is None:
        found = segment_each(campaign.recordings, handling=handling, held=True)
    of_recording = {id(r): s for r, s in zip(campaign.recordings, found, strict=True)}
    segments = of_one_device(
        recordings, [of_recording[id(r)] for r in recordings], moves=take_moves(campaign.model)
    )
    for recording, part in zip(recordings, segments):
        if part.turning is not None:
            raise ValueError(
                f"{recording.name}: it never lies still for long, and what turns it looks like physics of the sensor; "
                "a diagnosis needs rests of seconds in each orientation (`inertiax calibrate` does without)."
            )
    return Log(
        time=time - time[0],
        clock=np.concatenate([r.time for r in recordings]),
        recording=np.repeat(np.arange(len(recordings)), [r.num_samples for r in recordings]),
        experiment=np.concatenate(experiment),
        position=np.concatenate([_positions(r, s) for r, s in zip(recordings, segments)]),
        temperature=None if probe is None else probe[:, 0],
        **{
            k: _column(recordings, k)
            for k in ("accel", "gyro", "reference_accel", "reference_gyro")
        },
        segments=joined(segments),
        earth=earth_taken_away(recordings, segments, campaign.site),
        latitude=campaign.site.latitude,
        # Optional even where some files have it: what only some tell is not tested.
        supply=None if any(r.supply is None for r in recordings) else _column(recordings, "supply"),
        searched=any(rests_are_searched(r) for r in recordings),
        names=tuple(r.name or str(k) for k, r in enumerate(recordings)),
    )


def _column(recordings: list[Recording], label: str) -> np.ndarray | None:
    values = [getattr(r, label) for r in recordings]
    if all(v is None for v in values):
        return None
    if any(v is None for v in values):
        lacking = [r.name or str(k) for k, r in enumerate(recordings) if getattr(r, label) is None]
        raise ValueError(
            f"`diagnose(campaign)`: '{label}' is in some recordings but not in {lacking}; "
            "diagnose recordings with the same columns together."
        )
    return np.concatenate([v if label != "temperature" else v[:, :1] for v in values])


def _positions(recording: Recording, segments: Segments) -> np.ndarray:
    """Positions as recorded, or those of the rests that were found; -1 where a labelled rest is not at rest."""
    found = np.full(recording.num_samples, -1)
    for start, stop, number in zip(segments.start, segments.stop, segments.position):
        found[start:stop] = number
    if recording.position is None:
        return found
    return np.where(recording.position >= 0, found, recording.position)


def cut(log: Log) -> Blocks:
    """Cut a log's segments into blocks: rests and constant-rate plateaus, without the rows that do not count.

    Raises `ValueError` where the log has no segment of `FEWEST_SAMPLES`.
    """
    first, last, owner = log.segments.runs()
    runs = [(int(a), int(b), int(k)) for a, b, k in zip(first, last, owner)]
    if not any(b - a >= FEWEST_SAMPLES for a, b, _ in runs):
        raise ValueError(
            f"a diagnosis needs a rest of {FEWEST_SAMPLES} samples (position >= 0) or a plateau of constant rate, and "
            "found none; plateaus are found by `reference_gyro`, or by `diagnose_model(inputs=...)`."
        )
    total = sum(b - a for a, b, _ in runs)
    coarsest = max(FEWEST_SAMPLES, -(-total // MOST_BLOCKS))
    held = log.segments.held_by_hand
    shortest = _beyond_tremor(log, runs, coarsest) if log.searched else coarsest
    start, stop, dwell = [], [], []
    for a, b, number in runs:
        pieces = max(
            1,
            min(
                (b - a) // coarsest,
                max(PER_DWELL, (b - a) // (4 * coarsest) + 1, round((b - a) * MOST_BLOCKS / total)),
            ),
        )
        if shortest > coarsest:
            pieces = min(pieces, max(PER_DWELL, (b - a) // shortest))
        if held[number] or log.segments.known_moves[number]:
            pieces = 1
        cuts = np.linspace(a, b, pieces + 1).round().astype(int)
        start.extend(cuts[:-1])
        stop.extend(cuts[1:])
        dwell.extend([number] * pieces)
    return _summarise(log, np.array(start), np.array(stop), np.array(dwell))


def _beyond_tremor(log: Log, runs: Sequence[tuple[int, int, int]], shortest: int) -> int:
    """Samples of a block that a hand's tremor does not reach, where rests were found in the data.

    Of the force it is |a| that tells: a hand also tilts the device slowly, which its axes see and |a| does not.
    """
    position, held = log.segments.position, log.segments.held_by_hand
    rests = [(a, b) for a, b, k in runs if position[k] >= 0 and not held[k]]
    channels = [] if log.gyro is None else [log.gyro]
    if log.accel is not None:
        channels.append(np.linalg.norm(log.accel, axis=1, keepdims=True))
    if not rests or not channels:
        return shortest
    first, stop = np.array(rests).T
    return length_beyond_tremor(np.concatenate(channels, axis=1), first, stop, shortest)


def _summarise(log: Log, start: np.ndarray, stop: np.ndarray, dwell: np.ndarray) -> Blocks:
    def mean(values):
        return None if values is None else block_mean(values, start, stop)

    position = log.segments.position[dwell]
    moving, held = position < 0, log.segments.held_by_hand[dwell]
    move = log.segments.known_moves[dwell]
    stated = mean(log.reference_accel)
    if stated is not None and log.reference_accel is not None:
        lacking = np.asarray(~is_told(log.reference_accel), float)
        # What a point beside the axes feels in a move, its mean rate does not tell.
        stated[(block_mean(lacking, start, stop) > 0.0) | move] = 0.0
    time, gyro = block_mean(log.time, start, stop), mean(log.gyro)
    if gyro is not None and log.earth is not None:
        gyro = gyro - block_mean(log.earth, start, stop)
    rate = mean(log.reference_gyro)
    attitude = dwell
    if stated is not None and rate is not None:
        attitude = attitudes(position, rate, stated, log.recording[start], dwell)
    accel = mean(log.accel)
    if accel is not None and log.accel is not None and log.reference_accel is None:
        longer = 1.0 + np.where(moving, 0.0, shortening_within(log.accel, start, stop))
        accel = accel * longer[:, None]
    return Blocks(
        start=start,
        stop=stop,
        dwell=dwell,
        moving=moving,
        held=held,
        move=move,
        time=time,
        experiment=log.experiment[start],
        position=position,
        attitude=attitude,
        cycle=log.cycle[start],
        temperature=mean(log.temperature),
        accel=accel,
        gyro=gyro,
        reference_accel=stated,
        reference_gyro=rate,
        accel_white=_white(log.accel, log.reference_accel, start, stop, dwell, moving, held, move),
        gyro_white=_white(log.gyro, log.reference_gyro, start, stop, dwell, moving, held, move),
    )


def with_scatter_about(
    blocks: Blocks, log: Log, triad: str, expected: Float[np.ndarray, "time 3"]
) -> Blocks:
    """The blocks with one triad's white variance by the scatter about what it is expected to read.

    While a device turns, an error of its matrix makes output less reference follow the turn: that is no noise.
    """
    white = _white(
        getattr(log, triad),
        expected,
        blocks.start,
        blocks.stop,
        blocks.dwell,
        blocks.moving,
        blocks.held,
        blocks.move,
    )
    return eqx.tree_at(lambda b: getattr(b, f"{triad}_white"), blocks, white)


def _white(
    values: np.ndarray | None,
    reference: np.ndarray | None,
    start: np.ndarray,
    stop: np.ndarray,
    dwell: np.ndarray,
    moving: np.ndarray,
    held: np.ndarray,
    move: np.ndarray,
) -> np.ndarray | None:
    """Variance of each block's mean: scatter about the block's mean, pooled over rests and over plateaus.

    Of a rest held by hand, that of the means of its parts; of a move the rests' scatter, for what a triad lags behind
    the rates is none of the mean's.
    """
    if values is None:
        return None
    steps = _steps(values)
    values = values if reference is None else values - reference
    count = stop - start
    mean = block_mean(values, start, stop)
    square = block_mean((values - values.mean(axis=0)) ** 2, start, stop)
    scatter = (
        np.maximum(square - (mean - values.mean(axis=0)) ** 2, 0.0)
        * (count / np.maximum(count - 1, 1))[:, None]
    )
    pooled = np.empty_like(scatter)
    # Without its reference a force that turns in the case would pass for noise of the other plateaus.
    told = np.ones(len(count), bool)
    if reference is not None:
        told = block_mean(np.asarray(is_told(reference), float), start, stop) > 0.0
    kind = moving + 2 * (moving & ~told) + 4 * held + 8 * move
    for number in np.unique(kind):
        group = kind == number
        pooled[group] = _pooled(scatter[group], count[group] - 1, dwell[group])
    if move.any():
        pooled[move] = np.median(pooled[kind == 0], axis=0)
    # A rounded sample errs by that, though outputs that stand still at rest show none of it.
    pooled = np.maximum(pooled, np.square(steps) / 12.0)
    floor = 1e-30 + 1e-12 * pooled.max()
    white = np.maximum(pooled, floor) / count[:, None]
    by_hand = np.flatnonzero(held)
    of_parts = variance_by_parts(values, start[by_hand], stop[by_hand])
    white[by_hand] = np.maximum(white[by_hand], of_parts)
    return white


def _steps(values: np.ndarray) -> np.ndarray:
    """The converter's step of each axis; 0 where none shows, as in values that change from rest to rest alone."""
    changes = np.count_nonzero(np.diff(values, axis=0), axis=0)
    return np.where(changes >= FEWEST_CHANGES, converter_steps(values), 0.0)


def _pooled(
    scatter: Float[np.ndarray, "block 3"],
    freedom: Int[np.ndarray, " block"],
    dwell: Int[np.ndarray, " block"],
) -> Float[np.ndarray, "block 3"]:
    """The mean variance of all blocks; of those dwells that are shaken, on all axes, each dwell's own. With theirs in
    the mean, the quiet ones would weigh nothing either."""
    place = np.unique(dwell, return_inverse=True)[1]
    total = np.bincount(place, freedom)
    sums = np.stack([np.bincount(place, freedom * s) for s in scatter.T], axis=1)
    by_dwell = sums / np.maximum(total, 1.0)[:, None]
    usual = np.median(by_dwell, axis=0)
    shaken = np.all((by_dwell > SHAKEN * usual) & (usual > 0.0), axis=1)
    quiet = sums[~shaken].sum(axis=0) / max(float(total[~shaken].sum()), 1.0)
    return np.where(shaken[:, None], by_dwell, quiet)[place]
