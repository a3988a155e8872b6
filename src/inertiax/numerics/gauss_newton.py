"""Gauss-Newton on the host, damped where it has to be: least squares whose rows are linearised by one function.

`numerics.least_squares` compiles the whole loop into one program, which pays for fleets and for derivatives of the
answer but takes ten seconds and more to compile. Here the passes run one by one.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.linalg import get_lapack_funcs

from .linear_algebra import scaled_factor


TOLERANCE = 1e-7  # standard deviations, as in `least_squares.gauss_newton`
MAX_STEPS = 50  # closed-form starts take 3 to 8
_FIRST_DAMPING = (
    1e-3  # of each column's own square; what Levenberg and Marquardt's descendants start from
)
# From which on it is left away. Along an unknown that the rows hardly tell a step is as short as the damping is strong
# against that unknown's own part of a column's square, which may be a millionth: back at once to none, and to the first
# again where that overshoots, such a valley is crept along.
_LEAST_DAMPING = 1e-9
_LAST_DAMPING = 1e8  # beyond, a step is shorter than rounding
(_SOLVE,) = get_lapack_funcs(("potrs",), dtype=np.float64)
_WORSE = 1e-9  # relative: a cost that rounding alone makes larger


class HostSolution(NamedTuple):
    """Where the iteration ended; where not converged, the best point that was seen."""

    unknowns: Float[np.ndarray, " unknown"]
    num_steps: int
    converged: bool


Linearise = Callable[
    [Float[np.ndarray, " unknown"]],
    tuple[Float[np.ndarray, "row unknown"], Float[np.ndarray, " row"]],
]


def solve_on_host(linearise: Linearise, start: Float[np.ndarray, " unknown"]) -> HostSolution:
    """Minimise ½ ‖r(x)‖² from `start`; never raises for numerical reasons.

    Steps are Gauss and Newton's as long as they lower the cost. Where one does not, as with rests that hardly
    determine some unknown, it is taken back and damped after Levenberg and Marquardt.

    **Arguments:** `linearise(x)` returns the design J = ∂r/∂x and the whitened residual r at x.
    **Returns** the solution. It is converged where the undamped step of every unknown was below `TOLERANCE` in
    units of 1/‖J column‖, about one standard deviation each.
    """
    unknowns, damping = start, 0.0
    design, residual = linearise(unknowns)
    cost = float(residual @ residual)
    for taken in range(1, MAX_STEPS + 1):
        full = linear_step(design, residual)
        if _small(full, design):
            return HostSolution(unknowns + full, taken, True)
        while True:
            step = full if damping == 0.0 else linear_step(design, residual, damping)
            new = unknowns + step
            next_design, next_residual = linearise(new) if _finite(new) else (design, residual)
            next_cost = float(next_residual @ next_residual) if _finite(new) else np.inf
            if next_cost <= cost * (1.0 + _WORSE):
                break
            damping = 10.0 * damping if damping > 0.0 else _FIRST_DAMPING
            if damping > _LAST_DAMPING:
                return HostSolution(unknowns, taken, False)
        unknowns, design, residual, cost = new, next_design, next_residual, next_cost
        damping = 0.1 * damping if damping > _LEAST_DAMPING else 0.0
    return HostSolution(unknowns, MAX_STEPS, False)


def _small(step: Float[np.ndarray, " unknown"], design: Float[np.ndarray, "row unknown"]) -> bool:
    return bool(np.max(np.abs(step) * np.linalg.norm(design, axis=0)) < TOLERANCE)


def _finite(values: Float[np.ndarray, " unknown"]) -> bool:
    return bool(np.all(np.isfinite(values)))


def linear_step(
    design: Float[np.ndarray, "row unknown"],
    residual: Float[np.ndarray, " row"],
    damping: float = 0.0,
) -> Float[np.ndarray, " unknown"]:
    """−J⁺ r, the least squares of linearised rows; NaN where they do not determine the unknowns.

    With a `damping` λ, −(JᵀJ + λ diag JᵀJ)⁻¹ Jᵀ r, which is always determined. By scaled normal equations. One
    correction with the same factor takes away their rounding, cond(J)² ε of the step.
    """
    missing = np.full(design.shape[1], np.nan)
    if damping > 0.0:
        root = np.sqrt(damping) * np.maximum(np.linalg.norm(design, axis=0), 1e-300)
        design = np.concatenate([design, np.diag(root)])
        residual = np.concatenate([residual, np.zeros(len(root))])
    if len(residual) < design.shape[1]:
        return missing
    factor = scaled_factor(design.T @ design)
    if factor is None:
        return missing
    lower, scale = factor

    def solve(right: np.ndarray) -> np.ndarray:
        return scale * _SOLVE(lower, scale * (design.T @ right), lower=1)[0]

    step = -solve(residual)
    return step - solve(design @ step + residual)
