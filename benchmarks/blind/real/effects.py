"""Effects to hide in real logs: what each adds to one channel for a size of one, in closed form.

The specific force is the log's own, by the usual model's fit where there is one. An effect is a function of a
`Drive` and the channel's axis; it is used twice, on means of rests (to size it) and on every row (to inject it).
"""

import dataclasses
from collections.abc import Callable

import numpy as np
from scipy.signal import lfilter


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


def _products(d: Drive, axis: int) -> list[np.ndarray]:
    i, (p, o) = d.force[:, axis], _others(d.force, axis)
    return [i * p, i * o, p * o]


def _memory(d: Drive, axis: int) -> list[np.ndarray]:
    """What a temperature leaves behind: its rate, four lags behind it, and its branch."""
    assert d.temperature is not None and d.temperature_rate is not None
    columns = [d.temperature_rate, np.sign(d.temperature_rate)]
    for part in (0.003, 0.01, 0.03, 0.1):
        share = float(np.median(np.diff(d.time))) / (part * d.length)
        columns.append(lfilter([share], [1.0, share - 1.0], d.temperature - d.temperature[0]))
    return columns


# Effects of several columns, to confirm a name with: all of them at once.
WHOLE: dict[str, Callable[[Drive, int], list[np.ndarray]]] = {
    "g_sensitivity": lambda d, i: list(d.force.T),
    "g2_sensitivity": lambda d, i: [
        d.force[:, a] * d.force[:, b] for a in range(3) for b in range(a + 1)
    ][:-1],
    "cross_coupling": _products,
}
WHOLE_OF_TEMPERATURE = dict.fromkeys(
    ("temperature_rate", "thermal_lag", "thermal_hysteresis", "warm_up"), _memory
)


def menu(log, triad: str) -> dict[str, Shape]:
    """The effects that make sense in a log."""
    if not log.one_pose:
        return BY_FORCE[triad] | {k: BY_TIME[k] for k in ("bias_step", "drift")}
    swing = 0.0 if log.temperature is None else float(np.ptp(log.temperature))
    return BY_TIME | (BY_TEMPERATURE if swing > 10.0 else {})


def drive(log, moment: float, force: np.ndarray) -> Drive:
    """The drivers of every row of a log."""
    time = log.time - log.time[0]
    rate = None
    if log.temperature is not None:
        step = float(np.median(np.diff(time)))
        n = max(int(60.0 / step), 5) | 1
        smooth = np.convolve(np.pad(log.temperature, n // 2, mode="edge"), np.ones(n) / n, "valid")
        rate = 60.0 * np.gradient(smooth, time)
    return Drive(time, float(time[-1]), force, log.temperature, rate, moment)


def over_rests(d: Drive, shape: Shape, axis: int, rests) -> np.ndarray:
    """Means of a shape over rests."""
    return means(shape(d, axis), rests)


def means(values: np.ndarray, rests) -> np.ndarray:
    """Means of a column over rests."""
    return np.array([values[a:b].mean() for a, b in zip(rests.first, rests.last, strict=True)])
