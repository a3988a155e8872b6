"""Ends of a labelled rest that are not at rest: labels that come before the table has stopped, or after it started."""

from dataclasses import dataclass
from typing import no_type_check

import numpy as np
from jaxtyping import Float

from .quiet_level import median_distance, ordered


@dataclass(frozen=True)
class EndThresholds:
    """When the end of a rest is motion. Settling after a move, of the sensor or the table, is far below and is kept."""

    rate: float = (
        0.02  # rad/s, 1.1 deg/s, off the middle's: tables and hands turn faster (convention)
    )
    force: float = 0.02  # of the specific force, off the middle's: 1.1 deg of tilt (convention)
    quiet: float = 5.0  # standard deviations of a block's median, below which motion has ended
    block: float = 0.05  # s
    fewest: int = 16  # blocks
    most: float = 0.25  # of a rest, at either end: its middle half must be quiet
    longest: float = 2.0  # s, at either end: labels are early by less, and a drift lasts longer
    margin: float = 0.5  # of what is cut off, cut off besides: a smooth stop goes below the noise before its end


THRESHOLDS = EndThresholds()


def quiet_part(
    accel: Float[np.ndarray, "row 3"] | None,
    gyro: Float[np.ndarray, "row 3"] | None,
    step: float,
    limits: EndThresholds = THRESHOLDS,
) -> tuple[int, int]:
    """Rows `[first, last)` of one labelled rest without the motion at its ends, by either triad; all where none shows.

    A rest whose middle moves, too, is left as it is.
    """
    triads = [x for x in (accel, gyro) if x is not None]
    num = len(triads[0])
    size = max(round(limits.block / step), 1) if step > 0.0 else 1
    blocks = num // size
    if blocks < limits.fewest:
        return 0, num
    head = tail = 0
    for values, least in ((accel, None), (gyro, limits.rate)):
        if values is None:
            continue
        off, noise = _off_the_middle(values, size, blocks)
        if least is None:
            least = limits.force * float(np.linalg.norm(ordered(values, 0.5)))
        most = min(int(limits.most * blocks), max(int(limits.longest / (size * step)), 1))
        if off[most : blocks - most].max() > least:
            return 0, num
        spikes = size < 3  # a median of fewer samples follows one
        head = max(head, _moving(off[:most], least, limits.quiet * noise, spikes))
        tail = max(tail, _moving(off[blocks - most :][::-1], least, limits.quiet * noise, spikes))
    cut = lambda moving: min(int(np.ceil(moving * (1.0 + limits.margin))), blocks // 2 - 1) * size
    return cut(head), num - cut(tail)


@no_type_check  # as in `quiet_level`
def _off_the_middle(
    values: np.ndarray, size: int, blocks: int
) -> tuple[Float[np.ndarray, " block"], float]:
    """Distance of each block's median from the middle's, and the noise of such a distance."""
    medians = ordered(values[: size * blocks].reshape(blocks, size, 3).transpose(1, 0, 2), 0.5)
    inner = medians[blocks // 4 : blocks - blocks // 4]
    centre = ordered(inner, 0.5)
    noise = median_distance(inner - centre)
    return np.linalg.norm(medians - centre, axis=1), float(np.linalg.norm(noise))


@no_type_check  # as in `quiet_level`
def _moving(off: Float[np.ndarray, " block"], least: float, quiet: float, spikes: bool) -> int:
    """Blocks from the outer end on that belong to a motion; 0 where none reaches `least`.

    With `spikes` a motion must go on up to the outer end.
    """
    fast = np.flatnonzero(off > least)
    if not len(fast) or (spikes and off[: fast[-1] + 1].min() <= quiet):
        return 0
    still = np.flatnonzero(off[fast[-1] :] <= quiet)
    return int(fast[-1] + (still[0] if len(still) else len(off) - fast[-1]))
