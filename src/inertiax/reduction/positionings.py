"""Which plateaus of constant rate a table ran through in one position of its axis, so that they share its error.

A table is set once and then turns about one axis at a whole staircase of rates. How the case lies against that axis,
and so the error of the position, is the same for all of them. Plateaus that follow one another are of one positioning
where their rates are parallel or antiparallel and gravity lies at one angle to them; so do rests between them, or the
table was set anew. Where no force is known, another number of the rest's position says so.

Rests before and after a staircase about the vertical stand in one attitude, too: `rests_of_one_attitude`, and
`attitudes`, which numbers them.
"""

import numpy as np
from jaxtyping import Bool, Float, Int

from ..physics.vectors import unit_vector
from ..physics.wgs84 import EARTH_RATE
from .plateaus import TURNING


ACROSS = 0.02  # part of a rate across another's axis, from which they are about two axes
EARTHS = 1.5  # Earth rates across: a table's slow rate and the Earth's are no longer parallel to the axis
SAME = 1e-3  # rad; references within it are one attitude: far more than their digits, far less than from pose to pose
TILTED = 0.5  # m/s²; force along the axis changes by that if it tilts by 3°, more than biases do


def shared_positionings(
    position: Int[np.ndarray, "*device dwell"],
    rate: Float[np.ndarray, "*device dwell 3"],
    force: Float[np.ndarray, "*device dwell 3"] | None = None,
    valid: Bool[np.ndarray, "*device dwell"] | None = None,
) -> Int[np.ndarray, "*device dwell"]:
    """Numbers from 0 of the positionings that several dwells share; −1 for dwells whose positioning is their own.

    **Arguments:** dwells or blocks in the order they were recorded: `position` is −1 while the table turns, `rate` its
    reference in rad/s, `force` the specific force in m/s², as stated or measured.
    """
    lead, count = position.shape[:-1], position.shape[-1]
    position = position.reshape(-1, count)
    rate = rate.reshape(-1, count, 3)
    force = None if force is None else force.reshape(-1, count, 3)
    kept = np.ones(position.shape, bool) if valid is None else valid.reshape(-1, count)
    speed = np.linalg.norm(rate, axis=-1)
    turning = kept & (position < 0) & (speed > TURNING * EARTH_RATE)
    numbers = np.full(position.shape, -1)
    fastest, lean = np.zeros((len(position), 3)), np.zeros(len(position))
    number, last = np.full(len(position), -1), np.full(len(position), -1)
    open_, moved = np.zeros(len(position), bool), np.zeros(len(position), bool)
    for k in range(count):
        resting, turns = kept[:, k] & (position[:, k] >= 0), turning[:, k]
        along = None if force is None else np.einsum("di,di->d", unit_vector(fastest), force[:, k])
        tilted = moved if along is None else np.abs(along - lean) > TILTED
        if along is None:
            moved = moved | (resting & (last >= 0) & (position[:, k] != last))
        else:
            open_ = open_ & ~(resting & tilted)
        last = np.where(resting, position[:, k], last)
        same = open_ & ~tilted & _parallel(fastest, rate[:, k])
        number = number + (turns & ~same)
        faster = turns & (~same | (speed[:, k] > np.linalg.norm(fastest, axis=1)))
        fastest = np.where(faster[:, None], rate[:, k], fastest)
        if force is not None:
            lean = np.where(faster, np.einsum("di,di->d", unit_vector(fastest), force[:, k]), lean)
        numbers[:, k] = np.where(turns, number, -1)
        open_, moved = open_ | turns, moved & ~turns
    return _of_several(numbers).reshape(*lead, count)


def rests_of_one_attitude(
    position: Int[np.ndarray, " dwell"],
    rate: Float[np.ndarray, "dwell 3"],
    force: Float[np.ndarray, "dwell 3"],
    recording: Int[np.ndarray, " dwell"],
) -> Bool[np.ndarray, " dwell"]:
    """Whether a rest has the attitude of the rest before it, because a table turned about the vertical alone between.

    So it is where a device is mounted once and then turned by a rate table with a vertical axis: how the mounting is
    off is the same in all rests of a recording. Without turns between them a table may have been set anew.

    **Arguments:** dwells in the order they were recorded: `position` is −1 while the table turns, `rate` and `force`
    are the references in rad/s and m/s², zero where they are not told.

    ```python
    import numpy as np
    from inertiax.reduction.positionings import rests_of_one_attitude

    up = np.array([0.0, 0.0, 1.0])
    rate, force = np.outer([0.0, 1.0, -1.0, 0.0], up), 9.81 * np.outer([1.0, 0.0, 0.0, 1.0], up)
    print(rests_of_one_attitude(np.array([0, -1, -1, 0]), rate, force, np.zeros(4, int)))    # [False False False  True]
    ```
    """
    same = np.zeros(position.shape, bool)
    last, turned = -1, False
    for k in range(len(position)):
        if last >= 0 and recording[k] != recording[last]:
            last = -1
        if position[k] >= 0:
            size = np.linalg.norm(force[k])
            if turned and last >= 0 and size > 0.0:
                same[k] = np.linalg.norm(force[k] - force[last]) <= SAME * size
            last, turned = k, False
        elif last >= 0:
            across = np.linalg.norm(np.cross(unit_vector(force[last]), rate[k]))
            vertical = across <= ACROSS * np.linalg.norm(rate[k]) + EARTHS * EARTH_RATE
            last, turned = (last, True) if vertical else (-1, False)
    return same


def attitudes(
    position: Int[np.ndarray, " row"],
    rate: Float[np.ndarray, "row 3"],
    force: Float[np.ndarray, "row 3"],
    recording: Int[np.ndarray, " row"],
    segment: Int[np.ndarray, " row"],
) -> Int[np.ndarray, " row"]:
    """The segment in which the device came to stand as it does at each row, by `rests_of_one_attitude`; a row's own
    elsewhere.

    **Arguments:** `segment` numbers the rests and plateaus that the rows, dwells or blocks of such, are of; the others
    are as there.

    ```python
    import numpy as np
    from inertiax.reduction.positionings import attitudes

    up = np.array([0.0, 0.0, 1.0])
    rate, force = np.outer([0.0, 1.0, -1.0, 0.0], up), 9.81 * np.outer([1.0, 0.0, 0.0, 1.0], up)
    print(attitudes(np.array([0, -1, -1, 0]), rate, force, np.zeros(4, int), np.arange(4)))    # [0 1 2 0]
    ```
    """
    again = rests_of_one_attitude(position, rate, force, recording)
    first = {int(k): int(k) for k in np.unique(segment)}
    last = -1
    for k in np.flatnonzero(position >= 0):
        if again[k]:
            first[int(segment[k])] = first[int(segment[last])]
        last = k
    return np.array([first[int(k)] for k in segment], int)


def _parallel(
    first: Float[np.ndarray, "device 3"], second: Float[np.ndarray, "device 3"]
) -> Bool[np.ndarray, " device"]:
    """Whether the slower of two rates lies along the axis of the faster, in either sense."""
    sizes = np.linalg.norm(first, axis=1), np.linalg.norm(second, axis=1)
    across = np.linalg.norm(np.cross(first, second), axis=1) / np.maximum(
        np.maximum(*sizes), 1e-300
    )
    return across <= ACROSS * np.minimum(*sizes) + EARTHS * EARTH_RATE


def _of_several(numbers: Int[np.ndarray, "device dwell"]) -> Int[np.ndarray, "device dwell"]:
    """The numbers that stand in several places, counted anew from 0 in each row; −1 for the others."""
    highest = int(numbers.max(initial=-1)) + 1
    if not highest:
        return numbers
    counts = np.zeros((len(numbers), highest), int)
    row, column = np.nonzero(numbers >= 0)
    np.add.at(counts, (row, numbers[row, column]), 1)
    renamed = np.where(counts > 1, np.cumsum(counts > 1, axis=1) - 1, -1)
    return np.where(numbers >= 0, np.take_along_axis(renamed, np.maximum(numbers, 0), 1), -1)
