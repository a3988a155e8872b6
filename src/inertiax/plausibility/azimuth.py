"""The heading of the Earth's rate in a table's references, against what the gyros read at rest."""

import math
from typing import NamedTuple

import numpy as np
import scipy.special
from jaxtyping import Float

from .evidence import DeviceLogs, Log
from .finding import Finding, finding
from .thresholds import Thresholds


def check_azimuth(device: DeviceLogs, limits: Thresholds) -> list[Finding]:
    r"""Whether the horizontal part of the Earth's rate points where the gyros see it.

    At rest a reference is $u\,u^T \omega + h$, with the direction u of the vertical and the horizontal part h. Where
    the station's azimuth is $\delta$ too small, gyros read $\cos\delta\,h + \sin\delta\,u \times h$ in the place of
    h. Both columns are fitted to what the rests' means differ by from their references, beside biases, their course
    from rest to rest and with temperature, and g-sensitivities, which are larger than the Earth's rate in cheap gyros:
    a station that rests in few attitudes is told nothing. Said is what an F test finds rarer than `azimuth_by_chance`,
    where the gyros read about as much of the Earth's rate as there is. An ordinary F test; no source.
    """
    asked = [_rests(log) for log in device.logs]
    told = [r for r in asked if r is not None]
    if not told or len(told) < len(asked) or "gyro" in device.left_alone:
        return []
    rests = _Rests(*(np.concatenate(part) for part in zip(*told, strict=True)))
    if not len(rests.level):
        return []
    size = float(np.median(np.linalg.norm(rests.level, axis=1)))
    if size < limits.earth_rate:
        return []
    # A bias wanders: a rest of an hour tells the Earth's rate hardly better than one of the usual length.
    weight = np.sqrt(np.minimum(rests.seconds, np.median(rests.seconds)))[:, None]
    own = np.kron(_drivers(rests, told, limits) * weight, np.eye(3))
    turned = np.stack([np.cross(rests.up, rests.level), rests.level], axis=2)
    design = np.concatenate([own, (turned * weight[..., None]).reshape(-1, 2)], axis=1)
    y = (rests.left * weight).ravel()
    spare = len(y) - design.shape[1]
    if spare < limits.azimuth_spare:
        return _not_told(device, len(rests.up))
    solution, after = _fit(design, y)
    chance = scipy.special.fdtrc(2, spare, (_fit(own, y)[1] - after) / 2.0 / (after / spare))
    across, along = float(solution[-2]), 1.0 + float(solution[-1])
    angle, share = math.atan2(across, along), math.hypot(across, along)
    covariance = np.linalg.pinv(design.T @ design)[-2:, -2:] * after / spare
    if math.sqrt(float(np.diagonal(covariance).max())) > limits.azimuth_share:
        return _not_told(device, len(rests.up))
    slope = np.array([along, -across]) / share**2
    sigma = math.sqrt(max(float(slope @ covariance @ slope), 0.0))
    sure = chance < limits.azimuth_by_chance and abs(angle) > limits.azimuth_sigmas * sigma
    if not sure or not limits.azimuth_share < share < 1.0 / limits.azimuth_share:
        return []
    off = 2.0 * abs(math.sin(0.5 * angle)) * size
    hours = math.degrees(off) * 3600.0
    stated, right, remedy = "the heading of reference_gyro's Earth rate", "", None
    numbers = {"angle": angle, "std": sigma, "share": share, "rests": len(rests.up)}
    if device.columns.table_angles is not None:
        better = (device.azimuth + math.degrees(angle) + 180.0) % 360.0 - 180.0
        stated, right = "[table] azimuth", f" ({better:.1f} is right)"
        remedy = f"[table]\nazimuth = {better:.1f}"
        numbers["azimuth"] = better
    text = (
        f"{device.logs[0].name}: {stated} is off by {math.degrees(angle):.0f} ± {math.degrees(sigma):.1f}°{right}, as "
        f"the gyros read it in {len(rests.up)} rests; {hours:.1f} °/h of the Earth's rate go into biases."
    )
    return [
        finding(
            "azimuth", "warning", "reference_gyro", text, remedy=remedy, **numbers
        )
    ]  # fmt: skip


def _not_told(device: DeviceLogs, rests: int) -> list[Finding]:
    """A note where the azimuth was to be stated, and the gyros say nothing of it."""
    if device.columns.table_angles is None:
        return []
    text = (
        f"{device.logs[0].name}: the gyros do not tell [table] azimuth ({device.azimuth:g}° is taken): {rests} rests "
        "are too few, in too few attitudes or too short beside their noise."
    )
    return [finding("azimuth", "note", "reference_gyro", text, rests=rests)]


class _Rests(NamedTuple):
    left: Float[np.ndarray, "rest 3"]  # rad/s, means minus their references
    up: Float[np.ndarray, "rest 3"]
    level: Float[np.ndarray, "rest 3"]  # rad/s, horizontal part of the references
    temperature: Float[np.ndarray, " rest"]  # °C, zero where none was recorded
    time: Float[np.ndarray, " rest"]  # s
    seconds: Float[np.ndarray, " rest"]  # their lengths


def _rests(log: Log) -> _Rests | None:
    """The rests that both references are told in; `None` where there is no such column."""
    recording = log.recording
    gyro, rate, force = (log.over_rests(c) for c in ("gyro", "reference_gyro", "reference_accel"))
    if gyro is None or rate is None or force is None:
        return None
    length = np.linalg.norm(force.mean, axis=1)
    kept = length > 1.0  # m/s²; zero where the station does not tell it
    up, ideal = force.mean[kept] / length[kept, None], rate.mean[kept]
    level = ideal - np.sum(ideal * up, axis=1, keepdims=True) * up
    start, stop = log.start[kept], log.stop[kept]
    probe = recording.temperature
    warm = [0.0 if probe is None else probe[a:b, 0].mean() for a, b in zip(start, stop)]
    seconds = (stop - start) * log.step
    return _Rests(
        gyro.mean[kept] - ideal, up, level, np.array(warm), recording.time[start], seconds
    )


def _drivers(
    rests: _Rests, each: list[_Rests], limits: Thresholds
) -> Float[np.ndarray, "rest driver"]:
    """What each gyro's output may follow: force, temperature, and in each recording time."""
    drivers = [*rests.up.T]
    if np.ptp(rests.temperature) > limits.one_temperature:
        x = rests.temperature - rests.temperature.mean()
        drivers += [x, x**2]
    ends = np.cumsum([0, *(len(r.up) for r in each)]).tolist()
    for a, b in zip(ends[:-1], ends[1:], strict=True):
        if b > a:
            drivers += _course(rests.time, a, b, limits.azimuth_rests)
    made = np.stack(drivers, axis=1)
    size = np.linalg.norm(made, axis=0)
    return made[:, size > 0.0] / size[size > 0.0]


def _course(
    time: Float[np.ndarray, " rest"], first: int, stop: int, every: int
) -> list[Float[np.ndarray, " rest"]]:
    """Straight lines from knot to knot, one in so many rests of a recording: how its biases wander."""
    here = time[first:stop]
    knots = np.unique(np.quantile(here, np.linspace(0.0, 1.0, max(2, len(here) // every))))
    made = []
    for one in np.eye(len(knots)):
        made.append(np.zeros(len(time)))
        made[-1][first:stop] = np.interp(here, knots, one)
    return made


def _fit(
    design: Float[np.ndarray, "row unknown"], y: Float[np.ndarray, " row"]
) -> tuple[Float[np.ndarray, " unknown"], float]:
    """Least squares, and the sum of squares that is left."""
    size = np.linalg.norm(design, axis=0)
    solution, *_ = np.linalg.lstsq(design / size, y, rcond=1e-9)
    return solution / size, float(np.square(y - design @ (solution / size)).sum())
