"""Whether the device moves now, by the newest rows alone: when it is worth asking where it has rested.

The answer to that is the batch finder's (`reduction.rests`); this only says when to ask. It judges the same quantities
over the newest window against the quietest windows before.
"""

import numpy as np

from ..data.recording import Recording


FIRST_THRESHOLD = 16.0  # times the quietest level, until the finder has chosen one (its own least)
_RESTING_RATE = 5e-3  # rad/s, as in the finder
_QUIET_SHARE = 0.05  # of the windows, as in the finder
_KEPT = 2000  # windows that tell the quietest level


class MotionDetector:
    """Looks at the newest window of rows, one look after another."""

    def __init__(self) -> None:
        self.threshold = FIRST_THRESHOLD
        self._accel: list[float] = []
        self._gyro: list[float] = []
        self._rates: list[np.ndarray] = []

    def moves(self, window: Recording) -> bool:
        """Whether the device moved within a window of rows."""
        ratios = []
        if window.accel is not None:
            spread = float(window.accel.var(axis=0).sum())
            ratios.append(spread / self._level(self._accel, spread, 0.0))
        if window.gyro is not None:
            spread = float(window.gyro.var(axis=0).sum())
            rate = window.gyro.mean(axis=0)
            level = self._level(self._gyro, spread, _RESTING_RATE**2)
            turning = spread + float(np.square(rate - self._resting_rate(rate)).sum())
            ratios.append(turning / level)
        moving = max(ratios) > self.threshold
        if not moving and window.gyro is not None:
            self._rates.append(window.gyro.mean(axis=0))
            del self._rates[:-_KEPT]
        return moving

    def _level(self, seen: list[float], spread: float, least: float) -> float:
        if spread > 0.0:
            seen.append(spread)
            del seen[:-_KEPT]
        return max(float(np.quantile(seen, _QUIET_SHARE)) if seen else 1.0, least, 1e-300)

    def _resting_rate(self, now: np.ndarray) -> np.ndarray:
        """Median of the windows at rest; the present one where there is none."""
        return np.median(self._rates[-200:], axis=0) if self._rates else now
