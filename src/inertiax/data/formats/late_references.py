"""References in columns whose stamps are late or early against the outputs' of the same rows.

A controller that logs its table's references beside the outputs of a device may write what it was told some rows ago.
What the table did at t stands at $t + d$, with the delay d of `[table]`.
"""

from typing import Any

import numpy as np

from .turntable import Turntable


_REFERENCES = ("reference_accel", "reference_gyro")


def at_their_moments(columns: dict[str, Any], table: Turntable) -> dict[str, Any]:
    """The columns of one device with both references and `position`, which come of one programme, moved by the delay.

    Rates are put on straight lines between rows; of forces, which are zero where they are not told, and of labels the
    nearest row counts. Before the first row and behind the last these hold. Unchanged without references.

    **Arguments:** `columns` by name, with `time` in s.

    Raises `ValueError` for a drift, which is of a log of the table's own.
    """
    there = [key for key in _REFERENCES if key in columns]
    delay = table.one_delay
    if not there:
        return columns
    if table.one_drift:
        raise ValueError(
            "[table] drift is of a log of the table's own ([recordings] table_files); references in columns beside the "
            "device's are on its clock."
        )
    if not delay:
        return columns
    time = columns["time"]
    asked = time + delay
    after = np.clip(np.searchsorted(time, asked), 1, max(len(time) - 1, 1))
    before = after - 1
    after = np.minimum(after, len(time) - 1)
    nearest = np.where(asked - time[before] <= time[after] - asked, before, after)
    moved = {k: columns[k][nearest] for k in ("reference_accel", "position") if k in columns}
    if "reference_gyro" in columns:
        rates = columns["reference_gyro"].T
        moved["reference_gyro"] = np.stack([np.interp(asked, time, r) for r in rates], axis=1)
    return columns | moved
