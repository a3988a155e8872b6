"""How a table's axes stood and turned by its own log, and what that is at the stamps of the device.

Two computers seldom agree to better than a tenth of a second. What the device reads at t the table writes at t + delay
(`[table] delay`); between its rows angles and rates are straight lines, before and after them the table stands.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from .columns import angle_scale, ColumnMap, rate_scale, Turntable
from .held_angles import without_stairs
from .table_rates import rates_by_axis, rates_of_angles


class TableMotion(NamedTuple):
    """The rates are `None` where nobody knows them."""

    time: Float[np.ndarray, " rows"]  # s, on the table's clock
    angles: Float[np.ndarray, "rows axes"]  # rad; NaN where they are not told
    rates: Float[np.ndarray, "rows axes"] | None  # rad/s

    def at(self, time: Float[np.ndarray, " stamps"]) -> "TableMotion":
        """The same at other stamps, s; angles go on beyond a whole turn."""

        def put(values: Float[np.ndarray, "rows axes"]) -> Float[np.ndarray, "stamps axes"]:
            made = np.zeros((len(time), values.shape[1]))
            for k, axis in enumerate(values.T):
                made[:, k] = np.interp(time, self.time, axis)
            return made

        angles = np.array(self.angles)
        for axis in angles.T:
            told = np.isfinite(axis)
            axis[told] = np.unwrap(axis[told])
        return TableMotion(time, put(angles), None if self.rates is None else put(self.rates))


def table_motion(
    read: Callable[[tuple[str, ...], float], Float[np.ndarray, "rows axes"]],
    columns: ColumnMap,
    table: Turntable,
    time: Float[np.ndarray, " rows"],
) -> TableMotion:
    """The angles and rates that `[columns]` names; `read` gives columns times a factor.

    Without stated rates the angles' own make a reference where the azimuth is told; else the Earth's rate in it were a
    guess.

    Raises `ValueError` where `[columns]` names no angles, and as `rates_by_axis` does.
    """
    said, turning = columns.table_angles, columns.table_rates
    if said is None and turning is not None:  # about the vertical alone: `upright_table`
        rates = read(turning.names, rate_scale(turning.unit, "[columns] table_rates"))
        return TableMotion(time, np.zeros((len(time), 0)), rates)
    if said is None:
        raise ValueError(
            "[recordings] table_files: name the table's columns with [columns] table_angles."
        )
    angles, rates = read(said.names, angle_scale(said.unit, "[columns] table_angles")), None
    if turning is not None:
        stated = read(turning.names, rate_scale(turning.unit, "[columns] table_rates"))
        rates = rates_by_axis(angles, stated, time)
    elif table.azimuth is not None:
        rates = rates_of_angles(angles, time)
    return TableMotion(time, without_stairs(angles, time), rates)
