"""A device that never lies still: where even the quietest windows of a log move as no sensor's noise does.

Rests are told against the quietest windows of their own log. Of a walk these are steps as well, and all of it would
stand for one rest. Noise of a sensor is small in means over a tenth of a second, or as great in its samples; motion of
a body is slow, so that such means hold much of it.
"""

import numpy as np
from jaxtyping import Float

from .._typing import Mask
from ..data.recording import Recording


_BLOCK = 0.1  # s, of a mean: shorter than a step, longer than a motor's vibration
_SAMPLES = 4  # at least, of a mean: white noise leaves a quarter of its variance in it
_SHARE = 1 / 3  # of the variance within a window, in the means: more than white noise leaves
# Times what white noise leaves in means of n samples, 1/n, that every triad must have: a third more than its mean,
# where the quietest windows of white noise have half of it. Steps shake accelerometers between means, too, and leave
# less than a third in them.
_OVER_WHITE = 4 / 3
# rad/s, scatter of the means, all axes together, 5°/s: 1°/s/√Hz on each axis, ten times the noisiest gyros sold, and
# twice what a hand that holds still does.
_RATE = np.radians(5.0)
# Of the median output: 0.1 g is 0.02 g/√Hz, sixty times the noisiest accelerometers sold (0.3 mg/√Hz), and some steps
# of a ten-bit converter.
_FORCE = 0.1
# What a hand that holds still leaves, at most: in a log that moves, only quieter windows may be rests.
_HELD = 0.02, np.radians(2.5)  # of the median output; rad/s
_QUIETEST = 0.05  # of the windows: those that rests are told against


class Moving:
    """What a log's windows say where it moves in nearly all of them.

    **Attributes:** `rows`, those of windows that move; `words`, how much the quietest one of them does.
    """

    def __init__(self, rows: Mask, words: str):
        self.rows, self.words = rows, words


def moving(recording: Recording, step: float, width: int) -> Moving | None:
    """Rows in which the device moves by itself; `None` where some twentieth of the windows is as quiet as a rest.

    Every triad must be loud, with more in its means than white noise leaves, and one of them with a third: a gyro in a
    wrong unit is as loud, and a motor shakes accelerometers alone.
    `step` is the time from sample to sample, s, and `width` the rows of a window.
    """
    size = max(int(round(_BLOCK / step)) if step > 0.0 else 1, _SAMPLES)
    if width < 2 * size or (recording.accel is None and recording.gyro is None):
        return None
    accel, gyro = recording.accel, recording.gyro
    limits, calm, found, gravity = [], [], [], 0.0
    if accel is not None:
        gravity = float(np.median(np.linalg.norm(accel, axis=1)))
        limits.append(_FORCE * gravity)
        calm.append(_HELD[0] * gravity)
        found.append(_scatter(accel, size, width))
    if gyro is not None:
        limits.append(_RATE)
        calm.append(_HELD[1])
        found.append(_scatter(gyro, size, width))
    shares = []
    for limit, (slow, share) in zip(limits, found, strict=True):
        quiet = slow <= np.quantile(slow, _QUIETEST)
        shares.append(float(np.median(share[quiet])))
        if not (slow[quiet].max() > limit and shares[-1] > min(_OVER_WHITE / size, _SHARE)):
            return None
    if max(shares) <= _SHARE:
        return None
    loud = np.max([slow / most for most, (slow, _) in zip(calm, found, strict=True)], axis=0)
    least = int(np.argmin(loud))
    said = []
    if gyro is not None:
        said.append(f"gyros by {np.degrees(found[-1][0][least]):.2g}°/s")
    if accel is not None:
        said.append(f"accelerometers by {100.0 * found[0][0][least] / gravity:.2g} % of gravity")
    words = f"in the quietest {width * step:.2g} s, outputs scatter: {', '.join(said)}"
    rows = np.repeat(loud > 1.0, width)
    return Moving(np.pad(rows, (0, recording.num_samples - len(rows)), mode="edge"), words)


def _scatter(
    x: Float[np.ndarray, "time 3"], size: int, width: int
) -> tuple[Float[np.ndarray, " window"], Float[np.ndarray, " window"]]:
    """Standard deviation of the means of `size` rows within each window, and their share of its variance."""
    count, parts = len(x) // width, width // size
    windows = x[: count * width].reshape(count, width, 3)[:, : parts * size]
    # Of samples less the window's first: sums of squares lose digits to a great mean.
    windows = windows - windows[:, :1]
    slow = windows.reshape(count, parts, size, 3).mean(axis=2).var(axis=1).sum(axis=1)
    total = windows.var(axis=1).sum(axis=1)
    return np.sqrt(slow), slow / np.where(total > 0.0, total, 1.0)
