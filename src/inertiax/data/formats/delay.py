"""By how much one clock is late against another, of the same motion seen on both."""

import numpy as np
from jaxtyping import Float


_REACH = 2.0  # s, either way
_MOST = 20_000  # rows that are compared
_FEWEST = 50
_EVEN = 0.2  # s (convention: a few rows of a slow telegram, and short beside a move)
_FINER = 10  # times, from one grid of delays to the next


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
    for _ in range(2):
        grid = best + step * np.arange(-np.ceil(_REACH / step), np.ceil(_REACH / step) + 1.0)
        grid = grid if best == 0.0 else best + step * np.arange(-_FINER, _FINER + 1.0)
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
