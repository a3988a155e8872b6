"""References that the log of a table makes, by its angles or by the rate about its one axis."""

import numpy as np
import polars as pl
from jaxtyping import Bool, Float

from .columns import ColumnMap, Layout
from .delay import Clocks
from .numeric_columns import numbers
from .table_angles import ideal_readings
from .table_motion import table_motion, TableMotion
from .upright_table import is_upright_table, readings_on_a_face


References = dict[str, Float[np.ndarray, "rows 3"]]


def references_of_table(
    table: pl.DataFrame,
    columns: ColumnMap,
    layout: Layout,
    where: str,
    moving: Bool[np.ndarray, " rows"] | None,
    stamps: Float[np.ndarray, " rows"],
    accel: Float[np.ndarray, "rows 3"] | None,
) -> References:
    """`reference_accel` (m/s²) and, where rates are known, `reference_gyro` (rad/s); none where `[columns]` names
    neither angles nor rates of a table.

    **Arguments:** `moving` are rows in which the device moves by its label, `stamps` in s, `accel` in m/s².

    Raises `ValueError` for a table whose axes are not told, and where something else makes the reference, too.
    """
    if layout.gravity is None:
        return {}
    if columns.table_angles is not None:
        return _by_angles(table, columns, layout, where, moving, stamps)
    if columns.table_rates is not None:
        return _by_rate(table, columns, layout, where, stamps, accel)
    return {}


def _motion(
    table: pl.DataFrame,
    columns: ColumnMap,
    layout: Layout,
    where: str,
    empty: Bool[np.ndarray, " rows"] | None,
    stamps: Float[np.ndarray, " rows"],
) -> TableMotion:
    """The table's motion at the device's stamps, of its own log or of columns, which may be `empty` in some rows."""
    log, delay = layout.table_log, layout.turntable.one_delay
    if log is None:
        read = lambda names, scale: (
            scale * np.stack([numbers(table, n, where, empty=empty) for n in names], axis=1)
        )
        log = table_motion(read, columns, layout.turntable, stamps)
        if layout.turntable.one_drift:
            raise ValueError(
                "[table] drift is of a log of the table's own ([recordings] table_files); columns beside the device's "
                "are on its clock."
            )
    if layout.table_log is not None or delay != 0.0:
        clocks = Clocks(delay, layout.turntable.one_drift, float(log.time[0]))
        log = log.at(clocks.on_other(stamps))
    return log


def _by_angles(
    table: pl.DataFrame,
    columns: ColumnMap,
    layout: Layout,
    where: str,
    moving: Bool[np.ndarray, " rows"] | None,
    stamps: Float[np.ndarray, " rows"],
) -> References:
    """Where the table moves its angles are late or missing: the force is not told there."""
    if not layout.turntable.axes:
        raise ValueError(
            "[columns] table_angles needs [table] axes, the directions of the table's axes with all angles zero, for "
            'example axes = ["up", "north"].'
        )
    if columns.reference_accel is not None or "reference_accel_x" in table.columns:
        raise ValueError(
            "[columns]: both reference_accel and table_angles are given; angles make the reference, so leave one out."
        )
    assert layout.gravity is not None  # `references_of_table` saw it
    log = _motion(table, columns, layout, where, moving, stamps)
    found = ideal_readings(layout.turntable, log.angles, log.rates, layout.gravity, layout.latitude)
    force, rate = found
    force[np.isnan(force).any(axis=1) if moving is None else moving] = 0.0
    return {"reference_accel": force} | (
        {} if rate is None else {"reference_gyro": np.nan_to_num(rate)}
    )


def _by_rate(
    table: pl.DataFrame,
    columns: ColumnMap,
    layout: Layout,
    where: str,
    stamps: Float[np.ndarray, " rows"],
    accel: Float[np.ndarray, "rows 3"] | None,
) -> References:
    """Of a table whose one axis is the vertical."""
    assert (
        layout.gravity is not None and columns.table_rates is not None
    )  # `references_of_table` saw both
    if not is_upright_table(layout.turntable) or len(columns.table_rates.names) != 1:
        raise ValueError(
            "[columns] table_rates without table_angles is the one rate of a table that turns about the vertical: "
            'write [table] axes = ["up"], or ["down"] where a positive rate is left-handed about up. Other tables need '
            "table_angles."
        )
    if accel is None:
        raise ValueError(
            f"{where}: [columns] table_rates without table_angles needs accelerometers, which tell how the device lies."
        )
    log = _motion(table, columns, layout, where, None, stamps)
    assert log.rates is not None  # `[columns]` names one
    force, rate = readings_on_a_face(
        layout.turntable, accel, log.rates[:, 0], layout.gravity, layout.latitude, where
    )
    return {"reference_accel": force, "reference_gyro": rate}
