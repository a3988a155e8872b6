"""Gyros that contradict gravity: in most motions the integrated rates turn it otherwise than it turned.

What a calibration fits is a matter of percents. Where motions miss by more, something else is wrong with the gyros: the
unit or the scale of an axis, exchanged columns, lost rows. Their biases at rest may be right all the same.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from .missed_turns import MISSED


# rad/s, 4000 deg/s: the widest range of the gyros that are sold for hands and vehicles (ICM-20649, LSM6DSV80X); a
# motion by more is no motion.
ANY_GYRO = 70.0
_FEWEST = 5  # motions, as a calibration by them needs
_OF_ITS_PATH = 0.2  # MEMS scale factors are within 3 %, raw ones of a wrong range are off by 2 (`missed_turns`)
_LONGEST_PATH = np.pi  # rad, of that: the rates that it is summed from may be what is wrong


class Contradiction(NamedTuple):
    """Motions that the gyros turn otherwise than gravity turned."""

    number: int  # of motions that miss
    among: int  # motions that can be judged
    mean: float  # rad, misfit of all
    where: tuple[tuple[float, float, float], ...]  # s, on the recording's clock, from and to; rad

    @property
    def statement(self) -> str:
        """In words."""
        return (
            f"in {self.number} of {self.among} motions between rests the integrated rates do not turn gravity as it "
            f"turned, by {self.mean:.2f} rad on average: the gyros contradict the accelerometers, in the unit, scale "
            "or sign of an axis, by exchanged axes or by lost rows"
        )


def contradiction(
    misfit: Float[np.ndarray, " motion"],
    path: Float[np.ndarray, " motion"],
    spans: Sequence[tuple[float, float]],
) -> Contradiction | None:
    """What is said of motions most of which miss gravity's turn; `None` of others, and of few.

    **Arguments:** `misfit` is the angle between gravity as the gyros turned it and as it was seen, rad; `path` the
    angle through which they turned step by step, rad; `spans` when each motion began and ended, s.
    """
    if len(misfit) < _FEWEST:
        return None
    limit = np.maximum(MISSED, _OF_ITS_PATH * np.minimum(path, _LONGEST_PATH))
    off = misfit > limit
    if 2 * off.sum() <= len(off):
        return None
    where = tuple((*spans[k], float(misfit[k])) for k in np.flatnonzero(off).tolist())
    return Contradiction(int(off.sum()), len(off), float(misfit.mean()), where)
