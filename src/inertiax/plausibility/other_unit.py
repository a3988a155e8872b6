r"""Another unit that was put in within a campaign: biases, scale factors and the axes' angles change at one moment.

The rests of each recording, or of each setting of a chamber in it, tell nine numbers of the accelerometers without any
reference: with bias b and lower-triangular W, $|W (a - b)| = g$. What one unit does moves some of them. A restart moves
biases, a supply or a range scale factors, temperature both; a new mounting none, for |f| does not see it. The angles
between the axes are those of a chip or a frame. All three kinds at once are those of another unit.
"""

import itertools
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from .evidence import DeviceLogs, Log
from .finding import Finding, finding
from .thresholds import Thresholds


_REST_IN = 60.0  # s: a longer pause parts two settings, as in `clock`
_SPARE = 3  # rests beyond the nine unknowns of a setting (convention)
_WIDE = 0.2  # smallest over largest singular value, each column of length 1: fewer directions tell no nine numbers
_PASSES, _SETTLED = 12, 1e-9
_ELEMENTS = np.array([(i, j) for i in range(3) for j in range(i + 1)])
# Of the nine: 0 a bias, 1 a scale factor, 2 an angle between axes.
_KIND = np.concatenate([np.zeros(3, int), np.where(_ELEMENTS[:, 0] == _ELEMENTS[:, 1], 1, 2)])
# Numbers of each kind that must change: two of three angles, which nothing else moves; of biases and scale factors one,
# for the two units' own courses over temperature hide what is small.
_FEWEST_OF_KIND = np.array([1, 1, 2])
_SIGMAS = (
    6.0  # of each change: by chance is out of the question, and the sigmas are of few settings
)
# Of each kind a smooth course with as many unknowns must leave this many times what the change leaves: a curve that
# explains it is the temperature's. What is left beside a change is the other unit's own course.
_CURVE_LEAVES = 10.0
# Settings that are compared with a course over temperature, those of one unit among them, and its degree at most.
_FEWEST, _SIDE, _DEGREES = 4, 3, 3
# Where settings are fewer, what one unit may change by: from one switching-on to the next, m/s² and parts (2 mg and
# 0.1 % are repeatabilities of cheap sensors over a year), and for each °C (MPU-6050: 35 mg over 70 °C, 0.02 % per °C;
# axes as `Thresholds.turned_mount`).
_RESTARTED = np.array([0.02, 1e-3, 1e-3])
_EACH_DEGREE = np.array([5e-3, 2e-4, 1e-5])

SAID = "another unit was put in"  # of a campaign that is no single unit's


class _Setting(NamedTuple):
    """The nine numbers of one recording or setting, bias first, with their variances for a misfit of one."""

    log: Log
    began: float  # s
    warm: float  # °C; NaN without a probe
    values: Float[np.ndarray, "9"]
    variance: Float[np.ndarray, "9"]
    square: float  # (m/s²)², sum of the squares that are left
    spare: int


class _Change(NamedTuple):
    """Where the numbers change at once, and by how much."""

    at: int  # the first setting of the other unit
    step: Float[np.ndarray, "9"]


def check_other_unit(device: DeviceLogs, limits: Thresholds) -> list[Finding]:
    """A warning where from one recording, or setting of a chamber, on the accelerometers are another unit's.

    With four settings or more a step of each number stands beside its course over temperature; else a change must be
    beyond what a restart and the temperature make of one unit.
    """
    if "accel" in device.left_alone:
        return []
    settings = [s for log in device.logs for s in _settings(log, device.site.gravity)]
    if len(settings) < 2:
        return []
    noise = sum(s.square for s in settings) / sum(s.spare for s in settings)
    values = np.stack([s.values for s in settings])
    sigma = np.sqrt(noise * np.stack([s.variance for s in settings]))
    warm = np.array([s.warm for s in settings])
    found = _beside_course(values, sigma, warm, limits) or _beyond_one_unit(values, sigma, warm)
    return [] if found is None else [_told(settings, found)]


def _settings(log: Log, gravity: float) -> list[_Setting]:
    """The parts of a recording, by its number of the run or by pauses, whose rests tell all nine numbers."""
    force = log.over_rests("accel")
    if force is None or log.turning or log.num_rests < 9 + _SPARE:
        return []
    time, probe = log.recording.time, log.recording.temperature
    made = []
    for rests in _parts(log):
        told = _nine(force.mean[rests], gravity)
        if told is None:
            continue
        at = log.start[rests]
        warm = np.nan if probe is None else float(np.mean(probe[at, 0]))
        made.append(_Setting(log, float(time[at[0]]), warm, *told))
    return made


def _parts(log: Log) -> list[Int[np.ndarray, " rest"]]:
    """The numbers of the rests of each part."""
    runs = log.labels("experiment")
    if runs is None:
        time = log.recording.time
        new = time[log.start[1:]] - time[log.stop[:-1] - 1] > _REST_IN
    else:
        new = runs[1:] != runs[:-1]
    return np.split(np.arange(log.num_rests), np.flatnonzero(new) + 1)


def _nine(
    force: Float[np.ndarray, "rest 3"], gravity: float
) -> tuple[Float[np.ndarray, "9"], Float[np.ndarray, "9"], float, int] | None:
    """b and W by Gauss-Newton, their variances for a misfit of one, and what is left; `None` where not told."""
    spare = len(force) - 9
    if spare < _SPARE:
        return None
    bias, matrix = np.zeros(3), np.eye(3)
    for _ in range(_PASSES):
        off = force - bias
        ideal = off @ matrix.T
        length = np.linalg.norm(ideal, axis=1)
        if np.any(length < 0.1 * gravity):
            return None
        up = ideal / length[:, None]
        rows = np.concatenate(
            [-up @ matrix, up[:, _ELEMENTS[:, 0]] * off[:, _ELEMENTS[:, 1]]], axis=1
        )
        size = np.linalg.norm(rows, axis=0)
        if not size.all():  # a dead channel
            return None
        singular = np.linalg.svd(rows / size, compute_uv=False)
        if singular[-1] < _WIDE * singular[0]:
            return None
        step = np.linalg.lstsq(rows / size, gravity - length, rcond=None)[0] / size
        bias = bias + step[:3]
        matrix[_ELEMENTS[:, 0], _ELEMENTS[:, 1]] += step[3:]
        if np.abs(step / [*(gravity,) * 3, *(1.0,) * 6]).max() < _SETTLED:
            left = np.linalg.norm((force - bias) @ matrix.T, axis=1) - gravity
            values = np.concatenate([bias, matrix[_ELEMENTS[:, 0], _ELEMENTS[:, 1]]])
            return values, np.diagonal(np.linalg.inv(rows.T @ rows)), float(left @ left), spare
    return None


def _beside_course(
    values: Float[np.ndarray, "setting 9"],
    sigma: Float[np.ndarray, "setting 9"],
    warm: Float[np.ndarray, " setting"],
    limits: Thresholds,
) -> _Change | None:
    """The step that explains what no course over temperature with as many unknowns does."""
    count = len(values)
    if count < _FEWEST:
        return None
    levels = 1
    if not np.isnan(warm).any():
        levels += int(np.count_nonzero(np.diff(np.sort(warm)) > limits.one_temperature))
    degree = min(_DEGREES, levels - 1, count - 3)
    x = np.zeros(count) if levels == 1 else (warm - warm.mean()) / np.ptp(warm)
    courses = [x[:, None] ** np.arange(d + 1) for d in range(degree + 1)]
    best: _Beside | None = None
    for at in range(1, count):
        if max(at, count - at) >= _SIDE:
            found = _step_at(at, courses, values, sigma)
            best = found if best is None or found.total < best.total else best
    if best is None:
        return None
    further = x[:, None] ** np.arange(min(degree + 1, levels - 1) + 1)
    by_curve = _of_kinds(_weighted(further, values, sigma).left)
    if np.any(by_curve < _CURVE_LEAVES * best.left) or not _of_all_kinds(best.certain > _SIGMAS):
        return None
    return _Change(best.at, best.step)


class _Beside(NamedTuple):
    """Steps at one setting beside a course over temperature, of each kind of the degree that suits it."""

    at: int
    step: Float[np.ndarray, "9"]
    certain: Float[np.ndarray, "9"]  # standard deviations
    left: Float[np.ndarray, "3"]  # χ² of each kind, at least its degrees of freedom
    total: float  # χ², with what the degrees cost


def _step_at(
    at: int,
    courses: list[Float[np.ndarray, "setting power"]],
    values: Float[np.ndarray, "setting 9"],
    sigma: Float[np.ndarray, "setting 9"],
) -> _Beside:
    count = len(values)
    after = (np.arange(count) >= at)[:, None].astype(float)
    fits = [_weighted(np.concatenate([c, after], axis=1), values, sigma) for c in courses]
    spare = 3.0 * (count - 1.0 - np.array([c.shape[1] for c in courses]))
    left = np.stack([_of_kinds(f.left) for f in fits])
    # By Schwarz' criterion: ln n for each unknown.
    cost = left - np.log(count) * spare[:, None]
    suits = cost.argmin(axis=0)
    step, std = (
        np.stack([getattr(f, name) for f in fits])[suits[_KIND], np.arange(9)]
        for name in ("last", "std")
    )
    left = np.maximum(left[suits, np.arange(3)], spare[suits])
    certain = np.abs(step) / (std * np.sqrt(left / spare[suits])[_KIND])
    return _Beside(at, step, certain, left, float(cost.min(axis=0).sum()))


class _Weighted(NamedTuple):
    """Least squares of each number by itself."""

    last: Float[np.ndarray, "9"]  # of its unknowns
    std: Float[np.ndarray, "9"]
    left: Float[np.ndarray, "9"]  # χ²


def _weighted(
    design: Float[np.ndarray, "setting unknown"],
    values: Float[np.ndarray, "setting 9"],
    sigma: Float[np.ndarray, "setting 9"],
) -> _Weighted:
    made = _Weighted(np.zeros(9), np.zeros(9), np.zeros(9))
    for k, (y, s) in enumerate(zip(values.T, sigma.T, strict=True)):
        rows = design / s[:, None]
        inverse = np.linalg.pinv(rows)
        found = inverse @ (y / s)
        made.last[k], made.std[k] = found[-1], np.linalg.norm(inverse[-1])
        made.left[k] = np.square(y / s - rows @ found).sum()
    return made


def _of_kinds(each: Float[np.ndarray, "9"]) -> Float[np.ndarray, "3"]:
    """Sums over biases, scale factors and angles."""
    return np.bincount(_KIND, weights=each, minlength=3)


def _beyond_one_unit(
    values: Float[np.ndarray, "setting 9"],
    sigma: Float[np.ndarray, "setting 9"],
    warm: Float[np.ndarray, " setting"],
) -> _Change | None:
    """The first change from one setting to the next beyond what restarts and temperature make of one unit."""
    if np.isnan(warm).any():  # nothing tells what the temperature did
        return None
    for at, (one, other) in enumerate(itertools.pairwise(range(len(values))), 1):
        step = values[other] - values[one]
        allowed = _RESTARTED + _EACH_DEGREE * abs(warm[other] - warm[one])
        certain = _SIGMAS * np.hypot(sigma[one], sigma[other])
        if _of_all_kinds(np.abs(step) > allowed[_KIND] + certain):
            return _Change(at, step)
    return None


def _of_all_kinds(changed: Bool[np.ndarray, "9"]) -> bool:
    """Whether biases, scale factors and angles between axes are among the numbers that changed."""
    return bool(np.all(_of_kinds(changed.astype(float)) >= _FEWEST_OF_KIND))


def _told(settings: list[_Setting], change: _Change) -> Finding:
    first = settings[change.at]
    log, before = first.log, settings[change.at - 1].log
    bias, scale, angle = (float(np.abs(change.step[k == _KIND]).max()) for k in range(3))
    whole = log is not before
    where = "" if whole else f"from {log.moment(first.began)} on "
    since = f"than in {before.name}" if whole else "than before"
    return finding(
        "other_unit",
        "warning",
        "accel",
        f"{log.name}: {where}biases, scale factors and the angles between the axes of the accelerometers are others "
        f"{since}, at once and by up to {bias:.2g} m/s², {1e6 * scale:.2g} ppm and {1e6 * angle:.2g} µrad. No "
        f"temperature, restart or mounting changes all of them: {SAID}. Calibrate them apart, each "
        "in a campaign of its own.",
        bias=bias,
        scale=scale,
        angle=angle,
        began=first.began,
        settings_before=change.at,
        settings_after=len(settings) - change.at,
    )
