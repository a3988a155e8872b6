"""How a table's axes stood and turned by its own log, and what that is at the stamps of the device.

Two computers seldom agree to better than a tenth of a second. What the device reads at t the table writes at t + delay
(`[table] delay`); between its rows angles and rates are straight lines, or cubics where the angles alone say the rates;
before and after them the table stands.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from .columns import angle_scale, ColumnMap, rate_scale
from .held_angles import without_repeats, without_stairs
from .table_rates import rates_by_axis, rates_of_angles
from .turntable import Turntable


class TableMotion(NamedTuple):
    """The rates are `None` where nobody knows them."""

    time: Float[np.ndarray, " rows"]  # s, on the table's clock
    angles: Float[np.ndarray, "rows axes"]  # rad; NaN where they are not told
    rates: Float[np.ndarray, "rows axes"] | None  # rad/s
    by_angles: bool = False  # the rates are the angles' own change

    def at(self, time: Float[np.ndarray, " stamps"]) -> "TableMotion":
        """The same at other stamps, s; angles go on beyond a whole turn.

        Where rates are the angles' own change and not the same in two rows, angle and rate between them are those of
        the cubic with both rows' angles and rates. With straight lines the rate would not be the angle's change there:
        of a table that turns two axes at once and writes ten rows a second, a turn came out 450 ppm wrong.
        """
        angles = np.array(self.angles)
        for axis in angles.T:
            told = np.isfinite(axis)
            axis[told] = np.unwrap(axis[told])
        put = lambda values: _lines(time, self.time, values)
        made = TableMotion(time, put(angles), None if self.rates is None else put(self.rates))
        if made.rates is None or not self.by_angles or len(self.time) < 2:
            return made
        assert self.rates is not None
        from scipy.interpolate import CubicHermiteSpline  # slow to import, and seldom needed

        row = np.clip(np.searchsorted(self.time, time, side="right") - 1, 0, len(self.time) - 2)
        inside = (time >= self.time[0]) & (time <= self.time[-1])
        for k in range(angles.shape[1]):
            changes = np.diff(self.rates[:, k]) != 0.0
            bends = inside & changes[row] & np.isfinite(made.angles[:, k] + made.rates[:, k])
            if bends.any():
                told = np.isfinite(angles[:, k] + self.rates[:, k])
                cubic = CubicHermiteSpline(self.time[told], angles[told, k], self.rates[told, k])
                made.angles[bends, k] = cubic(time[bends])
                made.rates[bends, k] = cubic(time[bends], 1)
        return made


def _lines(
    time: Float[np.ndarray, " stamps"],
    of: Float[np.ndarray, " rows"],
    values: Float[np.ndarray, "rows axes"],
) -> Float[np.ndarray, "stamps axes"]:
    """Straight lines between rows; before and after them the table stands."""
    made = np.zeros((len(time), values.shape[1]))
    for k, axis in enumerate(values.T):
        made[:, k] = np.interp(time, of, axis)
    return made


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
    angles, by_angles = without_repeats(angles, time), turning is None
    if turning is not None:
        stated = read(turning.names, rate_scale(turning.unit, "[columns] table_rates"))
        rates = rates_by_axis(angles, stated, time)
    elif table.azimuth is not None:
        rates = rates_of_angles(angles, time)
    return TableMotion(time, without_stairs(angles, time), rates, by_angles)
