"""Rests that are none: knocks, single spikes, slow tilts, and labels that begin or end in a motion."""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float

from ..reduction.mean_noise import converter_steps
from .dead_channels import triads
from .evidence import DeviceLogs, Log
from .finding import Finding, finding
from .thresholds import Thresholds


_SHORTEST = 20  # rows of a rest that is looked into
_LONGEST = 300.0  # s; beyond, zeros wander by themselves
_COURSE = 10.0  # s, over which a long rest's slow course is taken: longer than what disturbs one
_COURSES = 8  # of them at least; a shorter rest has no course
_IN_EACH = 250  # rows tell a median to a twelfth of the noise
_SPIKE = 2  # rows; longer disturbances are knocks
_LEAST_LEAD = 3  # rows of motion at an end
_ENOUGH = 10_000  # rows tell the noise of a longer rest to 1 %
_NOTICED = 5.0  # standard errors by which a rest's mean has to move
_NO_REST = 0.1  # rad
CREEPING = (
    "starts",
    "stops",
)  # evidence: s on the recording's clock, of the rests in which gravity creeps
_MATTERS = {"accel": 2e-3, "gyro": 2e-4}  # m/s², rad/s: what a rest's mean has to move at the least


@dataclasses.dataclass(frozen=True)
class _Rest:
    """What one rest shows beside rest."""

    start: float  # s
    stop: float  # s, of its last row
    spikes: int
    knocks: int
    shift: float  # of the mean, in standard errors
    head: int  # rows of motion at the beginning
    tail: int
    tilt: float  # rad from end to end
    doubt: float  # rad, of that


def check_rests(device: DeviceLogs, limits: Thresholds) -> list[Finding]:
    """Every rest of every recording."""
    found: list[Finding] = []
    for log in device.logs:
        if log.turning:
            continue
        rests = [r for k in range(log.num_rests) if (r := _look(log, k, limits)) is not None]
        if not rests:
            continue
        if log.labelled:
            found += _labels(log, rests, limits)
        found += _spikes(log, rests)
        found += _tilts(log, rests, limits)
    return found


def _look(log: Log, k: int, limits: Thresholds) -> _Rest | None:
    a, b = int(log.start[k]), int(log.stop[k])
    if b - a < _SHORTEST:
        return None
    far = np.zeros(b - a, bool)
    shift = 0.0
    head, tail = 0, 0
    for name, values in triads(log):
        x = values[a:b]
        x = x - _course(x, log.step)
        enough = x[:: max(len(x) // _ENOUGH, 1)]
        centre = np.median(enough, axis=0)
        noise = 1.4826 * np.median(np.abs(enough - centre), axis=0)
        noise = np.maximum(noise, converter_steps(values))
        for axis in np.flatnonzero(noise == 0.0):  # most samples alike, on no grid that shows
            noise[axis] = np.min(np.diff(np.unique(x[:, axis])), initial=np.inf)
        noise = np.where(np.isfinite(noise), noise, 0.0)
        if np.any(noise <= 0):
            continue
        off = np.any(np.abs(x - centre) > limits.spike * noise, axis=1)
        far |= off
        if not off.any():
            continue
        kept = ~off
        if kept.sum() >= 8:
            change = np.abs(x.mean(axis=0) - x[kept].mean(axis=0))
            least = np.maximum(noise / np.sqrt(len(x)) * _NOTICED, _MATTERS[name])
            shift = max(shift, float(np.max(change / least)))
    if far.any():
        head, tail = _ends(far)
    inner = far[head : len(far) - tail]
    spikes, knocks = _runs(inner)
    tilt, doubt = _tilt(log, a + head, b - tail)
    time = log.recording.time
    return _Rest(float(time[a]), float(time[b - 1]), spikes, knocks, shift, head, tail, tilt, doubt)


def _course(x: Float[np.ndarray, "row 3"], step: float) -> Float[np.ndarray, "row 3"] | float:
    """The slow course of a long rest, by straight lines between medians: a device that warms up is not disturbed."""
    width = int(round(_COURSE / step)) if step > 0.0 else 0
    count = len(x) // width if width else 0
    if count < _COURSES:
        return 0.0
    each = x[: count * width].reshape(count, width, 3)
    middles = np.median(each[:, :: max(width // _IN_EACH, 1)], axis=1)
    at = (np.arange(count) + 0.5) * width
    # Axis by axis in memory, as the samples of a `Recording` lie.
    return np.stack([np.interp(np.arange(len(x)), at, m) for m in middles.T]).T


def _ends(far: Bool[np.ndarray, " row"]) -> tuple[int, int]:
    """Rows at both ends that move: as far as half of the rows so far are off."""
    return _end(far), _end(far[::-1])


def _end(far: Bool[np.ndarray, " row"]) -> int:
    mostly = (np.cumsum(far) > 0.5 * np.arange(1, len(far) + 1)) & far
    rows = np.flatnonzero(mostly[: len(far) // 2])
    return int(rows[-1] + 1) if len(rows) else 0


def _runs(far: Bool[np.ndarray, " row"]) -> tuple[int, int]:
    """Numbers of short and of longer disturbances; pauses of up to 5 rows do not end one."""
    rows = np.flatnonzero(far)
    if not len(rows):
        return 0, 0
    parts = np.split(rows, np.flatnonzero(np.diff(rows) > 5) + 1)
    sizes = np.array([p[-1] - p[0] + 1 for p in parts])
    return int(np.sum(sizes <= _SPIKE)), int(np.sum(sizes > _SPIKE))


def _tilt(log: Log, a: int, b: int) -> tuple[float, float]:
    """Turn of gravity's direction from the first third to the last, times 1.5 for the whole; its standard error."""
    recording = log.recording
    if recording.accel is None or b - a < _SHORTEST or (b - a) * log.step > _LONGEST:
        return 0.0, 1.0
    if recording.temperature is not None and np.ptp(recording.temperature[[a, b - 1], 0]) > 1.0:
        return 0.0, 1.0
    x = recording.accel[a:b]
    third = len(x) // 3
    blocks = x[: 3 * third].reshape(3, third, 3)
    first, _, last = blocks.mean(axis=1)
    size = float(np.linalg.norm(x.mean(axis=0)))
    if size <= 0:
        return 0.0, 1.0
    across = (last - first) - np.vdot(last - first, first) * first / np.vdot(first, first)
    # Neighbouring means of a tenth of a third say how well a third's mean is known, whatever the noise.
    size_of = max(third // 10, 1)
    pieces = blocks[:, : third // size_of * size_of].reshape(3, -1, size_of, 3).mean(axis=2)
    change = np.diff(pieces, axis=1)
    error = np.sqrt(0.5 * np.mean(change**2, axis=(0, 1)).sum() / pieces.shape[1] * 2)
    along = np.vdot(last, first) / np.linalg.norm(first)
    angle = float(np.arctan2(np.linalg.norm(across), along))  # small: |across| over the size
    return min(1.5 * angle, np.pi), 1.5 * float(error) / size


def _labels(log: Log, rests: list[_Rest], limits: Thresholds) -> list[Finding]:
    """Rests by label that begin (end) in a motion, many of them alike."""
    found = []
    for side, word, mend in (("head", "begin", "early"), ("tail", "end", "late")):
        lengths = np.array([getattr(r, side) for r in rests])
        moving = lengths >= _LEAST_LEAD
        if moving.sum() < 3 or moving.mean() < limits.labels_off:
            continue
        span = float(np.median(lengths[moving])) * log.step
        found.append(
            finding(
                "positions",
                "warning",
                "position",
                f"{log.name}: {int(moving.sum())} of {len(rests)} rests {word} while the device still moves, by "
                f"{span:.3g} s in the middle: the labels are {mend}.",
                rests=int(moving.sum()),
                of=len(rests),
                seconds=span,
            )
        )
    return found


def _spikes(log: Log, rests: list[_Rest]) -> list[Finding]:
    hit = [r for r in rests if r.shift > 1.0 and (r.spikes or r.knocks)]
    if not hit:
        return []
    spikes, knocks = sum(r.spikes for r in hit), sum(r.knocks for r in hit)
    times = ", ".join(log.moment(r.start) for r in hit[:4])
    parts = [f"{spikes} single samples far off"] if spikes else []
    parts += [f"{knocks} knocks"] if knocks else []
    return [
        finding(
            "disturbed_rest",
            "warning" if len(hit) > 0.03 * len(rests) else "note",
            "rests",
            f"{log.name}: {' and '.join(parts)} move the means of {len(hit)} of {len(rests)} rests, as recorded, "
            f"beyond their noise (rests that begin at {times}).",
            rests=len(hit),
            spikes=spikes,
            knocks=knocks,
            largest=max(r.shift for r in hit),
        )
    ]


def _tilts(log: Log, rests: list[_Rest], limits: Thresholds) -> list[Finding]:
    # A rest that was searched and turns by more than a few degrees was none.
    most = np.inf if log.labelled else _NO_REST
    hit = [r for r in rests if limits.tilt_in_rest < r.tilt < most and r.tilt > 8.0 * r.doubt]
    if not hit:
        return []
    worst = max(hit, key=lambda r: r.tilt)
    times = zip(CREEPING, (tuple(r.start for r in hit), tuple(r.stop for r in hit)), strict=True)
    return [
        finding(
            "disturbed_rest",
            "warning" if len(hit) > 0.03 * len(rests) else "note",
            "rests",
            f"{log.name}: gravity's direction creeps in {len(hit)} of {len(rests)} rests, as recorded, by "
            f"{np.degrees(worst.tilt):.2f}° in the one that begins at {log.moment(worst.start)}: the device tilted "
            "slowly or slipped.",
            rests=len(hit),
            largest=worst.tilt,
            recording=log.recording.name,
            **dict(times),
        )
    ]
