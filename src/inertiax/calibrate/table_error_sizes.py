"""How large a fit takes the table's common errors for, in standard deviations as the station states them.

With the signatures W of the errors (`procedure.shared_errors`), rows r at the generalised least squares' answer and
their covariance V, which holds W Wᵀ, the errors' best linear prediction beside it is

    θ = Wᵀ V⁻¹ r

(Henderson, Biometrics 31, 1975). A size that the statement allows is no missing physics; one far beyond it is.
"""

import numpy as np
from jaxtyping import Float

from ..estimators import AbstractEstimator
from ..physics.temperature import Curve
from ..procedure.single_device import Problem
from ..reduction.dwells import Dwells


# Standard deviations beyond which a statement does not hold; one in a thousand is, of two angles and of one.
LEVEL_HOLDS, ORTHOGONALITY_HOLDS = 3.7, 3.3


def table_error_sizes(
    estimator: AbstractEstimator, curve: Curve, dwells: Dwells
) -> Float[np.ndarray, "3"] | None:
    """θ of the module for the level's two angles and the axes' right angle; `None` where the rows do not have them."""
    problem = Problem(estimator, curve.basis, dwells)
    if problem.shared is None or problem.shared.table is None:
        return None
    design, residual = problem.rows(np.asarray(curve.coefficients))
    common = np.asarray(problem.shared.table.whitened)[..., :3]
    signatures = problem.decorrelated(common.reshape(len(residual), 3))
    # Where both triads were estimated together, the rows are not those of a least squares of their own.
    span = np.linalg.qr(design / np.maximum(np.linalg.norm(design, axis=0), 1e-300))[0]
    return signatures.T @ (residual - span @ (span.T @ residual))


def within_statement(sizes: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3"]:
    """The sizes that the station's statement allows; zero for the others."""
    made = sizes.copy()
    if np.hypot(sizes[0], sizes[1]) > LEVEL_HOLDS:
        made[:2] = 0.0
    if abs(sizes[2]) > ORTHOGONALITY_HOLDS:
        made[2] = 0.0
    return made
