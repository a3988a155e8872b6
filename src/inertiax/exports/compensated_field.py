"""A recording's magnetometers compensated: the field in T, sample by sample."""

import numpy as np
from jaxtyping import Float

from ..calibration.calibration import Calibration
from ..calibration.over_rows import compensated_field_rows
from ..data.recording import Recording


_CHUNK = 65536  # samples compensated at a time: little memory


def compensated_field(
    calibration: Calibration, recording: Recording
) -> Float[np.ndarray, "time 3"] | None:
    """The field of every sample, T, NaN where the magnetometers were not read.

    `None` where they were not recorded or not calibrated. A current that was not recorded counts as none.
    """
    mag, outputs = calibration.mag, recording.mag
    if mag is None or outputs is None:
        return None
    count = recording.num_samples
    temperature = np.zeros(count) if recording.temperature is None else recording.temperature[:, 0]
    current = np.zeros(count)
    if recording.current is not None:
        from ..reduction.field_rows import held_current  # brings in SciPy, which few logs need

        current = held_current(recording)
    parts = []
    for start in range(0, count, _CHUNK):
        rows = slice(start, start + _CHUNK)
        samples = (outputs[rows], temperature[rows], current[rows])
        parts.append(compensated_field_rows(mag, *samples))
    return np.concatenate(parts)


def further_columns(calibration: Calibration, recording: Recording) -> dict[str, np.ndarray]:
    """Compensated columns beside accelerometers and gyros: `mag_x/y/z` (T) and `pressure` (Pa), where calibrated."""
    field = compensated_field(calibration, recording)
    made = {} if field is None else {f"mag_{axis}": field[:, k] for k, axis in enumerate("xyz")}
    if calibration.baro is not None and recording.pressure is not None:
        if recording.temperature is not None:
            offset, _ = calibration.baro.over(recording.temperature[:, 0])
            made["pressure"] = recording.pressure - offset
    return made


def feels_current(calibration: Calibration) -> bool:
    """Whether the field of a current is part of the calibration."""
    mag = calibration.mag
    return mag is not None and any(".current" in n for n in mag.triad.names)
