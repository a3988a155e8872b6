"""Samples that no sensor gives: held, dropped to zero, clipped, wrapped round."""

import numpy as np
from jaxtyping import Bool, Float, Int

from ..data.formats.columns import AXES
from ..reduction.clipping import holds_extreme, in_coarse_steps
from ..reduction.mean_noise import converter_steps
from .coarse_steps import coarse_steps
from .dead_channels import triads
from .evidence import DeviceLogs, Log
from .finding import Finding, finding
from .thresholds import Thresholds


UNITS = {"accel": "m/s²", "gyro": "rad/s"}
_FEWEST_ROWS = 100
_STEPS = 2.0  # a code to either side by noise, and one by the rounding of the two rows. Convention.
_NEAR = 0.2  # of gravity: the greatest error of a reading at rest, before any calibration
_MOST_STRETCHES = 1 << 21  # that are compared with each other, about
_FACTOR = 0x100000001B3  # of the polynomial in 64 bits that a stretch's number is


def check_dropouts(device: DeviceLogs, limits: Thresholds) -> list[Finding]:
    """Rows in which a whole triad is exactly zero although it varies."""
    found = []
    for log in device.logs:
        for name, values in triads(log):
            zero = np.all(values == 0.0, axis=1)
            if zero.all():
                continue
            if name == "gyro" and zero.any():
                zero &= ~_on_the_way(values, zero)
            count = int(zero.sum())
            if not count:
                continue
            if name == "gyro" and not _impossible(values, zero):
                continue
            resting = zero[log.at_rest]
            if name == "gyro" and len(resting) and resting.mean() > limits.held_at_rest:
                continue  # no sample was dropped: small rates are held at zero
            share = count / len(zero)
            if name == "accel" and share > 0.5:
                continue  # no force at all is a matter of the unit
            found.append(
                finding(
                    "dropout",
                    "error" if name == "accel" and share > 0.05 else "warning",
                    name,
                    f"{log.name}: {count} rows of {name} are exactly zero (first in row {int(np.argmax(zero))}, "
                    f"{log.moment(log.recording.time[int(np.argmax(zero))])}): dropped samples, not measurements. Take "
                    "them out.",
                    rows=count,
                    share=share,
                )
            )
    return found


def _on_the_way(
    values: Float[np.ndarray, "time 3"], zero: Bool[np.ndarray, " time"]
) -> Bool[np.ndarray, " time"]:
    """Rows of zeros that the rows around them lead to: a code like others, which coarse outputs pass in a motion.

    On every axis zero lies between the row before and the row behind, or within `_STEPS` of the converter of them.
    """
    edges = np.flatnonzero(np.diff(np.concatenate([[False], zero, [False]]).astype(np.int8)))
    start, stop = edges[::2], edges[1::2]
    last = len(values) - 1
    before = values[np.where(start > 0, start - 1, np.minimum(stop, last))]
    behind = values[np.where(stop <= last, stop, np.maximum(start - 1, 0))]
    near = _STEPS * converter_steps(values)
    low, high = np.minimum(before, behind) - near, np.maximum(before, behind) + near
    passed = np.all((low <= 0.0) & (high >= 0.0), axis=1)
    made = np.zeros(len(values), bool)
    made[zero] = np.repeat(passed, stop - start)
    return made


def _impossible(values: Float[np.ndarray, "time 3"], zero: Bool[np.ndarray, " time"]) -> bool:
    """Whether all three gyros at exactly zero cannot be chance: single channels are there far more rarely."""
    one = np.mean(values[~zero] == 0.0, axis=0)
    return bool(len(zero) * np.prod(np.maximum(one, 1e-4)) < 1e-3)


def check_saturation(device: DeviceLogs, limits: Thresholds) -> list[Finding]:
    """Channels that stay at their extreme value, and counts that wrap round."""
    del limits
    found = []
    for log in device.logs:
        for name, values in triads(log):
            for axis in range(3):
                found += _clipped(log, name, axis, values[:, axis])
                found += _wrapped(log, name, axis, values)
    return found


def _clipped(log: Log, name: str, axis: int, x: Float[np.ndarray, " time"]) -> list[Finding]:
    found = []
    for extreme in (float(x.max()), float(x.min())):
        if not holds_extreme(x, extreme):
            continue
        count = int((x == extreme).sum())
        rests = int(((x == extreme) & log.at_rest).sum())
        if name == "accel" and _stands_still(log, x, extreme):
            continue
        found.append(
            finding(
                "saturation",
                "warning",
                f"{name}_{AXES[axis]}",
                f"{log.name}: {name}_{AXES[axis]} looks saturated at {extreme:.6g} {UNITS[name]} ({count} samples at "
                f"exactly this extreme value, {rests} of them at rest).",
                value=extreme,
                rows=count,
                rows_at_rest=rests,
            )
        )
    return found


def _stands_still(log: Log, x: Float[np.ndarray, " time"], extreme: float) -> bool:
    """Whether rests that do not reach the extreme stand at single values, too: then it need not end the range."""
    reached = np.concatenate([[0], np.cumsum(x == extreme)])
    free = reached[log.stop] == reached[log.start]
    return in_coarse_steps(x, log.start[free], log.stop[free])


def _poses_differ(accel: Float[np.ndarray, "time 3"], jumps: Int[np.ndarray, " jump"]) -> bool:
    """Whether most jumps go from pose to pose: both samples read the norm that all do, as no wrapped one does."""
    norm = np.linalg.norm(accel, axis=1)
    usual = float(np.median(norm))
    both = np.stack([norm[jumps], norm[jumps + 1]])
    return bool(np.mean(np.all(np.abs(both - usual) < _NEAR * usual, axis=0)) > 0.5)


def _wrapped(log: Log, name: str, axis: int, values: Float[np.ndarray, "time 3"]) -> list[Finding]:
    """Steps over nearly the whole range from one sample to the next, end to end."""
    x = values[:, axis]
    low, high = float(x.min()), float(x.max())
    span = high - low
    if len(x) < _FEWEST_ROWS or span <= 0 or (name == "accel" and span < 10.0):
        return []
    jumps = np.flatnonzero(np.abs(np.diff(x)) > 0.9 * span)
    # A wrap goes from one end of the range to the other between neighbours that were on their way to that end:
    # without it (the span added) the step is as small as its neighbours.
    if len(jumps) < 3:
        return []
    unwrapped = np.abs(np.abs(np.diff(x)[jumps]) - span)
    if name == "accel" and _poses_differ(values, jumps):
        return []
    # A converter's range has its middle at zero, or begins there; a shock's two extremes are where they happen to be.
    lopsided = min(abs(low + high), abs(low), abs(high)) > 0.05 * span
    if np.median(unwrapped) > 0.05 * span or lopsided:
        return []
    return [
        finding(
            "saturation",
            "warning",
            f"{name}_{AXES[axis]}",
            f"{log.name}: {name}_{AXES[axis]} jumps {len(jumps)} times from one end of its range to the other "
            f"({low:.6g} to {high:.6g} {UNITS[name]}) from one sample to the next: counts wrap round. "
            "Where a logger wrote signed readings as unsigned, take the whole range from those in its upper half.",
            jumps=len(jumps),
            low=low,
            high=high,
        )
    ]


def check_repeated_samples(device: DeviceLogs, limits: Thresholds) -> list[Finding]:
    """Rows that repeat the row before, longer freezes, and stretches that occur twice."""
    found = []
    for log in device.logs:
        for name, values in triads(log):
            found += _held(log, name, values, limits)
    return found + _duplicates(device, limits)


def _held(
    log: Log, name: str, values: Float[np.ndarray, "time 3"], limits: Thresholds
) -> list[Finding]:
    if len(values) < _FEWEST_ROWS or np.any(np.ptp(values, axis=0) == 0):
        return []
    same = values[1:] == values[:-1]
    held = same.all(axis=1)
    # Coarse converters repeat channel by channel; a held row repeats them all together.
    share, chance = float(held.mean()), float(np.prod(same.mean(axis=0)))
    edges = np.flatnonzero(np.diff(np.concatenate([[False], held, [False]]).astype(np.int8)))
    runs = np.sort(edges[1::2] - edges[::2])
    longest = int(runs[-1]) if len(runs) else 0
    usual = float(np.mean(runs[:-1])) if len(runs) > 1 else 0.0
    frozen = longest * log.step > limits.frozen and longest > 20 * max(usual, 1.0) and longest > 20
    frozen = frozen and len(held) * max(share, 1e-6) ** longest < 1e-3
    if not frozen and not (share > limits.repeated and chance < 0.5 * share):
        return []
    coarse = coarse_steps(log, values, limits)
    if coarse is not None:
        return [_coarse(log, name, *coarse)]
    at = float(log.recording.time[edges[::2][np.argmax(edges[1::2] - edges[::2])]])
    text = (
        f"{log.name}: {name} stands still for {longest} rows from {log.moment(at)}: samples are held, not measured."
        if frozen
        else f"{log.name}: {share:.0%} of the rows of {name} repeat the row before in all three channels: samples "
        "are held, so that there are fewer than rows and their noise is not white."
    )
    return [
        finding(
            "repeated_samples",
            "warning",
            name,
            text,
            share=share,
            by_chance=chance,
            longest=longest,
        )
    ]


def _coarse(log: Log, name: str, step: float, share: float) -> Finding:
    """Rows that repeat because the converter's step hides the noise."""
    return finding(
        "repeated_samples",
        "warning",
        name,
        f"{log.name}: {share:.0%} of the rows of {name} at rest repeat the row before, because the converter's step, "
        f"{step:.3g} {UNITS[name]}, is coarser than the noise: a rest's mean errs by up to half a step however long it "
        "is, and rests tell no noise. Take a finer range, or more digits.",
        share=share,
        step=step,
    )


def _duplicates(device: DeviceLogs, limits: Thresholds) -> list[Finding]:
    """Stretches of rows that occur twice, in one recording or in two."""
    length = limits.duplicate
    every = max(sum(r.num_samples for r in device.recordings) // _MOST_STRETCHES, 1)
    keys, owner, row = [], [], []
    for number, log in enumerate(device.logs):
        outputs = [v for _, v in triads(log)]
        if not outputs or len(outputs[0]) < 2 * length:
            continue
        hashes = _stretch_hashes(outputs, length)
        # Of a long log a part of the stretches, the same wherever they stand.
        row.append(np.flatnonzero(hashes % np.uint64(every) == 0))
        keys.append(hashes[row[-1]])
        owner.append(np.full(len(keys[-1]), number))
    if not keys:
        return []
    hashes, owners = np.concatenate(keys), np.concatenate(owner)
    first, index, counts = np.unique(hashes, return_index=True, return_counts=True)
    twice = counts > 1
    twice &= first != 0  # stretches that hardly vary are nobody's
    rows = every * int(np.sum(counts[twice] - 1))
    if rows < length:
        return []
    where = np.isin(hashes, first[twice])
    names = [device.logs[k].name for k in dict.fromkeys(owners[where].tolist())]
    share = rows / (every * len(hashes))
    row = np.concatenate(row)
    one = int(np.argmax(where))  # of the earliest stretch that occurs again
    again = one + 1 + int(np.argmax(hashes[one + 1 :] == hashes[one]))
    began = [device.logs[owners[k]].recording.time[row[k]] for k in (one, again)]
    said = [
        device.logs[owners[k]].moment(float(t)) for k, t in zip((one, again), began, strict=True)
    ]
    return [
        finding(
            "repeated_samples",
            "warning",
            "all",
            f"{' and '.join(names[:3])}: {rows + length - 1} rows occur twice, sample for sample (from "
            f"{said[0]} and again from {said[1]}): a block was copied or read twice, and counts double. Take the "
            "second out.",
            rows=rows + length - 1,
            share=share,
        )
    ]


def _stretch_hashes(outputs: list[Float[np.ndarray, "time 3"]], length: int) -> np.ndarray:
    """A number for the `length` rows from each row on; 0 where they take fewer than 8 different rows."""
    one = _row_hashes([values[:, axis] for values in outputs for axis in range(3)])
    with np.errstate(over="ignore"):
        # The sum of one[i + k] f^(k+1) over k < length, from running sums: f is odd, so that it has an inverse.
        powers = np.cumprod(np.full(len(one), _FACTOR, np.uint64))
        running = np.append(np.uint64(0), np.cumsum(one * powers))
        total = running[length:] - running[:-length]
        total[1:] *= np.cumprod(np.full(len(total) - 1, pow(_FACTOR, -1, 2**64), np.uint64))
    fresh = np.append(1, (one[1:] != one[:-1]).astype(int))
    changes = np.cumsum(np.append(0, fresh))
    total[changes[length:] - changes[:-length] < 8] = 0
    return total


def _row_hashes(columns: list[Float[np.ndarray, " time"]]) -> np.ndarray:
    """A number for each row, made column by column, as they lie in memory."""
    weights = np.random.default_rng(0).integers(1, 2**62, len(columns), dtype=np.uint64)
    total = np.zeros(len(columns[0]), np.uint64)
    with np.errstate(over="ignore"):
        for column, weight in zip(columns, weights | np.uint64(1), strict=True):
            mixed = (column + 0.0).view(np.uint64)  # a copy, in which −0 is 0
            mixed *= weight
            mixed ^= mixed >> np.uint64(29)
            mixed *= np.uint64(0x9E3779B97F4A7C15)
            total += mixed
    return total
