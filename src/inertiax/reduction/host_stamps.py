"""Stamps that a host made when it read rows in bursts: the rate behind them, and what to say of it."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..data.recording import Recording


_FEWEST = 100  # rows
_LONG = 3.0  # usual steps: a pause between two bursts
_SHARE = 0.02  # of the steps are pauses at least; fewer are lost rows
_MEAN = 2.0  # times the median step: the mean step where rows come in bursts
_BLOCKS, _BLOCK = 40, 5.0  # blocks of a log at most, and the s that one lasts at least
# Between blocks the stamps leave a straight line by this many pauses, or by this part of a block, where no rows were
# lost at once: few of them, here and there, are another rate.
_STEADY, _WANDER = 3.0, 0.01
_SNAP = 3e-3  # relative: a host's clock and a row more or less at the ends
# Hz: output data rates of common IMUs, and round ones.
USUAL_RATES = (
    *(10.0, 12.5, 20.0, 25.0, 26.0, 40.0, 50.0, 52.0, 60.0, 62.5, 75.0, 80.0, 100.0, 102.4, 104.0, 119.0, 120.0),
    *(125.0, 128.0, 200.0, 204.8, 208.0, 238.0, 240.0, 250.0, 256.0, 400.0, 416.0, 476.0, 500.0, 512.0, 800.0),
    *(833.0, 952.0, 1000.0, 1024.0, 1600.0, 1666.0, 2000.0, 4000.0, 8000.0),
)  # fmt: skip


class HostStamps(NamedTuple):
    """How a recording's rows are bunched in time."""

    pauses: int  # steps of more than three usual ones
    steps: int
    usual: float  # s, the median step
    mean: float  # s
    # Hz, of the sensor; `None` where rows were lost, so that no constant rate fits
    rate: float | None


def host_stamps(time: Float[np.ndarray, " time"]) -> HostStamps | None:
    """The bursts in which rows were stamped; `None` where stamps are as regular as a sensor's own."""
    if len(time) < _FEWEST:
        return None
    steps = np.diff(time)
    usual, mean = float(np.median(steps)), float((time[-1] - time[0]) / len(steps))
    pauses = int((steps > _LONG * usual).sum())
    if pauses < _SHARE * len(steps) or mean < _MEAN * usual:
        return None
    pause = float(np.quantile(steps[steps > _LONG * usual], 0.9))
    return HostStamps(pauses, len(steps), usual, mean, _rate(time, pause))


def _rate(time: Float[np.ndarray, " time"], pause: float) -> float | None:
    """The rate behind the stamps, by the middle of each block: a host that halts catches up, lost rows do not."""
    rows = np.arange(len(time), dtype=float)
    slope, level = np.polyfit(rows, time - time[0], 1)
    block = max(len(time) // _BLOCKS, int(_BLOCK / slope), 1)
    off = (time - time[0] - level - slope * rows)[: len(time) // block * block]
    middle = np.median(off.reshape(-1, block), axis=1)
    allowed = max(_STEADY * pause, _WANDER * block * slope)
    return None if np.any(np.abs(np.diff(middle)) > allowed) else usual_rate(1.0 / slope)


def usual_rate(measured: float) -> float:
    """The data rate that a sensor was set to, where the measured one (Hz) is within 0.3 % of a usual one; else the
    measured one to four digits."""
    near = min(USUAL_RATES, key=lambda r: abs(measured / r - 1.0))
    return near if abs(measured / near - 1.0) < _SNAP else float(f"{measured:.4g}")


def remark(recording: Recording) -> str:
    """A sentence on bursts, with the line that mends them, for an error that they may explain; empty without any."""
    found = host_stamps(recording.time)
    if found is None:
        return ""
    text = (
        f" Its stamps come in bursts: {found.pauses} of {found.steps} steps are more than 3 times the usual "
        f"{1e3 * found.usual:.3g} ms, and their mean is {1e3 * found.mean:.3g} ms."
    )
    if found.rate is None:
        return f"{text} No constant rate fits them, so rows seem lost; log the sensor's own stamps."
    return f"{text} Count rows instead: [columns] time = {{ rate = {found.rate:g} }}."
