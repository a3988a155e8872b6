"""Whether a compensated log is better: what its rests read before and after.

At rest the force's norm is gravity's and the rate is zero but for the Earth's 15 °/h, whichever way the device lies. So
means over stretches in which the log is quiet tell what a calibration leaves, without a reference.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..data.recording import Recording
from ..reduction.rests import STILL


Rows = Float[np.ndarray, "time 3"]

# Within a second; of consumer parts at 1 kHz less than half of it is noise, and in a hand or in flight it is more.
_QUIET_FORCE, _QUIET_RATE = 0.2, 0.05  # m/s², rad/s, root of the summed variances
_TURNING = 0.05  # rad/s, 3 °/s: a table's rates are above, biases that are left below
_FEWEST = 5  # quiet seconds
_LONGEST = 10.0  # s, of a mean: noise averages out, and what a warm-up does does not
_FEWEST_ROWS = 3  # of a second, that a scatter is told by


class AtRest(NamedTuple):
    """Root mean squares over stretches of rest, before and after; `None` of a triad that was not recorded."""

    seconds: int
    force: tuple[float, float] | None  # m/s², of |f| − g
    rate: tuple[float, float] | None  # rad/s, of the rate's norm

    @property
    def sentence(self) -> str:
        """The same in one line."""
        parts = []
        if self.force is not None:
            before, after = self.force
            parts.append(f"|force| off gravity {before:.2g} → {after:.2g} m/s²")
        if self.rate is not None:
            before, after = np.degrees(self.rate)
            parts.append(f"rate {before:.2g} → {after:.2g} °/s")
        return f"at rest ({self.seconds} s, rms): {', '.join(parts)}"


class Tally:
    """Sums over the seconds of a log, filled piece by piece; a second may lie in two of them."""

    def __init__(self, gravity: float):
        """With gravity of the place, m/s²."""
        self.gravity = gravity
        self._parts: list[np.ndarray] = []
        self._has = (False, False)

    def add(self, recording: Recording, force: Rows | None, rate: Rows | None) -> None:
        """Count a piece: its outputs, and what compensation made of them (m/s², rad/s)."""
        self._has = recording.accel is not None, recording.gyro is not None
        zeros = np.zeros((recording.num_samples, 3))
        pairs = ((recording.accel, force), (recording.gyro, rate))
        four = [zeros if x is None else np.asarray(x, float) for pair in pairs for x in pair]
        columns = [np.ones((len(zeros), 1)), *four]
        columns += [np.square(x).sum(axis=1, keepdims=True) for x in (four[0], four[2])]
        second, row = np.unique(np.floor(recording.time), return_inverse=True)
        sums = [np.bincount(row, c) for c in np.concatenate(columns, axis=1).T]
        self._parts.append(np.column_stack([second, *sums]))

    def result(self) -> AtRest | None:
        """What the rests read; `None` where there are too few quiet seconds."""
        if not self._parts:
            return None
        parts = np.concatenate(self._parts)
        second, row = np.unique(parts[:, 0], return_inverse=True)
        sums = np.stack([np.bincount(row, c, len(second)) for c in parts[:, 1:].T], axis=1)
        kept = sums[:, 0] >= _FEWEST_ROWS
        second, sums = second[kept], sums[kept]
        if not len(sums):
            return None
        means = sums[:, 1:] / sums[:, :1]
        raw_force, force, raw_rate, rate = (means[:, k : k + 3] for k in (0, 3, 6, 9))
        quiet = np.linalg.norm(rate, axis=1) < _TURNING
        triads = ((raw_force, means[:, 12], _QUIET_FORCE), (raw_rate, means[:, 13], _QUIET_RATE))
        for has, (mean, square, most) in zip(self._has, triads):
            if has:
                variance = np.maximum(square - np.square(mean).sum(axis=1), 0.0)
                quiet &= (variance < most**2) & (variance <= STILL * np.quantile(variance, 0.1))
        if quiet.sum() < _FEWEST:
            return None
        weight, (raw_force, force, raw_rate, rate) = _stretches(
            second[quiet], sums[quiet, 0], np.stack([raw_force, force, raw_rate, rate])[:, quiet]
        )
        off = lambda f: _rms(np.linalg.norm(f, axis=1) - self.gravity, weight)
        size = lambda w: _rms(np.linalg.norm(w, axis=1), weight)
        return AtRest(
            int(quiet.sum()),
            (off(raw_force), off(force)) if self._has[0] else None,
            (size(raw_rate), size(rate)) if self._has[1] else None,
        )


def _stretches(
    second: Float[np.ndarray, " second"],
    count: Float[np.ndarray, " second"],
    means: Float[np.ndarray, "4 second 3"],
) -> tuple[Float[np.ndarray, " stretch"], Float[np.ndarray, "4 stretch 3"]]:
    """Rows in, and means over, quiet seconds that follow one another in one pose, for at most `_LONGEST`."""
    moved = np.linalg.norm(np.diff(means[0], axis=0), axis=1) > _QUIET_FORCE
    pose = np.cumsum(np.r_[False, (np.diff(second) > 1.0) | moved])
    start = second[np.searchsorted(pose, pose)]
    part = np.floor((second - start) / _LONGEST)
    _, row = np.unique(np.stack([pose, part]), axis=1, return_inverse=True)
    weight = np.bincount(row, count)
    summed = [np.stack([np.bincount(row, count * x) for x in mean.T], axis=1) for mean in means]
    return weight, np.stack(summed) / weight[:, None]


def _rms(values: Float[np.ndarray, " stretch"], weight: Float[np.ndarray, " stretch"]) -> float:
    return float(np.sqrt(np.average(np.square(values), weights=weight)))
