"""Rests of a log and their means, by the running variance of the rates. NumPy alone."""

import dataclasses

import numpy as np


_WINDOW = 0.5  # s
_QUIET = 4.0  # times the quietest fifth's variance of the rates
_QUIET_FORCE = 6.0  # the same for the specific force, which a table shakes too
_LEAST = 1.0  # s, of a rest
_BLOCK = 10.0  # s: a log of one pose is cut into these


@dataclasses.dataclass(frozen=True, eq=False)
class Rests:
    """Means over rests (or over blocks of one long rest); one row each."""

    first: np.ndarray  # rows [first, last)
    last: np.ndarray
    time: np.ndarray  # s, from the first row on
    accel: np.ndarray  # m/s²
    gyro: np.ndarray  # rad/s
    temperature: np.ndarray | None
    accel_noise: np.ndarray  # of the means, by single samples as if white
    gyro_noise: np.ndarray


def find(log) -> Rests:
    """The rests of a log; a log of one pose gives its blocks."""
    step = float(np.median(np.diff(log.time)))
    if log.one_pose:
        size = max(int(_BLOCK / step), 8)
        first = np.arange(0, len(log.time) - size + 1, size)
        return _means(log, first, first + size)
    n = max(int(_WINDOW / step), 8)
    rate, force = _running_variance(log.gyro, n), _running_variance(log.accel, n)
    quiet = (rate < _QUIET * np.quantile(rate, 0.2)) & (
        force < _QUIET_FORCE * np.quantile(force, 0.2)
    )
    edges = np.flatnonzero(np.diff(np.concatenate([[0], quiet.astype(int), [0]])))
    first, last = edges[::2], edges[1::2] + n - 1
    long = (last - first) * step >= _LEAST
    return _means(log, first[long], last[long])


def _running_variance(values: np.ndarray, n: int) -> np.ndarray:
    """Sum over the axes of the variance inside windows of n rows."""
    centred = values - np.median(values, axis=0)
    sums = np.cumsum(np.pad(centred, ((1, 0), (0, 0))), axis=0)
    squares = np.cumsum(np.pad(centred**2, ((1, 0), (0, 0))), axis=0)
    return ((squares[n:] - squares[:-n]) / n - ((sums[n:] - sums[:-n]) / n) ** 2).sum(axis=1)


def _means(log, first: np.ndarray, last: np.ndarray) -> Rests:
    rows = [slice(a, b) for a, b in zip(first, last, strict=True)]
    mean = lambda x: np.array([x[r].mean(axis=0) for r in rows])
    noise = lambda x: np.array([x[r].std(axis=0) / np.sqrt(r.stop - r.start) for r in rows])
    return Rests(
        first,
        last,
        mean(log.time) - log.time[0],
        mean(log.accel),
        mean(log.gyro),
        None if log.temperature is None else mean(log.temperature),
        noise(log.accel),
        noise(log.gyro),
    )
