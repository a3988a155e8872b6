"""How well a linear least squares predicts each group of rows from all others."""

import numpy as np
from jaxtyping import Float


# Part of a group's rows that the others must tell; below it their prediction is anything, and rounding decides.
_TOLD = 1e-9


def log_left_out(
    design: Float[np.ndarray, "row unknown"], right: Float[np.ndarray, " row"], size: int
) -> float:
    r"""Mean logarithm of the size of the errors with which groups of `size` rows are predicted from all other rows.

    With the residuals $r_g$ of all rows' fit and the group's block $H_{gg}$ of the hat matrix, the error of the group
    predicted without it is

    $$e_g = (I - H_{gg})^{-1} r_g,$$

    and the result is the mean of $\tfrac12 \ln e_g^T e_g$. A mean of squares would be that of the one group that the
    others hardly tell; logarithms weigh groups alike, whatever the unit.

    **Arguments:** a design of full rank; rows of one variance, those of a group one after another, the last group
    of what is left. **Returns** a
    number, larger where the fit predicts worse.

    **Reference:** Cook and Weisberg, *Residuals and Influence in Regression*, 1982, eq. 2.2.7 and 3.2.6.

    Example:
    ```python
    worse = log_left_out(np.vander(t, 9), y, 1) > log_left_out(np.vander(t, 2), y, 1)
    ```
    """
    basis = np.linalg.qr(design)[0]
    # Rows of nothing fill the last group up.
    basis = np.concatenate([basis, np.zeros((-len(basis) % size, basis.shape[1]))])
    right = np.concatenate([right, np.zeros(-len(right) % size)])
    residual = (right - basis @ (basis.T @ right)).reshape(-1, size)
    groups = basis.reshape(len(residual), size, -1)
    share, axes = np.linalg.eigh(np.einsum("gik,gjk->gij", groups, groups))
    along = np.einsum("gij,gi->gj", axes, residual) / np.maximum(1.0 - share, _TOLD)
    square = np.sum(along**2, axis=1)
    return float(0.5 * np.mean(np.log(np.maximum(square, np.finfo(float).tiny))))
