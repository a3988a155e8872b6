"""Cubics in temperature, for tools that have no other curves."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from numpy.polynomial import chebyshev, polynomial


_NODES = 64
# Relative, below which a change is none: a few roundings of single precision, which the tools compute in.
ROUNDING = 4.0 * float(np.finfo(np.float32).eps)
# Relative, what rounding leaves of a coefficient of zero
_DOUBLE = 64.0 * float(np.finfo(float).eps)


class BiasCurve(NamedTuple):
    """A triad's bias as flight controllers hold it: a cubic about a reference temperature, or a constant."""

    coefficients: Float[np.ndarray, "4 parameters"]  # of Σ aⱼ (T − reference)ʲ
    thermal: bool  # False: a constant, for the static offsets

    def over(
        self, difference: Float[np.ndarray, " sample"]
    ) -> Float[np.ndarray, "sample parameters"]:
        """The bias at each T − reference, °C."""
        return cubic(self.coefficients, difference)


def nodes(low: float, high: float) -> Float[np.ndarray, " node"]:
    """Temperatures at which a cubic is fitted, °C: Chebyshev's, at which least squares comes near
    the smallest greatest error. One where there is one."""
    if not high > low:
        return np.array([low])
    x = np.cos(np.pi * (np.arange(_NODES) + 0.5) / _NODES)
    return 0.5 * (low + high) + 0.5 * (high - low) * x


def fit_cubic(
    values: Float[np.ndarray, "node parameters"], low: float, high: float, reference: float
) -> Float[np.ndarray, "4 parameters"]:
    """Coefficients a₀…a₃ of Σ aⱼ (T − reference)ʲ, from values at `nodes(low, high)`.

    Exact (to rounding) for a polynomial of degree 3 or less; terms that it does not have are 0.
    """
    half = 0.5 * (high - low)
    x = (nodes(low, high) - 0.5 * (low + high)) / half
    series = chebyshev.chebfit(x, values, 3)
    offset, scale = (reference - 0.5 * (low + high)) / half, 1.0 / half
    columns = []
    for one in series.T:
        in_x = np.pad(chebyshev.cheb2poly(one), (0, 4))[:4]
        shifted = np.zeros(1)
        for coefficient in in_x[::-1]:  # Horner's rule with x = offset + scale (T − reference)
            shifted = polynomial.polyadd(
                polynomial.polymul(shifted, [offset, scale]), [coefficient]
            )
        columns.append(np.pad(shifted, (0, 4))[:4])
    found = np.stack(columns, axis=1)
    reach = max(high - reference, reference - low) ** np.arange(4)[:, None]
    return np.where(np.abs(found) * reach > _DOUBLE * np.abs(values).max(axis=0), found, 0.0)


def bias_curve(
    values: Float[np.ndarray, "node parameters"], low: float, high: float, reference: float
) -> BiasCurve:
    """The cubic of a bias known at `nodes(low, high)`, or its constant where it does not move with temperature."""
    if moves(values):
        return BiasCurve(fit_cubic(values, low, high, reference), True)
    return BiasCurve(np.pad(values[:1], ((0, 3), (0, 0))), False)


def moves(values: Float[np.ndarray, "node ..."]) -> bool:
    """Whether values over temperature change by more than single precision resolves of the greatest."""
    return bool(np.ptp(values, axis=0).max() > ROUNDING * np.abs(values).max())


def cubic_misfit(values: Float[np.ndarray, "node parameters"]) -> float:
    """The most that a cubic leaves of values at `nodes(low, high)`; 0 where that is rounding."""
    if len(values) == 1:
        return 0.0
    x = np.cos(np.pi * (np.arange(_NODES) + 0.5) / _NODES)
    left = values - chebyshev.chebval(x, chebyshev.chebfit(x, values, 3)).T
    worst = float(np.abs(left).max())
    return worst if worst > ROUNDING * np.abs(values).max() else 0.0


def cubic(
    coefficients: Float[np.ndarray, "4 parameters"], difference: Float[np.ndarray, " sample"]
) -> Float[np.ndarray, "sample parameters"]:
    """Σ aⱼ dʲ at each temperature difference d, °C."""
    return polynomial.polyval(difference, coefficients).T
