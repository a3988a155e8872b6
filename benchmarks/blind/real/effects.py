"""Effects to hide in real logs: what each adds to one channel for a size of one, in closed form.

The drivers are the log's own outputs, which differ from the truth by a percent or two. An effect is a function of a
`Drive` and the channel's axis; it is used twice, on means of rests (to size it) and on every row (to inject it).
"""

import dataclasses
from collections.abc import Callable

import numpy as np


G = 9.80665


@dataclasses.dataclass(frozen=True, eq=False)
class Drive:
    """What effects depend on, row by row."""

    time: np.ndarray  # s, from the start
    length: float  # s, of the log
    force: np.ndarray  # g
    temperature: np.ndarray | None  # °C
    temperature_rate: np.ndarray | None  # °C/min
    moment: float  # s, of a step


Shape = Callable[[Drive, int], np.ndarray]


def _others(force: np.ndarray, axis: int) -> tuple[np.ndarray, np.ndarray]:
    return force[:, (axis + 1) % 3], force[:, (axis + 2) % 3]


def _step(d: Drive, axis: int) -> np.ndarray:
    return (d.time > d.moment).astype(float)


def _drift(d: Drive, axis: int) -> np.ndarray:
    return d.time / d.length


def _rate(d: Drive, axis: int) -> np.ndarray:
    assert d.temperature_rate is not None
    return d.temperature_rate


def _warm_up(d: Drive, axis: int) -> np.ndarray:
    return np.exp(-d.time / (0.1 * d.length))


# By triad: the contract's name of an effect, and its shape.
BY_FORCE: dict[str, dict[str, Shape]] = {
    "accel": {
        "second_order": lambda d, i: d.force[:, i] ** 2,
        "third_order": lambda d, i: d.force[:, i] ** 3,
        "odd_quadratic": lambda d, i: d.force[:, i] * np.abs(d.force[:, i]),
        "scale_asymmetry": lambda d, i: np.abs(d.force[:, i]),
        "cross_coupling": lambda d, i: d.force[:, i] * _others(d.force, i)[0],
    },
    "gyro": {
        "g_sensitivity": lambda d, i: _others(d.force, i)[0],
        "g2_sensitivity": lambda d, i: d.force[:, i] * _others(d.force, i)[1],
    },
}
BY_TIME: dict[str, Shape] = {"bias_step": _step, "drift": _drift, "warm_up": _warm_up}
BY_TEMPERATURE: dict[str, Shape] = {"temperature_rate": _rate}


def menu(log, triad: str) -> dict[str, Shape]:
    """The effects that make sense in a log."""
    if not log.one_pose:
        return BY_FORCE[triad] | {k: BY_TIME[k] for k in ("bias_step", "drift")}
    swing = 0.0 if log.temperature is None else float(np.ptp(log.temperature))
    return BY_TIME | (BY_TEMPERATURE if swing > 10.0 else {})


def drive(log, moment: float) -> Drive:
    """The drivers of every row of a log."""
    time = log.time - log.time[0]
    rate = None
    if log.temperature is not None:
        step = float(np.median(np.diff(time)))
        n = max(int(60.0 / step), 5) | 1
        smooth = np.convolve(np.pad(log.temperature, n // 2, mode="edge"), np.ones(n) / n, "valid")
        rate = 60.0 * np.gradient(smooth, time)
    return Drive(time, float(time[-1]), log.accel / G, log.temperature, rate, moment)


def over_rests(d: Drive, shape: Shape, axis: int, rests) -> np.ndarray:
    """Means of a shape over rests."""
    full = shape(d, axis)
    return np.array([full[a:b].mean() for a, b in zip(rests.first, rests.last, strict=True)])
