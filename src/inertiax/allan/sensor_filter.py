"""The sensor's low-pass filter as a difference equation, from the attenuation that its noise shows.

    1 / |H|² = 1 + c₁ x + c₂ x² + …,   x = sin²(π f / rate) / sin²(π f_u / rate)
    y_k = (1 + Σ a) u_k − a₁ y_{k−1} − a₂ y_{k−2} − …

f_u is the upper end of the band. A polynomial in sin² that is positive everywhere is |1 + Σ a z⁻ʲ|² / (1 + Σ a)² of one
filter whose poles lie inside the unit circle (Fejér and Riesz): with x = (2 − z − 1/z) / 4 each of its roots has one
inside and one outside.

**Reference:** Papoulis & Pillai, *Probability, Random Variables and Stochastic Processes*, 4th edition, section 11-1.
"""

import numpy as np
from jaxtyping import Float

from .band import abscissa


# Of 1 / |H|², anywhere up to half the rate: beyond the band the polynomial is guessed, and no sensor resonates so.
_LEAST = 0.5
_GRID = 1000


def recursion_of(
    coefficients: Float[np.ndarray, " order"], upper: float, rate: float
) -> tuple[float, ...]:
    """a₁, a₂, … of the filter with attenuation c₁, c₂, … in a band up to `upper` Hz, at `rate` Hz; empty where the
    attenuation, continued to half the rate, is that of no filter."""
    scale = float(abscissa(upper, rate)) ** np.arange(1, len(coefficients) + 1)
    polynomial = np.concatenate([[1.0], coefficients / scale])
    if np.polynomial.polynomial.polyval(np.linspace(0.0, 1.0, _GRID), polynomial).min() < _LEAST:
        return ()
    if np.count_nonzero(polynomial) == 1:  # no attenuation
        return ()
    # Each root x of the polynomial is a pair z, 1/z of z² − (2 − 4 x) z + 1.
    roots = np.polynomial.polynomial.polyroots(np.trim_zeros(polynomial, "b")).astype(complex)
    half = 1.0 - 2.0 * roots
    apart = np.sqrt(half**2 - 1.0)
    inside = np.where(np.abs(half + apart) < 1.0, half + apart, half - apart)
    return tuple(np.real(np.poly(inside))[1:].tolist())
