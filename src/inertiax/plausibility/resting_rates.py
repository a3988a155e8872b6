"""Gyros' means at rest against a table's references, and what else than the Earth's rate they may follow."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from .evidence import DeviceLogs, Log
from .thresholds import Thresholds


class RestingRates(NamedTuple):
    """One row a rest that both references are told in."""

    left: Float[np.ndarray, "rest 3"]  # rad/s, means minus their references
    rate: Float[np.ndarray, "rest 3"]  # rad/s, the references
    up: Float[np.ndarray, "rest 3"]
    level: Float[np.ndarray, "rest 3"]  # rad/s, horizontal part of the references
    temperature: Float[np.ndarray, " rest"]  # °C, zero where none was recorded
    time: Float[np.ndarray, " rest"]  # s
    seconds: Float[np.ndarray, " rest"]  # their lengths


def rates_at_rest(log: Log) -> RestingRates | None:
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
    return RestingRates(
        gyro.mean[kept] - ideal, ideal, up, level, np.array(warm), recording.time[start], seconds
    )


def drivers(
    rests: RestingRates, each: list[RestingRates], limits: Thresholds, *, force: bool = True
) -> Float[np.ndarray, "rest driver"]:
    """What each gyro's output may follow: force (unless left out), temperature, and in each recording time."""
    made = [*rests.up.T] if force else []
    if np.ptp(rests.temperature) > limits.one_temperature:
        x = rests.temperature - rests.temperature.mean()
        made += [x, x**2]
    ends = np.cumsum([0, *(len(r.up) for r in each)]).tolist()
    for a, b in zip(ends[:-1], ends[1:], strict=True):
        if b > a:
            made += _course(rests.time, a, b, limits.azimuth_rests)
    columns = np.stack(made, axis=1)
    size = np.linalg.norm(columns, axis=0)
    return columns[:, size > 0.0] / size[size > 0.0]


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


def least_squares(
    design: Float[np.ndarray, "row unknown"], y: Float[np.ndarray, " row"]
) -> tuple[Float[np.ndarray, " unknown"], float]:
    """Least squares, and the sum of squares that is left."""
    size = np.linalg.norm(design, axis=0)
    solution, *_ = np.linalg.lstsq(design / size, y, rcond=1e-9)
    return solution / size, float(np.square(y - design @ (solution / size)).sum())


def of_device(
    device: DeviceLogs, limits: Thresholds
) -> tuple[RestingRates, list[RestingRates]] | None:
    """All rests of a device, and those of each recording; `None` where a recording lacks what they need, or the
    references hold no Earth's rate."""
    asked = [rates_at_rest(log) for log in device.logs]
    told = [r for r in asked if r is not None]
    if not told or len(told) < len(asked) or "gyro" in device.left_alone:
        return None
    rests = RestingRates(*(np.concatenate(part) for part in zip(*told, strict=True)))
    if not len(rests.level) or np.median(np.linalg.norm(rests.level, axis=1)) < limits.earth_rate:
        return None
    return rests, told


def weights(rests: RestingRates) -> Float[np.ndarray, "rest 1"]:
    """Roots of the rests' lengths; a bias wanders, so a rest of an hour tells hardly more than one of the usual
    length."""
    return np.sqrt(np.minimum(rests.seconds, np.median(rests.seconds)))[:, None]
