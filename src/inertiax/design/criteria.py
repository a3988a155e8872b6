"""What is asked of a plan: D, A and I criteria, each as "effective information per position".

With the information M of n positions, in dimensionless parameters (biases in g),

    D:  (det M)^{1/p} / n              volume of the confidence ellipsoid
    A:  p / (n tr M⁻¹)                 mean variance of the parameters
    I:  p / (n tr M⁻¹ W)               mean variance of what the model predicts, W its average over the sphere

so that larger is better, twice as many of the same positions score the same, and a ratio of two scores
is the efficiency: how many times more dwells the worse plan needs.

**Reference:** Atkinson, Donev, Tobias, *Optimum Experimental Designs, with SAS*, Oxford 2007, ch. 10, 11.
"""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._typing import AnyArray
from ..numerics.linear_algebra import cholesky, spd_inverse


CRITERIA = ("D", "A", "I")


def log_score(
    criterion: str,
    information: Float[AnyArray, "p p"],
    count: int,
    weight: Float[AnyArray, "p p"] | None = None,
) -> Float[Array, ""]:
    """Logarithm of the score, differentiable in M; NaN where M is singular.

    Raises `ValueError` for a criterion that is not one of `CRITERIA`.
    """
    if criterion not in CRITERIA:
        raise ValueError(f"criterion {criterion!r}: it is one of {list(CRITERIA)}.")
    matrix = jnp.asarray(information)
    p = matrix.shape[0]
    if criterion == "D":
        pivots = jnp.diagonal(cholesky(matrix))
        return 2.0 * jnp.sum(jnp.log(pivots)) / p - jnp.log(float(count))
    inverse = spd_inverse(matrix)
    if criterion == "I":
        if weight is None:
            raise ValueError(
                "criterion 'I' needs `weight`: the mean of JᵀJ over what is predicted."
            )
        inverse = inverse @ jnp.asarray(weight)
    return jnp.log(p / (count * jnp.trace(inverse)))


def log_score_slope(
    criterion: str,
    information: Float[np.ndarray, "p p"],
    count: int,
    weight: Float[np.ndarray, "p p"] | None = None,
) -> tuple[float, Float[np.ndarray, "p p"]]:
    """`log_score` and its derivative by M, written out for the host: with W = E for A,

        D:  M⁻¹ / p              A, I:  M⁻¹ W M⁻¹ / tr(M⁻¹ W).

    Where M is singular: −∞ and zeros.
    """
    p = len(information)
    sign, log_det = np.linalg.slogdet(information)
    if not (sign > 0 and np.isfinite(log_det)):
        return -np.inf, np.zeros((p, p))
    inverse = np.linalg.inv(information)
    if criterion == "D":
        return log_det / p - np.log(count), inverse / p
    wanted = weight if criterion == "I" and weight is not None else np.eye(p)
    trace = np.trace(inverse @ wanted)
    return float(np.log(p / (count * trace))), inverse @ wanted @ inverse / trace


def score(
    criterion: str,
    information: Float[AnyArray, "p p"],
    count: int,
    weight: Float[AnyArray, "p p"] | None = None,
) -> float:
    """The score of a plan of `count` positions; 0 where its information is singular."""
    value = float(jnp.exp(log_score(criterion, information, count, weight)))
    return value if np.isfinite(value) else 0.0
