"""Confidence intervals of the deviations: equivalent degrees of freedom, then χ².

    edf = 2 (E v)² / var v of the variance estimate v,   edf v / σ² ~ χ²(edf)

For noise with a power-law spectrum the covariance of two differences is a finite difference of the phase's
generalised covariance, so edf is a sum over lags; long averaging is computed with a thousand samples to
the averaging time, beyond which the sum does not change. The total deviations have tables.

**Reference:** Greenhall & Riley, *Uncertainty of stability variances based on finite differences*,
35th PTTI (2003), 267-280, equations (7) to (10); NIST SP 1065, tables 7 and 8.
"""

from functools import lru_cache
from math import comb

import numpy as np
from jaxtyping import Float, Int
from scipy.special import chdtri

from .deviations import Deviations


_FINEST = 1000  # samples to the averaging time

# Exponent of each kind of noise in the spectrum of the rate, f^α.
EXPONENTS = {"Q": 2, "N": 0, "B": -1, "K": -2}

_ORDER = {"hdev": 3, "ohdev": 3}  # of the differences; 2 for the others
_TOTAL = {0: (1.50, 0.0), -1: (1.17, 0.22), -2: (0.93, 0.36)}
_MODIFIED_TOTAL = {
    2: (1.90, 2.1),
    1: (1.20, 1.40),
    0: (1.10, 1.2),
    -1: (0.85, 0.50),
    -2: (0.75, 0.31),
}


@lru_cache(maxsize=4096)  # channels of one log ask the same
def degrees_of_freedom(kind: str, samples: int, factor: int, exponent: int) -> float:
    """Equivalent degrees of freedom of one deviation of a log of that many rates.

    `exponent` is α of the rate's spectrum f^α: 2 quantisation, 0 white, −1 flicker, −2 random walk.
    """
    phase = samples + 1
    if kind == "totdev" and exponent in _TOTAL:
        slope, offset = _TOTAL[exponent]
        return max(slope * phase / factor - offset, 1.0)
    if kind in ("mtotdev", "ttotdev"):
        slope, offset = _MODIFIED_TOTAL[exponent]
        return max(slope * phase / factor - offset, 1.0)
    modified = kind in ("mdev", "tdev")
    order = _ORDER.get(kind, 2)
    fine = min(factor, _FINEST)
    filtering = 1 if modified else fine
    stride = 1 if kind in ("adev", "hdev") else fine
    span = order + (1.0 if modified else 1.0 / factor)  # in averaging times
    terms = 1 + int(np.floor(stride * (phase / factor - span) + 1e-9))
    if terms < 1:
        return 1.0
    lags = np.arange(min(terms, (order + 1) * stride + 1))
    squares = np.square(_lagged(lags / stride, filtering, exponent, order))
    weight = np.where(lags == 0, 1.0, 2.0 * (1.0 - lags / terms))
    freedom = squares[0] * terms / np.sum(weight * squares)
    # White phase is new in every sample, so that there the sum does go on beyond the finest step.
    unseen = factor / fine if exponent == 2 and stride > 1 and not modified else 1.0
    return float(freedom * unseen)


def _lagged(
    lag: Float[np.ndarray, " lag"], filtering: int, exponent: int, order: int
) -> Float[np.ndarray, " lag"]:
    """Covariance of two differences `lag` averaging times apart, up to a common factor."""
    result = np.zeros_like(lag)
    for k in range(-order, order + 1):
        sign = (-1) ** k * comb(2 * order, order + k)
        for shift, weight in ((0.0, 2.0), (-1.0 / filtering, -1.0), (1.0 / filtering, -1.0)):
            result += sign * weight * _generalised(lag + k + shift, exponent)
    return result * filtering**2


def _generalised(t: Float[np.ndarray, " lag"], exponent: int) -> Float[np.ndarray, " lag"]:
    """Generalised autocovariance of the twice summed phase for a rate spectrum f^α."""
    # Multiples of the finest step meet at zero only to rounding.
    t = np.where(np.abs(t) < 1e-9, 0.0, np.abs(t))
    power = 3 - exponent
    if power % 2:
        return t**power
    return t**power * np.log(np.where(t > 0, t, 1.0))


def interval(
    found: Deviations,
    exponent: Int[np.ndarray, " tau"],
    *,
    level: float = 0.6827,
) -> tuple[Float[np.ndarray, " tau"], Float[np.ndarray, " tau"]]:
    """Lower and upper limits of a deviation at a confidence `level`, in its unit.

    `exponent` is the spectrum's exponent that prevails at each τ, as `NoiseModel.exponents` gives it.
    """
    freedom = np.array(
        [
            degrees_of_freedom(found.kind, found.num_samples, int(m), int(a))
            for m, a in zip(found.factor, exponent, strict=True)
        ]
    )
    low, high = 0.5 * (1.0 - level), 0.5 * (1.0 + level)
    lower = found.deviation * np.sqrt(freedom / chdtri(freedom, 1.0 - high))
    upper = found.deviation * np.sqrt(freedom / chdtri(freedom, 1.0 - low))
    return lower, upper
