"""Where a search has a log variance: at the standard deviation up to 1, at 1 and its logarithm beyond.

Towards none of a variance its logarithm has no end and the likelihood no slope, so that a search creeps; in the
standard deviation, relative to the chain's scale, it ends at a bound.
"""

import numpy as np
from jaxtyping import Float


def places(logs: Float[np.ndarray, "*any"]) -> Float[np.ndarray, "*any"]:
    """Places of log variances."""
    half = 0.5 * logs
    return np.where(half < 0.0, np.exp(np.minimum(half, 0.0)), 1.0 + half)


def log_variances(
    place: Float[np.ndarray, "*any"],
) -> tuple[Float[np.ndarray, "*any"], Float[np.ndarray, "*any"]]:
    """Log variances at places above zero, and their derivative."""
    low = np.minimum(place, 1.0)
    return np.where(place < 1.0, 2.0 * np.log(low), 2.0 * (place - 1.0)), 2.0 / low
