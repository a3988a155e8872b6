"""Coefficients of one effect that the data tell very unequally: those hardly told are held to the size of the others.

The coefficients of one effect, such as the three distances of a lever arm, have one unit and one cause. Where a plan
tells one of them a thousand times better than another, the other's estimate is noise, and applied to motions that the
plan lacked it does harm. All are taken as drawn from one normal distribution of unknown standard deviation s:

    c | ĉ  =  s² (C + s² I)⁻¹ ĉ,    covariance  C − C (C + s² I)⁻¹ C.

That few coefficients tell s poorly would make intervals too short. So s is not its likeliest value but the largest that
the estimates allow: where the marginal log likelihood has dropped by 1.92, the 95 % point of chi² halved. What is told
well stays as it is.

**Reference:** Efron and Morris, J. Am. Stat. Assoc. 68 (1973) 117, for the estimator.
"""

import numpy as np
from jaxtyping import Float


DROP = 1.9207  # half the 95 % point of chi² with one degree of freedom
UNSEEN = 1e-12  # of the largest variance: a direction without variance is one that the data do not tell at all
WIDE = 1e4  # times the largest estimate or deviation: no size is sought beyond it


def held_to_common_size(
    values: Float[np.ndarray, " coefficient"],
    covariance: Float[np.ndarray, "coefficient coefficient"],
) -> tuple[Float[np.ndarray, " coefficient"], Float[np.ndarray, "coefficient coefficient"]]:
    """Estimates and covariance of one effect's coefficients after the equation above; one alone stays as it is."""
    if len(values) < 2:
        return values, covariance
    variance, turn = np.linalg.eigh(covariance)
    told = variance > UNSEEN * variance[-1]
    along = turn.T @ values
    size = _largest_size(along[told], variance[told])
    kept = np.where(told, size**2 / (variance + size**2), 1.0)
    return turn @ (kept * along), (turn * (kept * np.where(told, variance, 0.0))) @ turn.T


def _largest_size(along: np.ndarray, variance: np.ndarray) -> float:
    """The largest s whose marginal log likelihood is within `DROP` of the maximum."""

    def loss(log_size: float) -> float:
        total = variance + np.exp(2.0 * log_size)
        return 0.5 * float(np.sum(np.log(total) + along**2 / total))

    scale = np.hypot(along, np.sqrt(variance))
    low, high = np.log(scale.min() / WIDE), np.log(scale.max() * WIDE)
    grid = np.linspace(low, high, 400)
    losses = np.array([loss(x) for x in grid])
    best = int(np.argmin(losses))
    limit = losses[best] + DROP
    from scipy.optimize import root_scalar  # slow to import, and seldom needed

    edge = root_scalar(lambda x: loss(x) - limit, bracket=(grid[best], high))
    return float(np.exp(edge.root))
