r"""How noisy the gyros are while a hand turns them, where rests in that hand say too much.

The angle random walk of the gyros' motions is what their rests show. A rest in a hand shows the hand's turning instead,
which a gyro measures and does not err by, and all motions then look several times worse than they are. With d² the
variance of the two directions that a motion joins, n² that of its integrated rates by the rests, and r the tilts that
are left,

$$\sum \frac{r^2}{d^2 + k n^2} = \nu, \qquad 0 \le k \le 1,$$

with ν degrees of freedom (`widened`) is Paule and Mandel's equation for k, of r/n and d/n.
"""

import numpy as np
from jaxtyping import Float
from scipy.special import gammainc

from .._jax import eqx
from ..numerics.paule_mandel import excess_deviation, widened
from ..reduction.dwells import Dwells
from .between_dwell_variance import judged


# Probability of so small a χ² by chance, from which the rests' noise is not believed (convention).
_CHANCE = 1e-3


def with_noise_shown(
    dwells: Dwells,
    misfit: Float[np.ndarray, "judged rows"],
    sigma: Float[np.ndarray, "judged rows"],
    unknowns: int,
) -> Dwells:
    """The dwells with the noise of their motions as the tilts that are left show it; the same where χ² is as expected.

    **Arguments:** `misfit` and its standard deviation `sigma` by the dwells' own noise, rad, two of each that a motion
    led to; `unknowns` of the fit that these judge.
    """
    motion = dwells.motion
    freedom = misfit.size - unknowns
    if motion is None or freedom <= 0 or not np.all(sigma > 0.0):
        return dwells
    chi2 = float(np.sum(np.square(misfit / sigma)))
    if not gammainc(0.5 * freedom, 0.5 * chi2) < _CHANCE:
        return dwells
    noise = np.asarray(motion.noise)[judged(dwells)][:, None]
    directions = np.maximum(np.square(sigma) - noise, 0.0)
    root = np.broadcast_to(np.sqrt(noise), misfit.shape)
    given_up = misfit.size - widened(float(freedom))
    share = excess_deviation(
        (misfit / root).ravel(), (np.sqrt(directions) / root).ravel(), given_up
    )
    k = min(float(share) ** 2, 1.0)
    return eqx.tree_at(lambda d: d.motion.noise, dwells, k * np.asarray(motion.noise))
