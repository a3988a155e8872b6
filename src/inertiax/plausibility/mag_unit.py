"""The magnetometers' unit: they move as the Earth's field does when the device is turned."""

import numpy as np
from jaxtyping import Float

from ..data.formats.columns import MAG_UNITS, TriadColumns
from ..data.plausible_units import (
    field_unit_guess,
    GREATEST_EARTH_FIELD,
    GREATEST_FIELD,
    LEAST_EARTH_FIELD,
)
from .evidence import DeviceLogs
from .finding import Finding, finding
from .remedies import with_unit
from .thresholds import Thresholds


_TURNED = 0.3  # of the magnitude: a device that moves its outputs by less has hardly been turned
_FACTOR = 4.0  # by how much soft iron and a part of the sphere change what the outputs move by


def check_mag_unit(device: DeviceLogs, limits: Thresholds) -> list[Finding]:
    """By how much the outputs move about their middle, against 20 to 70 µT."""
    del limits
    found = []
    for log in device.logs:
        mag = log.recording.mag
        if mag is None:
            continue
        size = field_size(mag[np.isfinite(mag).all(axis=1)])
        if size is None:
            continue
        least, greatest = LEAST_EARTH_FIELD / _FACTOR, _FACTOR * GREATEST_EARTH_FIELD
        if least <= size <= greatest:
            continue
        said: TriadColumns = device.columns.mag or TriadColumns()
        now = MAG_UNITS.get(said.unit or "T", 1.0)
        unit = field_unit_guess(size / now)
        remedy = None if said.unit == "count" else with_unit("mag", said, unit)
        found.append(
            finding(
                "mag_unit",
                "warning",
                "mag",
                f"{log.name}: mag moves by {size:.3g} T as the device is turned, and the Earth's field is "
                f'{1e6 * LEAST_EARTH_FIELD:g} to {1e6 * GREATEST_EARTH_FIELD:g} µT; likely unit "{unit}".',
                remedy=remedy,
                size=size,
            )
        )
    return found


def field_size(mag: Float[np.ndarray, "time 3"]) -> float | None:
    """The field's magnitude by the outputs of a device that was turned, in their unit: without the hard iron, which is
    their middle. Of one that was not turned nothing is known, unless it is beyond what any magnetometer reads."""
    if len(mag) < 10:
        return None
    middle = 0.5 * (mag.min(axis=0) + mag.max(axis=0))
    size = float(np.median(np.linalg.norm(mag - middle, axis=1)))
    whole = float(np.median(np.linalg.norm(mag, axis=1)))
    if size < _TURNED * whole:
        return whole if whole > GREATEST_FIELD else None
    return size
