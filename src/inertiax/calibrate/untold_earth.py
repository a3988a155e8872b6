"""Earth's rate that no reference tells: the part of it that poses repeat looks like a g-sensitivity.

A table turns the device about axes that stand still in the room. Where its angles are lost, the horizontal part of the
Earth's rate, Ω cos φ, comes again with each pose, and poses are all that the force tells: nine numbers of D take most
of it in. They are then of the size of the Earth's rate, whatever the gyros are, and a D of that size is not known to be
the gyros'. A larger one is.
"""

from collections.abc import Sequence

import numpy as np

from .._typing import AnyArray
from ..calibration.calibration import Calibration, TriadCalibration
from ..calibration.quantities import DEG_PER_HOUR
from ..physics.wgs84 import EARTH_RATE
from .goodness_of_fit import ATTENTION, Finding
from .results import TriadResult


# rad/s per g, of each element of D. A rate of Ω that followed the force exactly would make no element above Ω; poses on
# one side of the sphere tell D less well than that, and twice of it covers the fitted sizes. As in `misfit_pattern`.
MOST = 2.0 * EARTH_RATE
# rad/s: a reference that reads less at rest does not hold the Earth's rate. Convention, as `misfit_pattern._TOLD`.
_LEAST = 0.1 * EARTH_RATE
# Standard deviations from which an element of D is there: chance gives one of nine that in 2.4 % of fits.
_TOLD = 3.0


def no_reference_tells(rates: AnyArray | None) -> bool:
    """Whether references of rates at rest, rad/s, hold no Earth's rate; `None` where there is no such column."""
    return rates is None or bool(np.median(np.linalg.norm(np.asarray(rates), axis=-1)) < _LEAST)


def is_no_more(elements: Sequence[float] | AnyArray) -> bool:
    """Whether the Earth's rate could make elements of D of this size, rad/s per g."""
    return bool(np.max(np.abs(np.asarray(elements)), initial=0.0) <= MOST)


def earth_in_g_sensitivity(
    name: str, triad: TriadCalibration, estimate: TriadResult, calibration: Calibration
) -> list[Finding]:
    """A reservation where a D was found that may be the Earth's rate, and no reference tells which it is.

    **Arguments:** `name` is the triad's in a sentence; D is taken in the middle of the calibrated temperatures.
    """
    own = [k for k, n in enumerate(triad.names) if n.startswith("gyro.g_sensitivity")]
    dwells = estimate.dwells
    rates = dwells.reference_gyro
    if rates is not None and np.any(np.asarray(dwells.position) >= 0):
        rates = np.asarray(rates)[np.asarray(dwells.position) >= 0]
    if not own or not no_reference_tells(rates):
        return []
    bounds = calibration.temperature_range
    (values,), (sigmas,) = triad.over(np.array([0.0 if bounds is None else float(np.mean(bounds))]))
    values, sigmas = values[own], sigmas[own]
    if not is_no_more(values) or not np.any(np.abs(values) > _TOLD * sigmas):
        return []
    size = np.abs(values).max() * DEG_PER_HOUR
    text = (
        f"{name}: the g-sensitivity, {size:.2g} °/h/g at most, is no larger than the Earth's rate makes "
        f"({EARTH_RATE * DEG_PER_HOUR:.0f} °/h), whose heading no reference tells: it may be that, and no property of "
        "the gyros. A table's angles with [site] latitude tell them apart."
    )
    return [Finding("earth_rate", ATTENTION, text)]
