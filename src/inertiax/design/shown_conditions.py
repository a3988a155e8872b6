"""What a calibrated campaign says about the plan to come: noise, re-positioning, temperatures."""

import math

import equinox as eqx
import numpy as np

from ..calibrate.results import DeviceResult


ALIKE = 1.0  # °C: a range below that is one temperature


class Conditions(eqx.Module):
    """The conditions of a campaign, as arguments of `advise`."""

    density: float = eqx.field(static=True)  # m/s²/√Hz, white noise of one accelerometer at rest
    repeatability: float = eqx.field(static=True)  # m/s², scatter between rests beside that noise
    experiments: int = eqx.field(static=True)  # temperatures, enough for the degree
    degree: int = eqx.field(static=True)  # of the curves that were fitted
    low: float = eqx.field(static=True)  # °C
    high: float = eqx.field(static=True)  # °C

    def as_dict(self) -> dict[str, float | int]:
        """For JSON, by the names of the fields."""
        return {name: getattr(self, name) for name in self.__dataclass_fields__}

    def line(self) -> str:
        """In words, with units."""
        over = f", degree {self.degree} from {self.low:.0f} to {self.high:.0f} °C"
        return (
            f"white noise {self.density:.2g} m/s²/√Hz, scatter between rests {self.repeatability:.2g} m/s²"
            + (over if self.degree else ", one temperature")
        )


def shown_by(result: DeviceResult) -> Conditions:
    r"""The conditions that a device was calibrated under.

    The density is $\sqrt{t\,\mathrm{tr}(\Sigma)/3}$, with $\Sigma$ the covariance of the mean of a rest of t seconds:
    the median over the rests. With a reference $u$ it is $\sqrt{t\,u^T \Sigma u / u^T u}$: along gravity, errors of the
    table's angles are none. What they give across it joins the scatter between rests that the fit found.

    Raises `ValueError` where no accelerometers were calibrated.

    **Example:** `shown_by(inertiax.calibrate(campaign)[0]).density`.
    """
    accel = result.accel
    if accel is None or accel.dwells.accel_covariance is None:
        raise ValueError(
            "`shown_by(result)`: a plan of positions is for accelerometers, and none are calibrated."
        )
    dwells = accel.dwells
    used = np.asarray(dwells.valid, bool)
    covariance = np.asarray(dwells.accel_covariance)[used]
    variance = mean = np.trace(covariance, axis1=-2, axis2=-1) / 3.0
    if dwells.reference_accel is not None:
        u = np.asarray(dwells.reference_accel)[used]
        variance = np.einsum("ni,nij,nj->n", u, covariance, u) / np.sum(u**2, axis=1)
    repeatability = math.sqrt(float(accel.scatter) ** 2 + max(float(np.mean(mean - variance)), 0.0))
    density = float(np.sqrt(np.median(variance * np.asarray(dwells.duration)[used])))
    degree = 0 if result.model.accel is None else result.model.accel.temperature_degree
    temperature = np.asarray(dwells.temperature)[used]
    low, high = float(temperature.min()), float(temperature.max())
    if degree == 0 or high - low < ALIKE:
        middle = 0.5 * (low + high)
        low, high, degree = middle - 0.5 * ALIKE, middle + 0.5 * ALIKE, 0
    experiments = len(np.unique(np.asarray(dwells.experiment)[used])) if degree else 1
    return Conditions(density, repeatability, max(experiments, degree + 1), degree, low, high)
