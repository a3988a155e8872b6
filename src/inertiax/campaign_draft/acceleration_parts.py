"""Three triads of which one is the sum of the others: an acceleration, its part without gravity, and gravity.

Fusion chips and phones write all three; that without gravity is as unsteady as gyros are.
"""

from collections.abc import Sequence
from itertools import permutations
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from .column_kinds import STEADY, Triad, unsteadiness
from .raw_log import RawLog


_ROUNDED = 2.5  # steps of the last digit: three rounded numbers differ by 1.5, and are not read at one instant
_EXACT = 1e-6  # of the norm, where many digits are printed
_MOSTLY = 0.9  # of the rows
_MOST = 12  # triads that are looked at
_CONSTANT = 0.05  # spread of a norm: gravity, as a filter writes it, has one


class AccelerationParts(NamedTuple):
    """Triads of columns: `whole` is `linear` and `gravity` together."""

    whole: Triad
    linear: Triad
    gravity: Triad


def acceleration_parts(log: RawLog, triads: Sequence[Triad]) -> AccelerationParts | None:
    """The first three triads of which one is the sum of the others, one of these being of constant norm."""
    triads = triads[:_MOST]
    steady = [t for t in triads if 0.0 <= unsteadiness(log, t) < _CONSTANT]
    for whole, linear, gravity in permutations(triads, 3):
        if gravity not in steady:
            continue
        rows = _outputs(log, (*whole, *linear, *gravity))
        a, b, c = rows[:, :3], rows[:, 3:6], rows[:, 6:]
        if len(rows) and np.ptp(b, axis=0).any() and _is_sum(a, b, c):
            return AccelerationParts(whole, linear, gravity)
    return None


def sole_gyros(log: RawLog, triads: Sequence[Triad]) -> Triad | None:
    """The one triad whose norm is not steady; `None` where there are several or none."""
    unsteady = [
        t
        for t in triads
        if np.ptp(_outputs(log, t), axis=0).all() and unsteadiness(log, t) > STEADY
    ]
    return unsteady[0] if len(unsteady) == 1 else None


def _is_sum(
    whole: Float[np.ndarray, "row 3"],
    linear: Float[np.ndarray, "row 3"],
    gravity: Float[np.ndarray, "row 3"],
) -> bool:
    """Whether two triads add up to the third to the rounding of their digits, in nearly all rows."""
    left = np.abs(whole - linear - gravity).max(axis=1)
    size = float(np.median(np.linalg.norm(whole, axis=1)))
    limit = max(_ROUNDED * max(map(_digit, (whole, linear, gravity))), _EXACT * size)
    return float(np.mean(left <= limit)) > _MOSTLY and limit < _CONSTANT * size


def _digit(values: Float[np.ndarray, "row 3"]) -> float:
    """The smallest step between two outputs of an axis; 0 where none changes."""
    steps = np.concatenate([np.diff(np.unique(values[:, k])) for k in range(3)])
    return float(steps.min()) if len(steps) else 0.0


def _outputs(log: RawLog, names: Sequence[str]) -> Float[np.ndarray, "row column"]:
    """Columns side by side, in the rows in which all have numbers."""
    values = np.stack([log.numbers[n] for n in names], axis=1)
    return values[np.isfinite(values).all(axis=1)]
