"""A smooth function of a few variables in a box, minimised with a curvature that is carried from like problems.

Where many functions that differ little are minimised one after the other (likelihoods of variances beside one candidate
after the next), the curvature found for one serves the next: a few evaluations settle it. SciPy's bounded methods begin
each time from none.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float


LONGEST = 3.0  # largest change of a variable in one step; of a log variance a factor of 20
FIRST = 0.5  # the same of the first step where no curvature is known
SUFFICIENT = 1e-4  # share of the predicted decrease that a step must reach (Armijo)
LENGTHS = 12  # of a step that are tried, each 0.3 of the one before


class Minimum(NamedTuple):
    """Where the search ended, with the curvature (an approximate Hessian) there."""

    x: Float[np.ndarray, " variable"]
    value: float
    curvature: Float[np.ndarray, "variable variable"]
    evaluations: int


def minimise(
    objective: Callable[
        [Float[np.ndarray, " variable"]], tuple[float, Float[np.ndarray, " variable"]]
    ],
    start: Float[np.ndarray, " variable"],
    bounds: Sequence[tuple[float, float]] | Float[np.ndarray, "variable 2"],
    *,
    curvature: Float[np.ndarray, "variable variable"] | None = None,
    tolerance: float,
    max_steps: int,
) -> Minimum:
    """A local minimum within `bounds` by projected BFGS steps.

    **Arguments:** `objective(x)` returns value and gradient; `curvature` is a positive definite guess of the Hessian.
    It ends where the next step promises to lower the value by less than `tolerance`, where the last one did not lower
    it by more, or after `max_steps`.

    **Reference:** Nocedal and Wright, *Numerical Optimization*, 2nd ed., procedure 18.2 (damped update) and 16.7
    (projected steps).
    """
    low, high = np.transpose(bounds)
    x = np.clip(np.asarray(start, float), low, high)
    value, slope = objective(x)
    evaluations, known = 1, curvature is not None
    b = np.eye(len(x)) if curvature is None else curvature.copy()
    for _ in range(max_steps):
        step = _direction(x, slope, b, low, high)
        if -0.5 * float(slope @ (np.clip(x + step, low, high) - x)) < tolerance:
            break
        step *= min(1.0, (LONGEST if known else FIRST) / np.max(np.abs(step)))
        for length in 0.3 ** np.arange(LENGTHS):
            found = np.clip(x + length * step, low, high)
            trial, its_slope = objective(found)
            evaluations += 1
            if trial <= value + SUFFICIENT * float(slope @ (found - x)):
                break
        else:  # rounding: no lower value is to be had along this direction
            break
        moved, turned = found - x, its_slope - slope
        if not known and moved @ turned > 0.0:
            b *= float(turned @ turned) / float(moved @ turned)
        b, known = _updated(b, moved, turned), True
        gained, x, value, slope = value - trial, found, trial, its_slope
        if gained <= tolerance:
            break
    return Minimum(x, value, b, evaluations)


def _direction(
    x: np.ndarray, slope: np.ndarray, b: np.ndarray, low: np.ndarray, high: np.ndarray
) -> np.ndarray:
    """The Newton step of the variables that are not held by a bound."""
    held = ((x <= low) & (slope > 0.0)) | ((x >= high) & (slope < 0.0))
    free = np.flatnonzero(~held)
    step = np.zeros_like(x)
    step[free] = -np.linalg.solve(b[np.ix_(free, free)], slope[free])
    return step


def _updated(b: np.ndarray, moved: np.ndarray, turned: np.ndarray) -> np.ndarray:
    """BFGS update, damped so that it stays positive definite."""
    by = b @ moved
    square, product = float(moved @ by), float(moved @ turned)
    if square <= 0.0:
        return b
    if product < 0.2 * square:
        share = 0.8 * square / (square - product)
        turned = share * turned + (1.0 - share) * by
        product = float(moved @ turned)
    return b - np.outer(by, by) / square + np.outer(turned, turned) / product
