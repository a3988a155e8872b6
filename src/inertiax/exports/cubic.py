"""Cubics in temperature, for tools that have no other curves."""

import numpy as np
from jaxtyping import Float
from numpy.polynomial import chebyshev, polynomial


_NODES = 64


def nodes(low: float, high: float) -> Float[np.ndarray, " node"]:
    """Temperatures at which a cubic is fitted, °C: Chebyshev's, at which least squares comes near
    the smallest greatest error."""
    x = np.cos(np.pi * (np.arange(_NODES) + 0.5) / _NODES)
    return 0.5 * (low + high) + 0.5 * (high - low) * x


def fit_cubic(
    values: Float[np.ndarray, "node parameters"], low: float, high: float, reference: float
) -> Float[np.ndarray, "4 parameters"]:
    """Coefficients a₀…a₃ of Σ aⱼ (T − reference)ʲ, from values at `nodes(low, high)`.

    Exact (to rounding) for a polynomial of degree 3 or less.
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
    return np.stack(columns, axis=1)


def cubic(
    coefficients: Float[np.ndarray, "4 parameters"], difference: Float[np.ndarray, " sample"]
) -> Float[np.ndarray, "sample parameters"]:
    """Σ aⱼ dʲ at each temperature difference d, °C."""
    return polynomial.polyval(difference, coefficients).T
