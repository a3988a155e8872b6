"""What a calibration run gives for each device: the calibration with what is needed to judge and draw it."""

import numpy as np
from jaxtyping import Bool, Float

from .._records import field, Module
from .._typing import AnyArray
from ..calibration.calibration import Calibration
from ..estimators import AbstractEstimator, MagneticField
from ..model_selection.model_spec import ModelSpec
from ..physics.temperature import Curve
from ..plausibility import Finding
from ..procedure.thermal_iterations import ThermalSolution
from ..reduction.contradicted_motions import Contradiction
from ..reduction.dwells import Dwells
from ..reduction.handling import Disturbance
from ..reduction.segments import Segments
from .barometer import BarometerResult
from .observability import Observability
from .slow_noise import SlowNoise


class TriadResult(Module):
    """One triad's estimate with what is needed to judge and draw it."""

    estimator: AbstractEstimator
    solution: ThermalSolution
    dwells: Dwells  # those that have a misfit
    misfit: Float[AnyArray, "dwells rows"]  # after the fit, in `misfit_unit`
    sigma: Float[AnyArray, "dwells rows"]  # of each misfit, dwell noise and scatter together
    observability: Observability
    scatter: float = field(static=True)  # found between dwells, in `misfit_unit`
    chi2_per_dof: float = field(static=True)  # with the dwells' own noise only; NaN if unknown
    follows: str = field(static=True, default="")  # what the misfit follows, if anything
    slow_noise: SlowNoise = field(static=True, default=SlowNoise())  # within `solution.covariance`
    fitted: Dwells | None = None  # all that were fitted, where `dwells` are not all of them
    # What rests err alike by their rounding, within `solution.covariance`; `None` where noise dithers them.
    rounding: Float[AnyArray, "unknowns unknowns"] | None = None
    # Of gyros at rest alone, where their motions contradict gravity's turns.
    contradicted: Contradiction | None = field(static=True, default=None)

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


class MagnetometerResult(Module):
    """The magnetometers' estimate with what is needed to judge and draw it."""

    estimator: MagneticField  # with the field, the weights and the scatter that were found
    curve: Curve  # of all its parameters, zero where they are not free
    # Of the coefficients, row-major (size, parameters); zero where they are not free.
    covariance: Float[AnyArray, "unknowns unknowns"]
    free: Bool[np.ndarray, "size parameter"]  # which coefficients were estimated
    dwells: Dwells  # rests, and samples in motion (position −1)
    misfit: Float[
        AnyArray, "dwells 2"
    ]  # of magnitude and upward part, T; 0 for the latter in motion
    sigma: Float[AnyArray, "dwells 2"]  # dwell noise and scatter together, T
    scatter: float = field(static=True)  # found between dwells, T
    chi2_per_dof: float = field(static=True)  # with the dwells' own noise only; NaN if unknown
    frame: str = field(static=True)  # "accel", or "own" where no vertical was known
    field_given: bool = field(static=True)  # else the scale is by convention
    statements: tuple[str, ...] = field(static=True)  # what was found, for people
    warnings: tuple[str, ...] = field(static=True, default=())

    @property
    def rms(self) -> float:
        """Root mean square of the magnitude's misfit, T."""
        return float(np.sqrt(np.mean(np.square(np.asarray(self.misfit)[:, 0]))))

    @property
    def worst_sigmas(self) -> tuple[float, float]:
        """1 sigma of the least certain hard iron, T, and element of the soft iron, at the mean temperature."""
        size, names = self.curve.basis.size, self.estimator.names
        blocks = np.asarray(self.covariance).reshape(size, len(names), size, len(names))
        (phi,) = self.curve.basis.rows(np.array([np.mean(np.asarray(self.dwells.temperature))]))
        sigma = np.sqrt(np.einsum("a,aibi,b->i", phi, blocks, phi))
        kinds = ("mag.bias", "mag.matrix")
        hard, soft = (
            max(s for s, n in zip(sigma, names, strict=True) if n.startswith(k)) for k in kinds
        )
        return float(hard), float(soft)

    @property
    def num_rests(self) -> int:
        """How many of the rows are rests."""
        return int(np.sum(np.asarray(self.dwells.position) >= 0))


class DeviceResult(Module):
    """A calibrated device."""

    calibration: Calibration
    accel: TriadResult | None
    gyro: TriadResult | None
    model: ModelSpec = field(static=True)
    choices: tuple[str, ...] = field(static=True)
    warnings: tuple[str, ...] = field(static=True)
    plausibility: tuple[Finding, ...] = field(static=True, default=())  # errors only if forced
    handling: tuple[Disturbance, ...] = ()  # where rests were disturbed
    segments: tuple[Segments, ...] = ()  # of each recording
    mag: MagnetometerResult | None = None  # None: not calibrated
    baro: BarometerResult | None = None  # None: not calibrated


class DeviceFailure(Module):
    """A device that could not be calibrated, and why, in one line."""

    device: str = field(static=True)
    reason: str = field(static=True)
