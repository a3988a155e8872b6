"""Biases that follow the temperature while a device warms up: linear terms, where the rests show them.

A row of a rest at the temperature T has the derivative ∂r/∂s = (T − T̄) ∂r/∂b by the slopes s of the biases b. The
slopes are estimated with everything else where the evidence is for them; what is said of the parameters holds whatever
they are.
"""

import numpy as np
from jaxtyping import Float

from .posterior import Posterior, Rows


LEAST = 0.5  # °C that the rests must span: below it a probe's steps are all there is (convention)
STRONG = 3.0  # log of the Bayes factor from which there are slopes: "strong" (Kass and Raftery, JASA 90, 1995)
PER_DEGREE = (
    0.01  # of a bias's prior standard deviation: several times what data sheets say (convention)
)


def away_from_mean(temperatures: list[float | None]) -> Float[np.ndarray, " rest"] | None:
    """Temperature of each rest less their mean, °C; `None` where it is not known, or hardly moved."""
    known = [t for t in temperatures if t is not None and np.isfinite(t)]
    if not known or len(known) < len(temperatures) or max(known) - min(known) < LEAST:
        return None
    return np.array(known) - np.mean(known)


def slope_std(bias_std: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3"]:
    """Standard deviations of the slopes' priors, unit of the biases per °C."""
    return PER_DEGREE * bias_std


def with_slopes(
    rows: Rows, away: Float[np.ndarray, " rest"], slopes: Float[np.ndarray, "3"]
) -> Rows:
    """Rows with the slopes of the first three parameters, the biases, behind the others.

    **Arguments:** rows of outputs less `slopes` times `away` (°C); each rest has as many rows as the next.
    """
    by_slope = rows.jacobian[:, :3] * np.repeat(away, len(rows.value) // len(away))[:, None]
    jacobian = np.concatenate([rows.jacobian, by_slope], axis=1)
    return Rows(jacobian, rows.value + by_slope @ slopes, rows.variance)


def followed_slopes(
    constant: Posterior, over_temperature: Posterior
) -> Float[np.ndarray, "3"] | None:
    """The slopes, unit of the biases per °C, where the evidence for them is strong; else `None`."""
    if over_temperature.evidence - constant.evidence < STRONG:
        return None
    return over_temperature.mean[-3:]
