"""What a calibration run gives for each device: the calibration with what is needed to judge and draw it."""

import equinox as eqx
import numpy as np
from jaxtyping import Float

from .._typing import AnyArray
from ..calibration.calibration import Calibration
from ..estimators import AbstractEstimator
from ..model_selection.model_spec import ModelSpec
from ..plausibility import Finding
from ..procedure.thermal_iterations import ThermalSolution
from ..reduction.dwells import Dwells
from ..reduction.handling import Disturbance
from ..reduction.segments import Segments
from .observability import Observability


class TriadResult(eqx.Module):
    """One triad's estimate with what is needed to judge and draw it."""

    estimator: AbstractEstimator
    solution: ThermalSolution
    dwells: Dwells  # those that have a misfit
    misfit: Float[AnyArray, "dwells rows"]  # after the fit, in `misfit_unit`
    sigma: Float[AnyArray, "dwells rows"]  # of each misfit, dwell noise and scatter together
    observability: Observability
    scatter: float = eqx.field(static=True)  # found between dwells, in `misfit_unit`
    chi2_per_dof: float = eqx.field(static=True)  # with the dwells' own noise only; NaN if unknown

    @property
    def rms(self) -> float:
        """Root mean square of the misfit, in `misfit_unit`."""
        return float(np.sqrt(np.mean(np.square(np.asarray(self.misfit)))))

    @property
    def misfit_unit(self) -> str:
        """m/s^2 or rad/s of an output; rad of gravity's direction after a motion."""
        if self.dwells.motion is not None:
            return "rad"
        return "m/s^2" if self.estimator.triad == "accel" else "rad/s"


class DeviceResult(eqx.Module):
    """A calibrated device."""

    calibration: Calibration
    accel: TriadResult | None
    gyro: TriadResult | None
    model: ModelSpec = eqx.field(static=True)
    choices: tuple[str, ...] = eqx.field(static=True)
    warnings: tuple[str, ...] = eqx.field(static=True)
    plausibility: tuple[Finding, ...] = eqx.field(static=True, default=())  # errors only if forced
    handling: tuple[Disturbance, ...] = ()  # where rests were disturbed
    segments: tuple[Segments, ...] = ()  # of each recording


class DeviceFailure(eqx.Module):
    """A device that could not be calibrated, and why, in one line."""

    device: str = eqx.field(static=True)
    reason: str = eqx.field(static=True)
