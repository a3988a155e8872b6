"""Least squares of a few unknowns of which none is negative."""

from itertools import combinations

import numpy as np
from jaxtyping import Float


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
