"""Vectors on the host against SciPy's rotations and NumPy's products."""

import numpy as np
from scipy.spatial.transform import Rotation

from inertiax.physics.vectors import angle_between, axes_across, cross_matrix, unit_vector


def test_products_angles_and_axes_of_many_vectors_at_once():
    rng = np.random.default_rng(4)
    v, w = rng.standard_normal((2, 5, 7, 3))
    np.testing.assert_allclose(np.einsum("...ij,...j->...i", cross_matrix(v), w), np.cross(v, w))
    u = unit_vector(v)
    frame = np.concatenate([axes_across(u), u[..., None, :]], axis=-2)
    np.testing.assert_allclose(
        frame @ np.swapaxes(frame, -1, -2), np.broadcast_to(np.eye(3), (5, 7, 3, 3)), atol=1e-15
    )
    assert not unit_vector(np.zeros(3)).any()
    # An arc cosine would lose half of the digits of the first, and of the last.
    for angle in (1e-9, 0.3, 2.0, np.pi - 1e-6):
        turned = Rotation.from_rotvec(angle * axes_across(u)[:, 0, 0]).apply(u[:, 0])
        np.testing.assert_allclose(
            angle_between(u[:, 0], 3.0 * turned), angle, rtol=0.0, atol=1e-15 + 1e-9 * angle
        )
