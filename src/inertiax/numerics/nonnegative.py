"""Least squares of a few unknowns of which none is negative."""

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from jaxtyping import Float


# Part of a column's square that must lie outside the others: rounding leaves less.
_DISTINCT = 1e-24


def nonnegative_least_squares(
    design: Float[np.ndarray, "row unknown"], target: Float[np.ndarray, " row"]
) -> tuple[Float[np.ndarray, " unknown"], float]:
    """The x ≥ 0 that minimises ‖A x − b‖², and that square.

    Where none of the plain least squares is negative, it is the answer; else the best of those of fewer columns that
    have no negative one, since the answer is the plain least squares of its positive unknowns. Meant for four or five
    unknowns (15 or 31 sets of columns), for which importing `scipy.optimize.nnls` takes far longer.

    **Reference:** Lawson and Hanson, *Solving Least Squares Problems* (1974), ch. 23.

    ```python
    import numpy as np
    from inertiax.numerics.nonnegative import nonnegative_least_squares

    shares, left = nonnegative_least_squares(np.eye(2), np.array([3.0, -1.0]))
    assert np.allclose(shares, [3.0, 0.0]) and np.isclose(left, 1.0)
    ```
    """
    count = design.shape[1]
    best, least = np.zeros(count), float(target @ target)
    for size in range(count, 0, -1):
        for columns in map(list, combinations(range(count), size)):
            some = np.linalg.lstsq(design[:, columns], target)[0]
            if np.any(some < 0.0):
                continue
            left = float(np.sum(np.square(design[:, columns] @ some - target)))
            if left < least:
                best, least = np.zeros(count), left
                best[columns] = some
            if size == count:
                return best, least
    return best, least


def squares_with_one_more(
    design: Float[np.ndarray, "row column"],
    chosen: Sequence[int],
    target: Float[np.ndarray, " row"],
) -> Float[np.ndarray, " column"]:
    r"""For each column a of A the least ‖A_chosen x + a y − b‖² with x ≥ 0 and y > 0; ∞ where no such minimum is.

    Over each set of the columns chosen, with Q R = A_set, all further columns at once:

    $$y = \frac{a_\perp^T b}{a_\perp^T a_\perp}, \quad x = R^{-1} Q^T (b - a y), \quad
    \|b_\perp\|^2 - y^2 a_\perp^T a_\perp,$$

    ⊥ being what lies outside of the set. The least of these whose x and y are not negative is that of
    `nonnegative_least_squares`.

    ```python
    import numpy as np
    from inertiax.numerics.nonnegative import squares_with_one_more

    left = squares_with_one_more(np.eye(3), [0], np.array([1.0, 2.0, -2.0]))
    assert np.allclose(left[1], 4.0) and left[2] == np.inf    # the third would be negative
    ```
    """
    least = np.full(design.shape[1], np.inf)
    whole = np.sum(np.square(design), axis=0)
    for size in range(len(chosen) + 1):
        for columns in map(list, combinations(chosen, size)):
            span, triangle = np.linalg.qr(design[:, columns])
            along, known = span.T @ design, span.T @ target
            beside, left = design - span @ along, target - span @ known
            square = np.sum(np.square(beside), axis=0)
            new = square > _DISTINCT * whole
            share = (beside.T @ left) / np.where(new, square, np.inf)
            others = np.linalg.lstsq(triangle, known[:, None] - along * share)[0]
            inside = new & (share > 0.0) & np.all(others >= 0.0, axis=0)
            rest = np.maximum(left @ left - np.square(share) * square, 0.0)
            least = np.where(inside, np.minimum(least, rest), least)
    return least
