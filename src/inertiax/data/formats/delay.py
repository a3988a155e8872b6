"""By how much one clock is late against another, of the same motion seen on both."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float


_REACH = 2.0  # s, either way
_MOST = 20_000  # rows that are compared
_FEWEST = 50
_EVEN = 0.2  # s (convention: a few rows of a slow telegram, and short beside a move)
_STILL = 1e-3  # of the largest speed
_FINER = 10  # times, from one grid of delays to the next
_CLOCK = (
    2e-2  # crystals are within 2e-4 of each other, oscillators without one within 1e-2 (convention)
)
_SIGMAS, _LEAST = 5.0, 5e-4  # of a drift; s, over the whole log (convention: 0.05° at 100 °/s)


def delay_of(
    time: Float[np.ndarray, " rows"],
    speed: Float[np.ndarray, " rows"],
    other_time: Float[np.ndarray, " others"],
    other: Float[np.ndarray, " others"],
) -> tuple[float, float] | None:
    r"""The delay $\tau$ for which $v(t) = s\,u(t + \tau)$ fits best, s, and its standard deviation.

    $u$ is a table's speed by its own log and $v$ the same as the device reads it, up to a scale factor s: least squares
    over the rows about which the speed changes. Delays of up to 2 s are looked at. `None` where too little changes.

    **Arguments:** stamps in s and speeds in one unit, of the device and of the table.

    Least squares over a grid of delays, then a parabola through its lowest three; no source.

    ```python
    import numpy as np
    from inertiax.data.formats.delay import delay_of

    t = np.arange(0.0, 20.0, 0.01)
    turns = lambda t: np.exp(-(((t - 8.0) / 1.5) ** 2))
    print(round(delay_of(t, turns(t), t, turns(t - 0.12))[0], 3))    # 0.12
    ```
    """
    rows = _telling(time, other_time, other)
    if len(rows) < _FEWEST:
        return None
    rows = rows[:: max(1, len(rows) // _MOST)]
    t, v = time[rows], speed[rows]
    misfits = lambda delays: np.array(
        [_misfit(v, np.interp(t + d, other_time, other)) for d in delays]
    )
    step = max(float(np.median(np.diff(other_time))), _REACH / 100.0)
    best = 0.0
    for reach in (np.ceil(_REACH / step), _FINER):
        grid = best + step * np.arange(-reach, reach + 1.0)
        left = misfits(grid)
        k = int(np.clip(np.argmin(left), 1, len(grid) - 2))
        best, step = float(grid[k]), step / _FINER
    near = best + step * _FINER * np.array([-1.0, 0.0, 1.0])
    a, b, c = misfits(near)
    bend = a - 2.0 * b + c
    if bend <= 0.0:
        return None
    width = step * _FINER
    best += 0.5 * width * (a - c) / bend
    variance = b / len(v) * 2.0 * width**2 / bend
    return best, float(np.sqrt(max(variance, 0.0)))


def misfit_with(
    time: Float[np.ndarray, " rows"],
    speed: Float[np.ndarray, " rows"],
    other: Float[np.ndarray, " rows"],
    delay: float,
) -> float:
    """What a delay (s) leaves where `delay_of` looks: the mean square beside a multiple of the other speed."""
    rows = _telling(time, time, other)
    return _misfit(speed[rows], np.interp(time[rows] + delay, time, other))


class Clocks(NamedTuple):
    """How late one clock is against another: $T = s + 10^{-6} d\\,(s - T_0)$, $s = t + \\tau$, at the device's $t$."""

    delay: float  # τ, s
    drift: float  # d, ppm
    first: float  # T₀, s, the first stamp of the other log

    def on_device(self, stamps: Float[np.ndarray, " others"]) -> Float[np.ndarray, " others"]:
        """Stamps of the other clock on the device's."""
        part = 1e-6 * self.drift
        return (stamps + part * self.first) / (1.0 + part) - self.delay

    def on_other(self, time: Float[np.ndarray, " rows"]) -> Float[np.ndarray, " rows"]:
        """Stamps of the device on the other clock."""
        late = time + self.delay
        return late + 1e-6 * self.drift * (late - self.first)


def compared(
    time: Float[np.ndarray, " rows"],
    speed: Float[np.ndarray, " rows"],
    stamps: Float[np.ndarray, " others"],
    other: Float[np.ndarray, " others"],
    known: Clocks,
) -> Clocks:
    """Two clocks by what `delay_of` finds in the first and in the second half of what changes.

    A drift is said where it is five of its sigmas and moves the other log by half a millisecond from its first stamp to
    its last.

    **Arguments:** as of `delay_of`, with the stamps as they are; `known` is true to 2 s. By moments; no source.

    ```python
    import numpy as np
    from inertiax.data.formats.delay import Clocks, compared

    t = np.arange(0.0, 2000.0, 0.02)
    turns = lambda t: np.exp(-((((t % 100.0) - 50.0) / 4.0) ** 2))
    found = compared(t, turns(t), t, turns((t - 0.1) / (1.0 + 30e-6)), Clocks(0.0, 0.0, 0.0))
    print(round(found.delay, 3), round(found.drift))    # 0.1 30
    ```
    """
    found = delay_of(time, speed, known.on_device(stamps), other)
    if found is None:
        return known
    known = known._replace(delay=known.delay + found[0])
    for _ in range(2):
        on_device = known.on_device(stamps)
        rows = _telling(time, on_device, other)
        middle = _at_rest(time[rows], np.interp(time[rows], on_device, other))
        halves = [rows[time[rows] <= middle], rows[time[rows] > middle]]
        ends = [
            np.flatnonzero((time >= time[h[0]]) & (time <= time[h[-1]])) for h in halves if len(h)
        ]
        late = [delay_of(time[e], speed[e], on_device, other) for e in ends]
        if len(late) < 2 or late[0] is None or late[1] is None:
            return known
        moments = [float(time[h].mean()) for h in halves]
        apart = moments[1] - moments[0]
        part = (late[1][0] - late[0][0]) / apart
        sigma = float(np.hypot(late[0][1], late[1][1])) / apart
        total = 1e-6 * known.drift + part
        if abs(total) < max(_SIGMAS * sigma, _LEAST / float(np.ptp(stamps))):
            return known
        if abs(total) > _CLOCK:  # two halves that do not show one motion
            return known
        a, tm = 0.5 * (late[0][0] + late[1][0]), 0.5 * (moments[0] + moments[1])
        # T = s' + d (s' − T₀) of s' = t + τ + a + part (t − tm), written with the drift d + part.
        delay = (known.delay + a + part * (known.first - tm)) / (1.0 + part)
        known = known._replace(delay=delay, drift=1e6 * total)
    return known


def _at_rest(time: Float[np.ndarray, " rows"], speed: Float[np.ndarray, " rows"]) -> float:
    """The moment nearest to the middle of rows at which nothing turns; the middle where all such are near the ends.

    A half that ends within a turn has a ramp without its opposite, and an error of the gyros' scale passes for a delay.
    """
    low, middle, high = np.quantile(time, [0.25, 0.5, 0.75])
    still = time[(speed < _STILL * np.max(speed, initial=0.0)) & (low < time) & (time < high)]
    return float(still[np.argmin(np.abs(still - middle))]) if len(still) else float(middle)


def evened(
    time: Float[np.ndarray, " rows"], speed: Float[np.ndarray, " rows"]
) -> Float[np.ndarray, " rows"]:
    """Means of a speed over a fifth of a second about each row, in which rows that repeat an angle average out.

    Of both speeds it leaves the delay between them as it is.

    ```python
    import numpy as np
    from inertiax.data.formats.delay import evened

    speed = np.array([1.0, 1.0, 0.0, 2.0, 1.0, 1.0])
    print(evened(0.1 * np.arange(6.0), speed).round(3))    # [1.    0.667 1.    1.    1.333 1.   ]
    ```
    """
    steps = np.diff(time)
    step = float(np.median(steps)) if len(steps) else 0.0
    rows = int(round(_EVEN / step)) | 1 if step > 0.0 else 1
    if rows < 3 or rows > len(speed):
        return speed
    total = np.cumsum(np.r_[0.0, np.pad(speed, rows // 2, mode="edge")])
    return (total[rows:] - total[:-rows]) / rows


def _misfit(one: Float[np.ndarray, " rows"], other: Float[np.ndarray, " rows"]) -> float:
    """Mean square that is left of one beside a multiple of the other."""
    size = float(other @ other)
    scale = float(one @ other) / size if size > 0.0 else 0.0
    return float(np.mean(np.square(one - scale * other)))


def _telling(
    time: Float[np.ndarray, " rows"],
    other_time: Float[np.ndarray, " others"],
    other: Float[np.ndarray, " others"],
) -> np.ndarray:
    """Rows within reach of which the speed changes."""
    size = float(np.max(other, initial=0.0))
    change = np.abs(np.diff(other)) > 1e-3 * size
    moments = 0.5 * (other_time[1:] + other_time[:-1])[change]
    if size <= 0.0 or not len(moments):
        return np.zeros(0, np.int64)
    place = np.searchsorted(moments, time)
    before = time - moments[np.maximum(place - 1, 0)]
    after = moments[np.minimum(place, len(moments) - 1)] - time
    return np.flatnonzero(np.minimum(np.abs(before), np.abs(after)) < _REACH)
