"""How much of the Earth's rate along the vertical gyros show at rest, where a latitude says how much there is.

A gyro's mean in a pose is $b_c + e\\,\\Omega \\sin\\varphi\\,u_c$ with gravity's direction $u$ and $e = 1$; $e$ is the
slope over the poses. Outputs from which a driver took the mean at rest show none, and neither do simulated ones that
left it out. Taken away from those all the same, it would be a g-sensitivity of that size on all axes.
"""

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Shaped

from .._typing import AnyArray
from ..data.recording import Site
from ..physics.vectors import unit_vector
from ..physics.wgs84 import EARTH_RATE


FEWEST = 12  # rests: a level and a slope an axis leave ten of them to tell the scatter
# Standard deviations: 1 is so far off that chance makes it once in 160 logs, and only of gyros that know Earth's rate
# to no better than a fifth; 0 is as near as 95 of 100 logs are that show none.
FAR, NEAR = 2.5, 2.0


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
) -> Shown | None:
    """The part by the means of rests; `None` where they are fewer than 12, or no latitude says what is expected.

    Least squares axis by axis, with the scatter of its own means; the three are pooled, with the scatter among them
    where that is larger, as g-sensitivities of the axes make it.

    **Arguments:** means of gyros (rad/s) and of accelerometers (m/s²) at rest, and the samples in each.

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
    mean = lambda x: np.average(x, axis=0, weights=weight)
    over, read = expected - mean(expected), gyro - mean(gyro)
    told = np.sum(weight[:, None] * over**2, axis=0)
    if np.any(told <= 0.0):
        return None
    slope = np.sum(weight[:, None] * over * read, axis=0) / told
    left = np.sum(weight[:, None] * (read - slope * over) ** 2, axis=0) / (len(gyro) - 2)
    certain = told / np.maximum(left, 1e-300)
    part = float(np.average(slope, weights=certain))
    unlike = float(np.sum(certain * (slope - part) ** 2)) / (len(slope) - 1)
    return Shown(part, math.sqrt(max(unlike, 1.0) / float(certain.sum())))
