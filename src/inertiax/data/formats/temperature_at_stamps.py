"""Temperatures at the device's stamps: those of a log of their own, or that stand in some of its rows."""

import dataclasses
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..recording import Recording
from .streams import onto


# For so long the first reading held before, and the last one holds: usual steps, and s (conventions). A chamber moves
# by some tenths of a degree in that time.
_HELD, _SHORTLY = 5.0, 10.0


def note_on_lines(name: str, step: float) -> str:
    """What a reader should know of a temperature that was read every `step` s."""
    return (
        f"{name}: the temperature is put onto the device's stamps by straight lines between readings some "
        f"{step:.3g} s apart."
    )


def between_rows(
    time: Float[np.ndarray, " rows"], values: Float[np.ndarray, "rows probes"], where: str
) -> tuple[Float[np.ndarray, "rows probes"], float]:
    """Probes that were not read in all rows (NaN), by straight lines between those in which they were, and the usual
    time between two readings, s; 0 where none is missing.

    Raises `ValueError` where a probe's readings, two at least, do not cover the rows.
    """
    if np.isfinite(values).all():
        return values, 0.0
    made, steps = np.empty_like(values), []
    for k, column in enumerate(values.T):
        told = np.isfinite(column)
        at = time[told]
        steps.append(float(np.median(np.diff(at))) if len(at) > 1 else 0.0)
        held = max(_HELD * steps[-1], _SHORTLY)
        if len(at) < 2 or at[0] - time[0] > held or time[-1] - at[-1] > held:
            raise ValueError(
                f"{where}: the temperature has no finite number in {int((~told).sum())} of {len(told)} rows, and what "
                "there is does not cover the log; drop or repair them, or leave out the column. Readings in rows "
                "without a sample are read with this file under [recordings] temperature_files, too."
            )
        made[:, k] = np.interp(time, at, column[told])
    return made, max(steps)


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
