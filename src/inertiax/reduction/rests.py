"""Where a device rests, found in its own data: no labels, no thresholds to set.

A rest is where accelerometers and gyros move little, compared with the quietest stretches of the same
recording; how little is read off the data too.
"""

import weakref
from typing import TypeAlias

import numpy as np
from jaxtyping import Float, Int

from .._records import field, Module
from .._typing import Mask
from ..data.recording import Recording
from ..data.stored_recording import StoredRecording
from .always_moving import moving
from .held_rows import held_rows
from .turning_rests import turning, TURNS


PAUSE = 20  # usual steps; a longer pause in the stamps ends an interval
_BIAS_SPAN = 150.0  # s; three of these at a time give the gyros' bias at rest
_RESTING_RATE = 5e-3  # rad/s; see `_motion`
_TURNS = 0.05  # rad/s, 3°/s: a table's turn, and more than the bias of most gyros
_SLOW, _FEW, _APART = 0.4, 0.1, 4.0  # see `_not_turning` (conventions)
_LOUD = 4.0  # times the quietest level of a log: noise of a part at rest is not that much greater
_CONSTANT = 1e-2  # m/s², stands for the noise of rests that are constant (convention: a fine converter's step)
TURNED_SLOWLY = "it moves all along"
ALWAYS_MOVES = "the device moves all the time"
_TURNED = 0.17  # of gravity, a tilt of 10°: more than any rest creeps or a bias wanders
_WANDER_SPAN = 5.0  # s: longer than tremor, shorter than a warm-up
_WINDOWS = 6  # differences of neighbours, to speak of half of them (convention)
_CENTRE = 10_000  # samples, whose median is near enough to all to lose no digits in sums of squares
_SCAN = np.geomspace(2.0, 1000.0, 64)
STILL = 16.0  # times the quietest level: a factor of 4 in standard deviation is no motion to tell from noise

Spread: TypeAlias = Float[np.ndarray, " window"]  # one number a window


class QuietLevels(Module):
    """What a recording's quietest windows read: the unit in which motion is told."""

    accel: float | None  # (m/s²)², variance within a window, summed over axes
    gyro: float | None  # (rad/s)²
    rate: Float[np.ndarray, "3"] | None  # rad/s, the gyros at rest, at the end of the recording

    def motion(self, accel: Spread | None, gyro: Spread | None, off: Spread | float) -> Spread:
        """Motion of windows, in multiples of the quietest: the greater one of both triads.

        **Arguments:** variances within each window, (m/s²)² and (rad/s)², and the square of the mean rate off the rate
        at rest, (rad/s)².
        """
        both = [] if accel is None or self.accel is None else [accel / self.accel]
        if gyro is not None and self.gyro is not None:
            both.append((gyro + off) / self.gyro)
        return np.max(both, axis=0)

    def motion_of(self, window: Recording) -> float:
        """Motion of one window of rows, as `find_rests` judges it."""
        spread = lambda x: None if x is None else x.var(axis=0).sum(keepdims=True)
        off = 0.0
        if window.gyro is not None and self.rate is not None:
            off = float(np.square(window.gyro.mean(axis=0) - self.rate).sum())
        return float(self.motion(spread(window.accel), spread(window.gyro), off)[0])


class Rests(Module):
    """Ranges `[start, stop)` of rows at rest, and how they were found."""

    start: Int[np.ndarray, " rest"]
    stop: Int[np.ndarray, " rest"]
    threshold: float | None = field(static=True, default=None)  # times the quietest level
    statement: str = field(static=True, default="")
    # The greatest threshold over the least that find as many: how well rest and motion are apart.
    apart: float = field(static=True, default=1.0)
    levels: QuietLevels | None = None  # `None` where no window was judged


_USUAL: dict[int, tuple[weakref.ref, float]] = {}


def usual_step(recording: Recording) -> float:
    """Median time from sample to sample, s; 0 for a single sample. Kept as long as the stamps are: every stage asks."""
    time = recording.time
    key = id(time)
    known = _USUAL.get(key)
    if known is None or known[0]() is not time:
        known = weakref.ref(time, lambda _: _USUAL.pop(key, None)), _median_step(time)
        _USUAL[key] = known
    return known[1]


def _median_step(time: Float[np.ndarray, " time"]) -> float:
    steps = np.diff(time)
    if not len(steps):
        return 0.0
    # As `np.median`, which takes five times as long for a short recording.
    middle = [(len(steps) - 1) // 2, len(steps) // 2]
    return float(0.5 * np.partition(steps, middle)[middle].sum())


def find_rests(recording: Recording, *, window: float, fewest: int = 16) -> Rests:
    """Rests found in the data, with the threshold that the data chose.

    Motion is judged over a sliding window against the quietest windows of the same recording
    (`_motion`), and a rest is where it stays below a multiple m of that. The data choose m: the
    number of rests, counted over m from 2 to 1000, stays the same over a wide range of m when rest
    and motion are well apart, since no window lies between them. m is taken from the widest such
    range (in log m), a quarter of the way up: clear of noise below, with little motion let in. A window has `fewest`
    samples or more.

    **Reference:** Tedaldi, Pretto, Menegatti, ICRA 2014, section IV (who try m over a range and
    keep the calibration with the least residual).
    """
    if recording.accel is None and recording.gyro is None:
        nothing = np.zeros(0, np.int64)
        return Rests(nothing, nothing, statement="no rest: neither accelerometers nor gyros")
    step = usual_step(recording)
    width = max(int(round(window / step)) if step > 0 else 1, fewest)
    if recording.num_samples < 2 * width:
        whole = np.array([0]), np.array([recording.num_samples])
        return Rests(*whole, statement="one rest: too short to search for motion")
    moves = moving(recording, step, width)
    if moves is not None and moves.rows.all():
        nothing = np.zeros(0, np.int64)
        return Rests(nothing, nothing, statement=f"no rest: {ALWAYS_MOVES}; even {moves.words}")
    motion, levels = _motion(recording, width, None if moves is None else moves.rows)
    pauses = np.append(np.diff(recording.time) > PAUSE * step, False)
    if isinstance(recording, StoredRecording) and motion.min() > _LOUD:
        nothing = np.zeros(0, np.int64)
        return Rests(nothing, nothing, statement="no rest: it moves all along", levels=levels)
    # A thousandth of the log, and in a long one no more than a turn between two rests takes.
    rarest = min(1e-3, 2.0 * width / len(motion))
    highest = float(np.quantile(motion[np.isfinite(motion)], 1.0 - rarest))
    if highest <= STILL:
        whole = np.array([[0, recording.num_samples]])
        if _turned_slowly(recording, width) or _rates_wander(recording, whole):
            nothing = np.zeros(0, np.int64)
            return Rests(nothing, nothing, statement=f"no rest: {TURNED_SLOWLY}", levels=levels)
        start, stop = _runs(np.isfinite(motion), pauses, width)
        return Rests(start, stop, statement="one rest: no motion found", levels=levels)
    scan = _SCAN[_SCAN <= max(highest, 4.0)]
    counts = [len(_runs(motion <= m, pauses, width)[0]) for m in scan]
    threshold, low, high = _stable(scan, np.array(counts))
    start, stop = _runs(motion <= threshold, pauses, width)
    trimmed = [_trim(recording, int(a), int(b), width) for a, b in zip(start, stop, strict=True)]
    edges = np.array(trimmed, dtype=np.int64).reshape(-1, 2)
    if _rates_wander(recording, edges):
        nothing = np.zeros(0, np.int64)
        return Rests(nothing, nothing, statement=f"no rest: {TURNED_SLOWLY}", levels=levels)
    turns = _turning(recording, edges, width)
    if turns.all() and len(turns):
        nothing = np.zeros(0, np.int64)
        return Rests(nothing, nothing, statement=f"no rest: {ALWAYS_MOVES}; {TURNS}", levels=levels)
    start, stop, edges = start[~turns], stop[~turns], edges[~turns]
    statement = (
        f"{len(start)} rest{'s' * (len(start) != 1)} found: motion below {threshold:.3g} times the quietest level over "
        f"{width * step:.3g} s; the same number for any threshold from {low:.4g} to {high:.4g}"
    )
    # Quiet windows follow one another, but over less than one; where a hand turns round they are fewer than half of it.
    brief = len(_runs(motion <= threshold, pauses, width // 2)[0]) - len(turns)
    if brief:
        statement += (
            f"; {brief} stretch{'es' * (brief > 1)} as quiet, shorter than these, "
            f"{'are' if brief > 1 else 'is'} too short to count: lay the device down for longer"
        )
    if turns.any():
        statement += f"; {turns.sum()} more left out: there {TURNS}"
    return Rests(edges[:, 0], edges[:, 1], threshold, statement, high / low, levels)


def _turning(recording: Recording, edges: Int[np.ndarray, "rest 2"], width: int) -> Mask:
    """Which rests turn about the vertical; none without both triads."""
    if recording.accel is None or recording.gyro is None:
        return np.zeros(len(edges), bool)
    return turning(recording.accel, recording.gyro, edges, usual_step(recording), width)


def _rates_wander(recording: Recording, edges: Int[np.ndarray, "rest 2"]) -> bool:
    """Whether the gyros' means over seconds differ within rests as a steady turn's do, and no bias.

    Half of the neighbours' differences must be four times (as standard deviations) what the samples' noise explains,
    and 5 mrad/s: a bias that follows the temperature changes by less in seconds, and one knock is no half of a log.
    """
    step = usual_step(recording)
    if recording.gyro is None or step <= 0.0 or isinstance(recording, StoredRecording):
        return False
    width = max(int(round(_WANDER_SPAN / step)), 16)
    changes, spreads = [], []
    for start, stop in edges:
        count = (stop - start) // width
        windows = recording.gyro[start : start + count * width].reshape(count, width, 3)
        changes += list(np.square(np.diff(windows.mean(axis=1), axis=0)).sum(axis=1) / 2.0)
        spreads += list(windows.var(axis=1).sum(axis=1) / width)
    if len(changes) < _WINDOWS:
        return False
    return bool(np.median(changes) > max(STILL * np.median(spreads), _RESTING_RATE**2))


def _only_drifts(recording: Recording, width: int) -> bool:
    """Whether the device lies in one pose and the gyros' means over seconds go on from one another as a bias does.

    In the first minute of a warm-up a bias moves farther than `_rate_at_rest` follows, by 20 mrad/s and more, but in
    seconds by less than 5 mrad/s, which no turn does that begins or ends.
    """
    step = usual_step(recording)
    if recording.accel is None or recording.gyro is None or step <= 0.0:
        return False
    if _turned_slowly(recording, width):
        return False
    rows = max(int(round(_WANDER_SPAN / step)), 16)
    count = recording.num_samples // rows
    means = recording.gyro[: count * rows].reshape(count, rows, 3).mean(axis=1)
    change = np.linalg.norm(np.diff(means, axis=0), axis=1)
    return bool(count > _WINDOWS and change.max() < _RESTING_RATE)


def _turned_slowly(recording: Recording, width: int) -> bool:
    """Whether the means of windows say that gravity's direction moves by more than a rest's could."""
    if recording.accel is None or isinstance(recording, StoredRecording):
        return False
    count = recording.num_samples // width
    windows = recording.accel[: count * width].reshape(count, width, 3)
    means, noise = windows.mean(axis=1), windows.std(axis=1).mean() / np.sqrt(width)
    moved = np.linalg.norm(means - np.median(means, axis=0), axis=1).max()
    return bool(moved > _TURNED * np.median(np.linalg.norm(means, axis=1)) and moved > 10.0 * noise)


def _motion(
    recording: Recording, width: int, moves: Mask | None
) -> tuple[Float[np.ndarray, " time"], QuietLevels]:
    """How much moves around each sample, in multiples of the quietest windows; 1 at best.

    For the accelerometers the variance within the window, summed over axes. For the gyros the
    mean square of the rate about its value at rest, so that a slow steady turn counts too; its
    quietest level is at least (5 mrad/s)² (0.3 deg/s), since a bias that depends on the pose (g-
    sensitivity) is no motion; nor is one that drifts over minutes (`_rate_at_rest`). The greater
    of the two decides. Rows that a logger held (`held_rows`) are at no rest and set no level, which those that `moves`
    marks do not, either.
    """
    accel = gyro = at_rest = level = least_gyro = None
    off: Float[np.ndarray, " time"] | float = 0.0
    parted = isinstance(recording, StoredRecording)
    least = recording.quietest if parted else (np.inf, np.inf)
    held = held_rows(recording, width)
    left = held if moves is None else held | moves
    live = slice(None) if not left.any() or left.all() else ~left
    if recording.accel is not None:
        _, accel = _window_moments(recording.accel, width)
        level = _level(accel[live], least[0])
        # Noise below a converter's step leaves rests without any scatter, and only motion varies.
        if np.quantile(accel, 0.3) <= 1e-12 * accel.max():
            level = min(level, _CONSTANT**2)
    if recording.gyro is not None:
        mean, gyro = _window_moments(recording.gyro, width)
        judge = gyro if accel is None else accel / level
        quiet = judge <= max(np.quantile(judge, 0.3), 4.0 * _quietest(judge[live]))
        quiet &= ~(held if left.all() else left)
        at_rest = _rate_at_rest(recording.time, mean, quiet)
        off = ((mean - at_rest) ** 2).sum(axis=1)
        least_gyro = max(_level(gyro[live], least[1]), _RESTING_RATE**2)
    levels = QuietLevels(level, least_gyro, None if at_rest is None else np.array(at_rest[-1]))
    motion = levels.motion(accel, gyro, off)
    if not parted and np.any(motion > STILL) and _only_drifts(recording, width):
        still = levels.motion(accel, gyro, 0.0)
        motion = still if np.quantile(still, 1.0 - 1e-3) <= STILL else motion
    return np.where(held, np.inf, motion), levels


def _rate_at_rest(
    time: Float[np.ndarray, " time"], rate: Float[np.ndarray, "time 3"], quiet: Mask
) -> Float[np.ndarray, "time 3"]:
    """What the gyros read at rest: medians of the quiet samples over some minutes, so that a bias
    drifting with temperature is followed, but never more than 0.1 rad/s from the median of all."""
    quiet = _not_turning(rate, quiet)
    overall = np.median(rate[quiet], axis=0)
    edges = np.arange(time[0], time[-1] + _BIAS_SPAN, _BIAS_SPAN)
    if len(edges) < 3:
        return np.broadcast_to(overall, rate.shape)
    rows = np.flatnonzero(quiet)
    bounds = rows.searchsorted(np.searchsorted(time, edges))
    spans = [
        rows[bounds[max(k - 1, 0)] : bounds[min(k + 2, len(bounds) - 1)]]
        for k in range(len(edges) - 1)
    ]
    filled = [k for k, span in enumerate(spans) if len(span)]
    few = [spans[k][:: max(len(spans[k]) // _CENTRE, 1)] for k in filled]
    medians = np.array([np.median(rate[rows], axis=0) for rows in few])
    centres = 0.5 * (edges[:-1] + edges[1:])[filled]
    followed = np.stack([np.interp(time, centres, m) for m in medians.T], axis=1)
    return overall + np.clip(followed - overall, -0.1, 0.1)


def _not_turning(rate: Float[np.ndarray, "time 3"], quiet: Mask) -> Mask:
    """The quiet samples without those in which a table turns, as quietly as it stands, and maybe for longer.

    Rates of less than two fifths of the great ones, in a tenth of the quiet samples, are of the rests where hardly a
    rate lies between: a bias that drifts has all of them.
    """
    norm = np.linalg.norm(rate, axis=1)
    size = float(np.quantile(norm[quiet], 0.75))
    if size < _TURNS:
        return quiet
    slow = quiet & (norm < _SLOW * size)
    between = quiet & ~slow & (norm < (1.0 - _SLOW) * size)
    apart = slow.sum() > max(_FEW * quiet.sum(), _APART * between.sum())
    return slow if apart else quiet


def _window_moments(
    x: Float[np.ndarray, "time 3"], width: int
) -> tuple[Float[np.ndarray, "time 3"], Float[np.ndarray, " time"]]:
    """Mean and variance (summed over axes) in the window centred on each sample."""
    centre = np.median(x[:: max(len(x) // _CENTRE, 1)], axis=0)
    windows, first = len(x) - width + 1, width // 2
    inside = slice(first, first + windows)
    mean, spread = np.empty(x.shape, order="F"), np.zeros(len(x))
    sums = np.zeros(len(x) + 1)
    for axis in range(x.shape[1]):  # one after the other: each in contiguous memory
        apart = x[:, axis] - centre[axis]
        np.cumsum(apart, out=sums[1:])
        here = (sums[width:] - sums[:-width]) / width
        mean[inside, axis] = here + centre[axis]
        np.cumsum(np.square(apart, out=apart), out=sums[1:])
        spread[inside] += (sums[width:] - sums[:-width]) / width - np.square(here, out=here)
    np.maximum(spread, 0.0, out=spread)
    # Windows that would pass an end say what the last one inside says.
    for values in (mean, spread):
        values[:first] = values[first]
        values[inside.stop :] = values[inside.stop - 1]
    return mean, spread


def _quietest(spread: Float[np.ndarray, " time"]) -> float:
    """The level of the quietest twentieth of the windows; of those that vary at all, where a
    coarse converter gives windows without any change."""
    varying = spread[spread > 1e-12 * spread.max()] if spread.max() > 0 else np.ones(1)
    return float(np.quantile(varying, 0.05))


def _level(spread: Float[np.ndarray, " time"], least: float) -> float:
    """The quietest level, of the whole log where this part of it is far louder: it may hold no rest at all."""
    own = _quietest(spread)
    return own if own <= _LOUD * least else least


def _runs(
    still: Mask, pauses: Mask, shortest: int
) -> tuple[Int[np.ndarray, " run"], Int[np.ndarray, " run"]]:
    """Runs of still samples without a pause in the stamps, at least `shortest` samples long."""
    fresh = np.concatenate([[True], pauses[:-1] | (still[1:] != still[:-1])])
    start = np.flatnonzero(fresh)
    stop = np.append(start[1:], len(still))
    kept = still[start] & (stop - start >= shortest)
    return start[kept], stop[kept]


def _stable(
    scan: Float[np.ndarray, " scan"], counts: Int[np.ndarray, " scan"]
) -> tuple[float, float, float]:
    """A threshold inside the widest range of equal counts, and that range."""
    edges = np.concatenate([[0], np.flatnonzero(np.diff(counts)) + 1, [len(counts)]])
    ranges = [(a, b) for a, b in zip(edges[:-1], edges[1:], strict=True) if counts[a] > 0]
    if not ranges:
        return float(scan[0]), float(scan[0]), float(scan[0])
    a, b = max(ranges, key=lambda r: r[1] - r[0])
    low, high = float(scan[a]), float(scan[b - 1])
    return low * (high / low) ** 0.25, low, high


def _trim(recording: Recording, start: int, stop: int, width: int) -> tuple[int, int]:
    """Cut transients off both ends: short blocks whose mean is not the inner half's.

    At most two windows and a quarter of the rest on each side, so that a slow drift over a long
    rest is not taken for a transient.
    """
    block = max(width // 4, 4)
    num = (stop - start) // block
    if num < 8:
        return start, stop
    triads = [x for x in (recording.accel, recording.gyro) if x is not None]
    x = np.concatenate([t[start : start + num * block] for t in triads], axis=1)
    means = x.reshape(num, block, -1).mean(axis=1)
    inner = means[num // 4 : num - num // 4]
    centre = np.median(inner, axis=0)
    scale = 1.4826 * np.median(np.abs(inner - centre), axis=0)
    scale = np.maximum(scale, x.std(axis=0) / np.sqrt(block) * 0.5)
    strange = np.any(np.abs(means - centre) > 5.0 * np.maximum(scale, 1e-12), axis=1)
    most = min(num // 4, 2 * width // block)
    head = next((k for k in range(most) if not strange[k]), most)
    tail = next((k for k in range(most) if not strange[num - 1 - k]), most)
    return start + head * block, stop - tail * block
