"""inertiax: differentiable calibration of inertial measurement units.

**Conventions**, stated once and held everywhere.

Units are SI: seconds, m/s², rad/s, rad; temperatures are in °C; g-sensitivity is in rad/s per g.
Files may be in other units and are converted on reading.

Frames. The *case* frame of the device is right-handed; `accel` and `gyro` columns are along its axes
x, y, z (indices 0, 1, 2). With the invariant estimator the accelerometers define the frame: the
first one's axis is x, the second one's lies in the xy plane. The local level frame is
east, north, up. `rot_ab` takes a vector's components in frame b to those in frame a.

Specific force is what an accelerometer feels: at rest it points *up* with magnitude g.

| paper | name here | unit | meaning |
|---|---|---|---|
| a | `force` | m/s² | specific force |
| a' | `accel` | m/s² | accelerometer outputs |
| a⁰ | `accel.bias` | m/s² | accelerometer biases |
| Γ | `accel.matrix` | 1 | scale-factor errors (diagonal), misalignments (rad, off it) |
| ω | `rate` | rad/s | absolute angular rate |
| ω' | `gyro` | rad/s | gyro outputs |
| ν⁰ | `gyro.bias` | rad/s | gyro biases |
| Θ | `gyro.matrix` | 1 | scale-factor errors (diagonal), misalignments (rad, off it) |
| D | `gyro.g_sensitivity` | rad/s/g | g-sensitivity |
| T | `temperature` | °C | the device's probe |

    a' = (E + Γ) a + a⁰,    ω' = (E + Θ) ω + ν⁰ + D a / g

*Distort* goes from true to measured, *compensate* back. A *device* is one IMU; a *dwell* is one time
at rest in a position (or at constant rate); an *experiment* is one run of the programme.

**References.** Shaimardanov, Dzuev, Nekrasov, Rekunov, Kozlov: synthesis and experimental study of an
iterative calibration procedure for the sensing elements of a strapdown INS (in Russian). Terms follow
IEEE 528 (inertial sensor terminology) and IEEE 1293 (accelerometer test).
"""

import importlib
import importlib.metadata
from typing import TYPE_CHECKING


if TYPE_CHECKING:
    from .calibration.calibration import (
        Calibration as Calibration,
        read_calibration as read_calibration,
        TriadCalibration as TriadCalibration,
        write_calibration as write_calibration,
    )
    from .calibration.coefficients import (
        Block as Block,
    )
    from .calibration.fitted_effects import (
        FittedEffect as FittedEffect,
    )
    from .calibration.stacking import (
        stack as stack,
        unstack as unstack,
    )
    from .data.campaign import (
        load_campaign as load_campaign,
    )
    from .data.recording import (
        Campaign as Campaign,
        ModelChoice as ModelChoice,
        Recording as Recording,
        Rig as Rig,
        Site as Site,
    )
    from .estimators import (
        Invariant as Invariant,
        ReferenceAccel as ReferenceAccel,
        ReferenceGyro as ReferenceGyro,
        StaticAccel as StaticAccel,
        StaticGyro as StaticGyro,
    )
    from .fleet.derivatives import (
        Derivatives as Derivatives,
        derivatives as derivatives,
    )
    from .fleet.fit import (
        Fit as Fit,
        fit as fit,
    )
    from .navigation.twin import (
        Twin as Twin,
        TwinState as TwinState,
    )
    from .physics.error_model import (
        AccelerometerErrors as AccelerometerErrors,
        compensate_accel as compensate_accel,
        compensate_gyro as compensate_gyro,
        distort_accel as distort_accel,
        distort_gyro as distort_gyro,
        GyroErrors as GyroErrors,
    )
    from .physics.temperature import (
        Constant as Constant,
        CubicSpline as CubicSpline,
        Curve as Curve,
        Polynomial as Polynomial,
    )
    from .procedure.thermal_iterations import (
        GaussNewtonIteration as GaussNewtonIteration,
        iterate as iterate,
        joint_fit as joint_fit,
        PaperIteration as PaperIteration,
    )
    from .reduction.dwell_means import reduce_to_dwells as reduce_to_dwells
    from .reduction.dwells import Dwells as Dwells


__version__ = importlib.metadata.version("inertiax")

# Names are loaded when first used, so that `inertiax --help` need not wait for JAX. `calibrate` is not among
# them: `inertiax.calibrate` is the module of that name.
_HOME = {
    "Calibration": "calibration.calibration",
    "TriadCalibration": "calibration.calibration",
    "read_calibration": "calibration.calibration",
    "write_calibration": "calibration.calibration",
    "Block": "calibration.coefficients",
    "stack": "calibration.stacking",
    "unstack": "calibration.stacking",
    "FittedEffect": "calibration.fitted_effects",
    "load_campaign": "data.campaign",
    "Campaign": "data.recording",
    "Recording": "data.recording",
    "Site": "data.recording",
    "Rig": "data.recording",
    "ModelChoice": "data.recording",
    "Dwells": "reduction.dwells",
    "reduce_to_dwells": "reduction.dwell_means",
    "AccelerometerErrors": "physics.error_model",
    "GyroErrors": "physics.error_model",
    "compensate_accel": "physics.error_model",
    "compensate_gyro": "physics.error_model",
    "distort_accel": "physics.error_model",
    "distort_gyro": "physics.error_model",
    "Constant": "physics.temperature",
    "Polynomial": "physics.temperature",
    "CubicSpline": "physics.temperature",
    "Curve": "physics.temperature",
    "Invariant": "estimators",
    "ReferenceAccel": "estimators",
    "ReferenceGyro": "estimators",
    "StaticAccel": "estimators",
    "StaticGyro": "estimators",
    "fit": "fleet.fit",
    "Fit": "fleet.fit",
    "derivatives": "fleet.derivatives",
    "Derivatives": "fleet.derivatives",
    "Twin": "navigation.twin",
    "TwinState": "navigation.twin",
    "iterate": "procedure.thermal_iterations",
    "joint_fit": "procedure.thermal_iterations",
    "PaperIteration": "procedure.thermal_iterations",
    "GaussNewtonIteration": "procedure.thermal_iterations",
}
# Second layers, modules of their own.
_MODULES = {"navigation": "navigation", "sources": "analysis.sources"}


def __getattr__(name: str):
    if name in _HOME:
        return getattr(importlib.import_module(f"{__name__}.{_HOME[name]}"), name)
    if name in _MODULES:
        return importlib.import_module(f"{__name__}.{_MODULES[name]}")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted([*_HOME, *_MODULES, "__version__"])
