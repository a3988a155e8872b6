"""Temperatures of a log of its own at the device's stamps."""

import dataclasses
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..recording import Recording
from .streams import onto


# For so long the first reading held before, and the last one holds: usual steps, and s (conventions). A chamber moves
# by some tenths of a degree in that time.
_HELD, _SHORTLY = 5.0, 10.0


class TemperatureLog(NamedTuple):
    """Readings of one or more probes."""

    name: str  # of the file
    time: Float[np.ndarray, " readings"]  # s, on the device's clock
    values: Float[np.ndarray, "readings probes"]  # °C

    @property
    def step(self) -> float:
        """The usual time between two readings, s."""
        return float(np.median(np.diff(self.time)))


def with_temperatures(recording: Recording, log: TemperatureLog | None) -> Recording:
    """The recording with the log's probes, behind those of its own, by straight lines between readings.

    Raises `ValueError` where the readings do not cover it.
    """
    if log is None:
        return recording
    first, last = float(recording.time[0]), float(recording.time[-1])
    begun, ended = float(log.time[0]), float(log.time[-1])
    held = max(_HELD * log.step, _SHORTLY)
    if first < begun - held or last > ended + held:
        raise ValueError(
            f"{log.name}: its readings are from {begun:.3f} to {ended:.3f} s, the samples of {recording.name} from "
            f"{first:.3f} to {last:.3f} s; readings are needed throughout. Where the clocks differ, say by how much "
            f"the readings' stamps are late: [recordings] temperature_delay, {begun - first:.3f} s more if both began "
            "at once."
        )
    values = onto(recording.time, log.time, log.values, log.name)
    if recording.temperature is not None:
        values = np.concatenate([recording.temperature, values], axis=1)
    return dataclasses.replace(recording, temperature=values)
