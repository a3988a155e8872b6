"""Moves of a table from one rest to the next whose rates are known all along: rows for gyros of a table that turns
at constant rate about one axis or two, or not at all.

The error model is linear in what a triad feels at an instant, so that it holds between means over any rows, too:

    mean(ω') = (E + Θ) mean(ω_ref) + ν⁰ + D mean(a) / g

Over a move from rest to rest a common delay of the gyros, or the table, leaves the mean of the rates as it is. What is
left of it is the error of two positionings, 2 α² / T² about each axis (`rig_errors`).
"""

import dataclasses
from collections.abc import Iterator, Sequence

import numpy as np
from jaxtyping import Float

from ..data.recording import ModelChoice, Recording
from ..physics.wgs84 import EARTH_RATE
from .plateaus import FEWEST, TURNING
from .rests import PAUSE, usual_step
from .segments import Segments


# Of the largest singular value of the plateaus' directions: below, no plateau turns about a third axis (convention).
SPANNED = 0.05
LONGEST = 60.0  # s; by then the bias of a consumer gyro has wandered
SMALLEST = np.deg2rad(5.0)  # rad, of the turn: less tells nothing that a rest does not
# Of the path: by how much the gyros' turn may differ from the reference's. Errors of scale are below a twentieth; a
# station that writes no rate, or another axis', while it moves is off by all of it (convention).
DIFFERS = 0.2
# rad from row to row: rows and reference may be half a row apart, over which the Earth's rate and another axis' turn in
# the case, by some 1e-4 rad in a move of two rows (convention).
COARSE = np.deg2rad(10.0)


def with_known_moves(
    recordings: Sequence[Recording], segments: Sequence[Segments]
) -> tuple[Segments, ...]:
    """The segments of one device's recordings, with the moves between rests where plateaus of constant rate do not turn
    about three axes, or where there are none.

    Where they do the segments are as they were; so they are for a recording without gyros or their reference.
    """
    if _span(recordings, segments):
        return tuple(segments)
    return tuple(_with_moves(r, s) for r, s in zip(recordings, segments, strict=True))


def take_moves(model: ModelChoice) -> bool:
    """Whether `[model]` leaves gyros to their reference: no other estimator has a use for moves."""
    return model.gyro_estimator in (None, "reference")


def move_words(recordings: Sequence[Recording], segments: Sequence[Segments]) -> tuple[str, ...]:
    """That moves are used, and why; nothing where none are."""
    count = sum(int(s.known_moves.sum()) for s in segments)
    if not count:
        return ()
    rates = _plateau_rates(recordings, segments)
    why = "no plateau of constant rate was found"
    if axes := num_axes(rates):
        found = "1 plateau" if len(rates) == 1 else f"{len(rates)} plateaus"
        about = "one axis, which leaves two" if axes == 1 else "two axes, which leaves one"
        why = f"the {found} of constant rate found {'turns' if len(rates) == 1 else 'turn'} about {about} unseen"
    return (f"gyros: {count} moves between rests are used by their mean rates, for {why}",)


def num_axes(rates: Float[np.ndarray, "plateau 3"]) -> int:
    """Dimensions of the space that rates turn about, each by its direction; 0 where there are none.

    ```python
    import numpy as np
    from inertiax.reduction.known_moves import num_axes

    print(num_axes(np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -0.5]])))    # 1
    ```
    """
    sizes = np.linalg.norm(rates, axis=1, keepdims=True)
    axes = (rates / np.maximum(sizes, 1e-300))[sizes[:, 0] > 0.0]
    if not len(axes):
        return 0
    spread = np.linalg.svd(axes, compute_uv=False)
    return int(np.sum(spread > SPANNED * spread[0]))


def _span(recordings: Sequence[Recording], segments: Sequence[Segments]) -> bool:
    """Whether the plateaus of all recordings turn about three axes."""
    return num_axes(_plateau_rates(recordings, segments)) == 3


def _plateau_rates(
    recordings: Sequence[Recording], segments: Sequence[Segments]
) -> Float[np.ndarray, "plateau 3"]:
    """What the references of all recordings read on their plateaus, moves aside, rad/s."""
    rates = []
    for recording, part in zip(recordings, segments, strict=True):
        known = recording.reference_gyro
        if known is None:
            continue
        turns = ~part.resting & ~part.known_moves
        rates += [
            known[a:b].mean(axis=0)
            for a, b in zip(part.start[turns], part.stop[turns], strict=True)
        ]
    return np.array(rates).reshape(-1, 3)


def _with_moves(recording: Recording, found: Segments) -> Segments:
    ranges = np.array(list(_moves(recording, found)), int).reshape(-1, 2)
    if not len(ranges):
        return found
    start, stop = np.append(found.start, ranges[:, 0]), np.append(found.stop, ranges[:, 1])
    added = np.arange(len(start)) >= found.num_segments
    order = np.argsort(start, kind="stable")
    used = found.used.copy()
    for a, b in ranges:
        used[a:b] = True
    return dataclasses.replace(
        found,
        start=start[order],
        stop=stop[order],
        position=np.append(found.position, np.full(len(ranges), -1))[order],
        used=used,
        held=None
        if found.held is None
        else np.append(found.held, np.zeros(len(ranges), bool))[order],
        moves=added[order],
    )


def _moves(recording: Recording, found: Segments) -> Iterator[tuple[int, int]]:
    """Rows of the moves that are known: all between two rests of one recording."""
    gyro, known = recording.gyro, recording.reference_gyro
    if gyro is None or known is None:
        return
    rests = np.flatnonzero(found.resting & (found.stop > found.start))
    for before, after in zip(rests[:-1], rests[1:], strict=True):
        a, b = int(found.stop[before]), int(found.start[after])
        if after != before + 1 or b - a < FEWEST or not _of_one_run(recording, a - 1, b + 1):
            continue
        ends = [gyro[found.start[k] : found.stop[k]].mean(axis=0) for k in (before, after)]
        level = 0.5 * (ends[0] + ends[1])
        if _follows(gyro[a:b] - level, known[a:b], recording.time[a:b]):
            yield a, b


def _of_one_run(recording: Recording, first: int, last: int) -> bool:
    """Whether rows follow one another without a pause, within a minute and one experiment."""
    time = recording.time[first:last]
    if time[-1] - time[0] > LONGEST or np.diff(time).max() > PAUSE * usual_step(recording):
        return False
    label = recording.experiment
    return label is None or label[first] == label[last - 1]


def _follows(
    rate: Float[np.ndarray, "row 3"],
    known: Float[np.ndarray, "row 3"],
    time: Float[np.ndarray, " row"],
) -> bool:
    """Whether a reference turns in small steps, and the gyros as it says."""
    speed = np.linalg.norm(known, axis=1)
    if not np.all(np.isfinite(known)) or speed.max() <= TURNING * EARTH_RATE:
        return False
    step = np.gradient(time)
    if (speed * step).max() > COARSE:
        return False
    path = float(speed @ step)
    missed = float(np.linalg.norm(step @ (rate - known)))
    return path > SMALLEST and missed < DIFFERS * path
