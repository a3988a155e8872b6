"""The clock of a table against the device's: how late the stamps of its angles are."""

import numpy as np
from jaxtyping import Float

from ..data.formats.delay import delay_of
from .evidence import DeviceLogs
from .finding import Finding, finding
from .thresholds import Thresholds


def check_table_delay(device: DeviceLogs, limits: Thresholds) -> list[Finding]:
    """A warning where the gyros turn earlier or later than the angles say, with the delay that mends it.

    At 100 °/s a tenth of a second is 10° of gravity's direction.
    """
    if device.columns.table_angles is None or "gyro" in device.left_alone:
        return []
    told: list[tuple[float, float]] = []
    for log in device.logs:
        gyro, reference = log.recording.gyro, log.recording.reference_gyro
        if gyro is not None and reference is not None:
            found = delay_of(
                log.recording.time, _speed(gyro), log.recording.time, _speed(reference)
            )
            told += [] if found is None else [found]
    if not told:
        return []
    late, sigma = min(told, key=lambda d: d[1])
    if abs(late) < max(limits.table_delay, limits.table_delay_sigmas * sigma):
        return []
    right = device.delay + late
    text = (
        f"{device.logs[0].name}: the table's angles are {abs(late):.3f} s {'late' if late > 0 else 'early'}, as the "
        "gyros turn: two clocks. References are wrong while the table turns."
    )
    return [
        finding(
            "delay", "warning", "table_angles", text, remedy=f"[table]\ndelay = {right:.3f}",
            seconds=late, std=sigma,
        )
    ]  # fmt: skip


def _speed(rates: Float[np.ndarray, "rows 3"]) -> Float[np.ndarray, " rows"]:
    return np.linalg.norm(rates, axis=1)
