"""Counts without a name that may be a magnetometer's: neither size nor sphere tells gravity from the Earth's field."""

import numpy as np
from jaxtyping import Float

from .accel_unit import TriadUnit
from .converters import ACCEL_SCALES, whole
from .mag_unit import turned_all_ways
from .pose_remarks import poses_of
from .resting import Resting


_POSES_OF_A_SPHERE = 6  # below them the scale rests on no sphere (`accel_unit.sphere`)
# Of the scale: twice the zero error that data sheets allow an accelerometer at most (ADXL345, z: 0.25 g). Iron beside a
# magnetometer puts its zero anywhere.
_FAR_ZERO = 0.5


def or_a_field(accel: Float[np.ndarray, "time 3"], rests: Resting, unit: TriadUnit) -> str | None:
    """Why counts without a name may be a magnetometer's, in words; `None` where they are accelerometers'.

    A data sheet's scale tells accelerometers, if it is read in rests. In a device that turns all ways and rests in no
    poses a field is as steady, of whatever counts.
    """
    if unit.unit != "count":
        return None
    of_a_sheet = unit.scale in ACCEL_SCALES and whole(accel)
    laid_down = not rests.slowly and poses_of(accel, rests) >= _POSES_OF_A_SPHERE
    if of_a_sheet and (laid_down or not turned_all_ways(accel)):
        return None
    far = _far_zero(accel, unit)
    if far is not None:
        return (
            f"counts without a name are likely a magnetometer's, for their zero lies {far:.2g} of their size beside 0, "
            "as iron puts it and no accelerometer's does; then call their columns mag"
        )
    return "counts without a name may be a magnetometer's as well; then call their columns mag"


def _far_zero(accel: Float[np.ndarray, "time 3"], unit: TriadUnit) -> float | None:
    """How far the middle of signed counts lies beside 0, of their size; `None` where an accelerometer's may.

    A converter without a sign has its zero in the middle of its range.
    """
    if unit.scale is None or unit.offset is None or not (accel < 0.0).any():
        return None
    far = float(np.linalg.norm(np.broadcast_to(unit.offset, 3))) / unit.scale
    return far if far > _FAR_ZERO else None
