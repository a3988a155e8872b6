"""Where a table turns at a constant rate, by the reference rates of a recording."""

import math

import numpy as np
from jaxtyping import Bool, Float, Int

from ..data.recording import Recording
from ..physics.vectors import unit_vector
from ..physics.wgs84 import EARTH_RATE
from .rests import usual_step


SHORTEST = 0.5  # s; a smooth ramp's flat top is far shorter
FEWEST = 4  # samples
STANDS = 1.5  # Earth rates, up to which a table stands: Earth's rate and what its angles' digits make of standing
STOOD = 0.01  # Earth rates, by which a rest's reference may change from row to row
TURNING = 4.0  # Earth rates, from which a table turns; a rest whose label is -1 is no plateau
RELATIVE = 1e-3  # 1/s, change of the rate over itself that is still constant
BY_EARTH = 2.0  # Earth rates a second: the Earth's rate turns in the case at the table's rate
FAST = 20.0  # Earth rates, from which one sample's change in the Earth's direction is small
GROWING = 0.05  # of a slower rate: what it may change from sample to sample
NOISE = 4.0  # times the change that a quarter of the steps stay below: the noise of a measured reference
# The same of noise along the axis alone, as an encoder has it: 5 σ; a quarter of Gaussian changes is below 0.319 σ.
ALONG = 5.0 / 0.319
MOST_NOISE = (
    3.0,
    1e-4,
)  # Earth rates, and of the rate: a measured reference is not noisier than that

RAMP = 0.1  # s, from which what the gyros still change at an end of a plateau is a ramp, and no lag of theirs
BOWED = 2e-3  # of the rate: its middle half less its ends; as a table that holds a rate may miss it (convention)
RAMP_SHARE = 0.05  # of the rate: by how much they are off at that end
MIDDLE_SHARE = 0.1  # of the rate: what they may scatter in the middle
BEYOND = 1.5  # times the largest scatter in the middle
BY_HAND = 0.2  # of the rate, see `manual_turns`


def steady_steps(recording: Recording) -> Bool[np.ndarray, " step"]:
    """Steps from sample to sample over which the commanded rate stays.

    It may change by 0.1 % of itself a second, and as fast as the Earth rate turns in the case at that rate; where it
    was measured, by its noise, too. A slow rate may change by a twentieth of itself from sample to sample: else it
    would pass for constant while it still grows.
    """
    assert recording.reference_gyro is not None
    rate = recording.reference_gyro
    speed = np.linalg.norm(rate, axis=1)[1:]
    change = np.linalg.norm(np.diff(rate, axis=0), axis=1)
    step = np.maximum(np.diff(recording.time), usual_step(recording))
    allowed = (RELATIVE * speed + BY_EARTH * EARTH_RATE) * step
    turning = speed > TURNING * EARTH_RATE
    if turning.any():
        along = np.abs(np.sum(np.diff(rate, axis=0) * unit_vector(rate[1:]), axis=1))
        noise = NOISE * float(np.quantile(change[turning], 0.25))
        noise = max(noise, ALONG * float(np.quantile(along[turning], 0.25)))
        least = MOST_NOISE[0] * EARTH_RATE + MOST_NOISE[1] * speed
        allowed = np.maximum(allowed, np.minimum(noise, least))
    return (change <= allowed) & ((speed > FAST * EARTH_RATE) | (change <= GROWING * speed))


def plateaus(
    recording: Recording, start: Int[np.ndarray, " run"], stop: Int[np.ndarray, " run"]
) -> Bool[np.ndarray, " run"]:
    """Which runs of steady rows are plateaus: they turn, for half a second and four samples, at a rate that is neither
    growing nor bowed. In a smooth move it is: at first it grows by less than a twentieth from row to row."""
    rate = recording.reference_gyro
    assert rate is not None
    speed = np.linalg.norm(rate[(start + stop) // 2], axis=1)
    lasts = recording.time[stop - 1] - recording.time[start] >= SHORTEST
    found = (speed > TURNING * EARTH_RATE) & lasts & (stop - start >= FEWEST)
    for k in np.flatnonzero(found):
        quarter = (stop[k] - start[k]) // 4
        first, second, third, last = (
            rate[start[k] : stop[k]][: 4 * quarter].reshape(4, quarter, 3).mean(axis=1)
        )
        grown = np.linalg.norm(last - first) - RAMP_SHARE * speed[k]
        bowed = 0.5 * np.linalg.norm(second + third - first - last) - BOWED * speed[k]
        found[k] = max(grown, bowed) <= BY_EARTH * EARTH_RATE  # which turns in the case
    return found


def without_ramps(
    rate: Float[np.ndarray, "time 3"],
    position: Int[np.ndarray, " time"],
    start: Int[np.ndarray, " run"],
    stop: Int[np.ndarray, " run"],
) -> tuple[Int[np.ndarray, " run"], Int[np.ndarray, " run"]]:
    """Plateaus without their first and last sample where a ramp leads to them or away.

    The output of that sample may still lag on the ramp. A turn by hand begins and ends at rest: its reference is the
    mean rate over all of its samples.
    """
    turning = (position < 0) & (np.linalg.norm(rate, axis=1) > TURNING * EARTH_RATE)
    beside = np.concatenate([[False], turning, [False]])
    return start + beside[start], stop - beside[stop + 1]


def without_unsaid_ramps(
    recording: Recording, start: Int[np.ndarray, " plateau"], stop: Int[np.ndarray, " plateau"]
) -> tuple[Int[np.ndarray, " plateau"], Int[np.ndarray, " plateau"]]:
    """Plateaus without the ends at which the gyros still change, for a reference may be the rate that the table was
    told, and hold it while the table speeds up.

    Beyond doubt is an end of 0.1 s and more that begins 5 % off the middle, further than the middle's quarter
    scatters. A turn by hand stays whole: its reference is the mean rate over all of it.
    """
    if recording.gyro is None:
        return start, stop
    assert recording.reference_gyro is not None
    first, last = start.copy(), stop.copy()
    least = RAMP / usual_step(recording)
    for k, (a, b) in enumerate(zip(start.tolist(), stop.tolist(), strict=True)):
        gyro, rows = recording.gyro[a:b], b - a
        reference = recording.reference_gyro[(a + b) // 2]
        size = float(np.linalg.norm(reference))
        middle = slice(3 * rows // 8, rows - 3 * rows // 8)
        level = np.median(gyro[middle], axis=0)
        off = np.linalg.norm(gyro - level, axis=1)
        allowed = BEYOND * float(off[middle].max())
        if max(off[0], off[-1]) <= RAMP_SHARE * size or allowed > MIDDLE_SHARE * size:
            continue
        near = np.linalg.norm(gyro.mean(axis=0) - reference) < np.linalg.norm(level - reference)
        if (
            near
            and math.sqrt(float(np.square(gyro - gyro.mean(axis=0)).sum(axis=1).mean()))
            > BY_HAND * size
        ):
            continue
        ramps = int(np.argmax(off <= allowed)), int(np.argmax(off[::-1] <= allowed))
        up, down = (
            n if n >= least and end > RAMP_SHARE * size else 0
            for n, end in zip(ramps, (off[0], off[-1]), strict=True)
        )
        first[k], last[k] = a + up, b - down
    return first, last


def turning_rows(
    rate: Float[np.ndarray, "time 3"], moves: Bool[np.ndarray, " time"]
) -> Bool[np.ndarray, " time"]:
    """Rows in which a table turns, with those before and after in which it hardly does: by its angles a row before and
    after, its rate begins early and ends late, and a thousandth of a move in a rest is a bias."""
    speed = np.linalg.norm(rate, axis=1)
    turning = speed > TURNING * EARTH_RATE
    begun = speed > STANDS * EARTH_RATE
    first = np.diff(begun, prepend=False) & begun
    start = np.flatnonzero(first)
    touches = (
        np.logical_or.reduceat(and_beside(turning | moves) & begun, start) if len(start) else start
    )
    begun[begun] = touches[np.cumsum(first)[begun] - 1]
    # A row beside them counts to the rest where its rate is that of the row behind it.
    changes = np.linalg.norm(np.diff(rate, axis=0), axis=1) > STOOD * EARTH_RATE
    late, early = np.append(False, begun[:-1]), np.append(begun[1:], False)
    return turning | begun | late & np.append(changes, False) | early & np.append(False, changes)


def and_beside(rows: Bool[np.ndarray, " time"]) -> Bool[np.ndarray, " time"]:
    """The rows, and the one before and after each."""
    return rows | np.append(False, rows[:-1]) | np.append(rows[1:], False)
