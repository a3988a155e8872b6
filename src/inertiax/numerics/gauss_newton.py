"""Gauss-Newton on the host: least squares whose rows are linearised by one compiled function.

`numerics.least_squares` compiles the whole loop into one program, which pays for fleets and for derivatives of the
answer but takes ten seconds and more to compile. Here the passes run one by one.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import scipy.linalg
from jaxtyping import Float

from .linear_algebra import scaled_factor


TOLERANCE = 1e-7  # standard deviations, as in `least_squares.gauss_newton`
MAX_STEPS = 50  # closed-form starts take 3 to 8


class HostSolution(NamedTuple):
    """Where the iteration ended; NaN where some step's rows did not determine the unknowns."""

    unknowns: Float[np.ndarray, " unknown"]
    num_steps: int
    converged: bool


def solve_on_host(
    linearise: Callable[
        [Float[np.ndarray, " unknown"]],
        tuple[Float[np.ndarray, "row unknown"], Float[np.ndarray, " row"]],
    ],
    start: Float[np.ndarray, " unknown"],
) -> HostSolution:
    """Minimise ½ ‖r(x)‖² from `start`; never raises for numerical reasons.

    **Arguments:** `linearise(x)` returns the design J = ∂r/∂x and the whitened residual r at x.
    **Returns** the solution. It is converged where the last step of every unknown was below `TOLERANCE` in
    units of 1/‖J column‖, about one standard deviation each.
    """
    unknowns = start
    for taken in range(1, MAX_STEPS + 1):
        design, residual = linearise(unknowns)
        step = linear_step(design, residual)
        unknowns = unknowns + step
        if not np.all(np.isfinite(unknowns)):
            return HostSolution(unknowns, taken, False)
        if np.max(np.abs(step) * np.linalg.norm(design, axis=0)) < TOLERANCE:
            return HostSolution(unknowns, taken, True)
    return HostSolution(unknowns, MAX_STEPS, False)


def linear_step(
    design: Float[np.ndarray, "row unknown"], residual: Float[np.ndarray, " row"]
) -> Float[np.ndarray, " unknown"]:
    """−J⁺ r, the least squares of linearised rows; NaN where they do not determine the unknowns.

    By scaled normal equations. One correction with the same factor takes away their rounding, cond(J)² ε of
    the step.
    """
    missing = np.full(design.shape[1], np.nan)
    if len(residual) < design.shape[1]:
        return missing
    factor = scaled_factor(design.T @ design)
    if factor is None:
        return missing
    lower, scale = factor

    def solve(right: np.ndarray) -> np.ndarray:
        return scale * scipy.linalg.cho_solve((lower, True), scale * (design.T @ right))

    step = -solve(residual)
    return step - solve(design @ step + residual)
