"""A matrix as a triangular one times a rotation: how tools with triangular matrices write a full one."""

import numpy as np
from jaxtyping import Float


def lower_times_rotation(
    matrix: Float[np.ndarray, "3 3"],
) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, "3 3"]]:
    """M = L Q with L lower triangular, positive on the diagonal, and Q a rotation.

    Raises `ValueError` for a matrix that turns the handedness round (a negative determinant).
    """
    if np.linalg.det(matrix) <= 0:
        raise ValueError(
            "a triad's matrix has a determinant that is not positive: an axis is reversed, which "
            "this format cannot say; turn the column round on reading instead."
        )
    q, r = np.linalg.qr(matrix.T)
    signs = np.sign(np.diag(r))
    lower, rotation = (r.T * signs), (q * signs).T
    # A matrix that is lower triangular already comes back to the last digit.
    if np.array_equal(np.tril(matrix), matrix) and np.all(np.diag(matrix) > 0):
        return matrix.copy(), np.eye(3)
    return np.tril(lower), rotation


def upper_times_rotation(
    matrix: Float[np.ndarray, "3 3"],
) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, "3 3"]]:
    """M = U Q with U upper triangular, positive on the diagonal, and Q a rotation."""
    # Reversing the order of rows and columns exchanges upper and lower.
    lower, rotation = lower_times_rotation(matrix[::-1, ::-1])
    return lower[::-1, ::-1].copy(), rotation[::-1, ::-1].copy()


def quaternion(rotation: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "4"]:
    """Unit quaternion (w, x, y, z) of a rotation matrix that is near the identity or not, w >= 0."""
    from scipy.spatial.transform import Rotation

    x, y, z, w = Rotation.from_matrix(rotation).as_quat(canonical=True)
    return np.array([w, x, y, z])
