"""How much of the Earth's rate along the vertical gyros show at rest, where a latitude says how much there is.

A gyro's mean in a pose is $b_c + e\\,\\Omega \\sin\\varphi\\,u_c$ with gravity's direction $u$ and $e = 1$; $e$ is the
slope over the poses. Outputs from which a driver took the mean at rest show none, and neither do simulated ones that
left it out. Taken away from those all the same, it would be a g-sensitivity of that size on all axes.

Where the temperature goes on its way, biases follow it: $b_c(T)$ is a polynomial of the degree that the means ask for.
Scatter that is temperature's would hide whether Earth's rate is there.
"""

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Shaped

from .._typing import AnyArray
from ..data.recording import Site
from ..numerics.further_columns import log_odds
from ..physics.vectors import unit_vector
from ..physics.wgs84 import EARTH_RATE
from .mean_noise import quantisation_floor


FEWEST = 12  # rests: a level and a slope an axis leave ten of them to tell the scatter
# Standard deviations: 1 is so far off that chance makes it once in 160 logs, and only of gyros that know Earth's rate
# to no better than a fifth; 0 is as near as 95 of 100 logs are that show none.
FAR, NEAR = 2.5, 2.0
HIGHEST_DEGREE = (
    6  # of the biases over temperature, as of calibrations (`model_selection.temperature_degree`)
)


class Shown(NamedTuple):
    """The part of the expected rate that gyros show, and its standard deviation."""

    part: float
    std: float

    @property
    def absent(self) -> bool:
        """Whether it is not there: chance hardly makes so little of it."""
        return 1.0 - self.part > FAR * self.std and abs(self.part) < NEAR * self.std


def shown_earth_rate(
    gyro: Float[AnyArray, "rest 3"],
    force: Float[AnyArray, "rest 3"],
    count: Shaped[AnyArray, " rest"],
    site: Site,
    temperature: Float[AnyArray, " rest"] | None = None,
) -> Shown | None:
    """The part by the means of rests; `None` where they are fewer than 12, or no latitude says what is expected.

    Least squares axis by axis, with the scatter of its own means; the three are pooled, with the scatter among them
    where that is larger, as g-sensitivities of the axes make it.

    **Arguments:** means of gyros (rad/s) and of accelerometers (m/s²) at rest, the samples in each, and the rests'
    temperatures in °C, over which the biases may be polynomials; constants without.

    ```python
    import numpy as np
    from inertiax.data.recording import Site
    from inertiax.reduction.shown_earth_rate import shown_earth_rate

    rng = np.random.default_rng(0)
    force = 9.81 * np.concatenate([np.eye(3), -np.eye(3), np.eye(3), -np.eye(3)])
    noise = 3e-6 * rng.standard_normal((12, 3))
    found = shown_earth_rate(1e-3 + noise, force, np.full(12, 100.0), Site(9.81, np.deg2rad(48.0)))
    print(found.absent)    # True
    ```
    """
    gyro, up, weight = np.asarray(gyro), unit_vector(np.asarray(force)), np.asarray(count, float)
    if site.latitude is None or len(gyro) < FEWEST or abs(math.sin(site.latitude)) < 1e-3:
        return None
    expected = EARTH_RATE * math.sin(site.latitude) * up
    least, best = _fit(gyro, expected, weight, temperature, 0), 0.0
    if np.any(least.told <= 0.0):
        return None
    found = least
    for degree in range(1, _most(temperature) + 1):
        tried = _fit(gyro, expected, weight, temperature, degree)
        odds = sum(log_odds(len(gyro), 2, degree, left) for left in tried.squares / least.squares)
        if odds > best:
            found, best = tried, odds
    certain = found.told / np.maximum(found.squares / found.freedom, 1e-300)
    part = float(np.average(found.slope, weights=certain))
    unlike = float(np.sum(certain * (found.slope - part) ** 2)) / (len(found.slope) - 1)
    return Shown(part, math.sqrt(max(unlike, 1.0) / float(certain.sum())))


def rounding_hides_it(
    step: Float[AnyArray, "3"], variance: Float[AnyArray, "rest 3"], site: Site
) -> bool:
    """Whether the gyros' means cannot tell of Earth's rate, for what rounding leaves of them hides it on an axis.

    Outputs that stand on one code at rest have no scatter there, which says nothing of how well they are known.

    **Arguments:** the converter's steps (rad/s) and the variances of single samples in rests, (rad/s)².
    """
    if site.latitude is None or not len(variance):
        return False
    # The median over rests, for a knock dithers no rest but its own.
    floor = quantisation_floor(np.asarray(step), np.median(variance, axis=0))
    expected = abs(EARTH_RATE * math.sin(site.latitude))
    return bool(np.any(FAR * np.sqrt(floor) > expected))


class _Fit(NamedTuple):
    """Slopes of the three axes beside a polynomial in temperature."""

    slope: Float[np.ndarray, "3"]
    told: Float[np.ndarray, "3"]  # squares of what is expected that no polynomial holds
    squares: Float[np.ndarray, "3"]  # that are left
    freedom: int


def _most(temperature: Float[AnyArray, " rest"] | None) -> int:
    """The highest degree that may be asked: ten rests are left to tell the scatter, as with the fewest rests."""
    if temperature is None:
        return 0
    return min(HIGHEST_DEGREE, len(temperature) - FEWEST, len(np.unique(temperature)) - 1)


def _fit(
    gyro: Float[np.ndarray, "rest 3"],
    expected: Float[np.ndarray, "rest 3"],
    weight: Float[np.ndarray, " rest"],
    temperature: Float[AnyArray, " rest"] | None,
    degree: int,
) -> _Fit:
    """Weighted least squares of a slope and a polynomial, which is projected away first."""
    x = np.zeros(len(gyro))
    if degree and temperature is not None:
        t = np.asarray(temperature, float)
        x = 2.0 * (t - t.min()) / np.ptp(t) - 1.0
    root = np.sqrt(weight)[:, None]
    held = np.linalg.qr(root * np.polynomial.chebyshev.chebvander(x, degree))[0]
    over, read = (root * v - held @ (held.T @ (root * v)) for v in (expected, gyro))
    told = np.sum(over**2, axis=0)
    slope = np.sum(over * read, axis=0) / np.maximum(told, 1e-300)
    squares = np.sum((read - slope * over) ** 2, axis=0)
    return _Fit(slope, told, squares, len(gyro) - 2 - degree)
