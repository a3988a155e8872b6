"""Estimators: one residual function each. To add one, write a file and list it in `ESTIMATORS`.

A user's own is added from outside by `ESTIMATORS["accel"]["name"] = Class`; from then on `[model]` may ask for it.
"""

from .base import AbstractEstimator as AbstractEstimator, NOMINAL_SIGMA as NOMINAL_SIGMA
from .gravity_rotation import GravityRotation as GravityRotation
from .invariant import ellipsoid_start as ellipsoid_start, Invariant as Invariant
from .joint_imu import JointImu as JointImu, size_effect as size_effect
from .magnetic_field import MagneticField as MagneticField
from .reference_accel import ReferenceAccel as ReferenceAccel
from .reference_gyro import ReferenceGyro as ReferenceGyro
from .reference_gyro_rig import ReferenceGyroRig as ReferenceGyroRig
from .static import StaticAccel as StaticAccel, StaticGyro as StaticGyro
from .triads import AccelEstimator as AccelEstimator, GyroEstimator as GyroEstimator


# Names of `[model]` in campaign.toml, by triad.
ESTIMATORS: dict[str, dict[str, type[AbstractEstimator]]] = {
    "accel": {"invariant": Invariant, "reference": ReferenceAccel, "static": StaticAccel},
    "gyro": {"reference": ReferenceGyro, "gravity": GravityRotation, "static": StaticGyro},
    "mag": {"field": MagneticField},
}
