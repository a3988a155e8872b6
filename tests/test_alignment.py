"""Misalignment of the triads against SciPy's polar decomposition."""

import numpy as np
import pytest
from scipy.linalg import polar
from scipy.spatial.transform import Rotation

from inertiax.physics.alignment import inter_triad


def test_rotation_and_symmetric_part_are_scipys():
    rng = np.random.default_rng(0)
    for size in (1e-5, 1e-3, 0.05, 0.3):
        matrix = size * rng.normal(size=(3, 3))
        found = inter_triad(matrix)
        turn, symmetric = polar(np.eye(3) + matrix, side="left")
        expected = Rotation.from_matrix(turn).as_rotvec()
        np.testing.assert_allclose(found.rotation, expected, rtol=1e-8, atol=1e-15)
        np.testing.assert_allclose(found.symmetric, symmetric - np.eye(3), atol=1e-14)


@pytest.mark.slow
def test_covariance_of_a_small_rotation_is_that_of_the_skew_part():
    # ρ = half the differences across the diagonal: with unit variances, half of one.
    found = inter_triad(np.zeros((3, 3)), np.eye(9))
    np.testing.assert_allclose(found.covariance, 0.5 * np.eye(3), atol=1e-12)


@pytest.mark.parametrize(
    "flip", [np.diag([-2.0, 0.0, 0.0]), np.array([[-1, 1, 0], [1, -1, 0], [0, 0, 0.0]])]
)
def test_reflections_are_refused(flip):
    with pytest.raises(ValueError, match="wrong sign or swapped"):
        inter_triad(flip)
