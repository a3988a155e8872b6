"""Which samples of a recording lie outside the temperatures that a calibration covers.

`Calibration.temperature_range` is that of the rests' means, which a recording's own samples exceed a little: rests of a
ramp do not reach its ends, and a probe is noisy. So a sample is outside where it is so by more than a small share of
the range; of constants, where with it the range would be wide enough that a model over temperature is looked for.
"""

import numpy as np
from jaxtyping import Bool, Float

from ..calibration.calibrated_triads import calibrated_triads
from ..calibration.calibration import Calibration
from ..model_selection.model_spec import LEAST_SPAN
from ..physics.temperature import Constant


# Of the range. A polynomial of degree 3 goes on by as much as it swings within at most 1.4 times (T₃(1.04)), so that
# its uncertainty is still that of the range.
SHARE = 0.02


def margin(calibration: Calibration) -> float:
    """How far beyond the calibrated temperatures, °C, a sample is still counted as covered."""
    if calibration.temperature_range is None:
        return 0.0
    low, high = map(float, calibration.temperature_range)
    triads = calibrated_triads(calibration).values()
    constant = all(isinstance(t.curve.basis, Constant) for t in triads)
    return max(SHARE * (high - low), LEAST_SPAN - (high - low) if constant else 0.0)


def extrapolated(
    calibration: Calibration, temperature: Float[np.ndarray, " time"]
) -> Bool[np.ndarray, " time"]:
    """Where a temperature, °C, is outside what the calibration covers by more than `margin`."""
    if calibration.temperature_range is None:
        return np.zeros(len(temperature), bool)
    low, high = map(float, calibration.temperature_range)
    beyond = margin(calibration)
    return (temperature < low - beyond) | (temperature > high + beyond)
