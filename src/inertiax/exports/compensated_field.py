"""A recording's magnetometers compensated: the field in T, sample by sample."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._typing import AnyArray
from ..calibration.calibration import Calibration
from ..calibration.magnetometers import MagnetometerCalibration
from ..data.recording import Recording


_CHUNK = 65536  # samples compensated at a time: one compilation, little memory


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
        pad = (0, _CHUNK - len(outputs[rows]))  # one program serves logs of every length
        found = _compensate(
            mag,
            np.pad(outputs[rows], (pad, (0, 0))),
            np.pad(temperature[rows], pad),
            np.pad(current[rows], pad),
        )
        parts.append(np.asarray(found)[: len(outputs[rows])])
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


@eqx.filter_jit
def _compensate(
    mag: MagnetometerCalibration, outputs: AnyArray, temperature: AnyArray, current: AnyArray
) -> Float[Array, "time 3"]:
    return jax.vmap(mag)(jnp.asarray(outputs), jnp.asarray(temperature), jnp.asarray(current))
