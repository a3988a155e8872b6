"""Rotations against SciPy, and their gradients at zero."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.test_util import check_grads
from scipy.spatial.transform import Rotation

from inertiax.physics import rotation


def vectors(length):
    v = np.random.default_rng(3).normal(size=(20, 3))
    return length * v / np.linalg.norm(v, axis=1, keepdims=True)


# Both sides of the series' switch (1e-2 rad) and up to nearly half a turn.
ANGLES = [0.0, 1e-12, 1e-4, 0.0099, 0.0101, 0.5, 2.0, 3.1, np.pi - 1e-6]


@pytest.mark.parametrize("angle", ANGLES)
def test_exp_is_scipys_rotation(angle):
    v = vectors(angle)
    expected = Rotation.from_rotvec(v).as_matrix()
    # Three roundings of a unit matrix.
    np.testing.assert_allclose(jax.vmap(rotation.exp)(v), expected, atol=7e-16, rtol=0)


@pytest.mark.parametrize("angle", ANGLES)
def test_log_undoes_exp(angle):
    v = vectors(angle)
    # A few roundings of a unit matrix.
    ours = jax.vmap(lambda x: rotation.log(rotation.exp(x)))(v)
    np.testing.assert_allclose(ours, v, atol=2e-15, rtol=0)


@pytest.mark.slow
def test_log_is_scipys_rotation_vector():
    matrices = Rotation.from_rotvec(np.random.default_rng(1).normal(size=(50, 3))).as_matrix()
    expected = Rotation.from_matrix(matrices).as_rotvec()
    np.testing.assert_allclose(jax.vmap(rotation.log)(matrices), expected, atol=1e-14)


@pytest.mark.parametrize("axis", np.eye(3))
def test_log_of_half_a_turn_is_pi_long(axis):
    half = Rotation.from_rotvec(np.pi * axis).as_matrix()
    np.testing.assert_allclose(np.abs(rotation.log(half)), np.pi * axis, atol=1e-14)


@pytest.mark.slow
@pytest.mark.parametrize("angle", [0.0, 1e-9, 0.0099, 0.0101, 1.0])
def test_gradients_are_finite_and_right_also_at_zero(angle):
    v = jnp.asarray(vectors(angle)[0])
    # Central differences with step 1e-5: truncation 1e-10, rounding 1e-11.
    check_grads(rotation.exp, (v,), order=1, modes=["fwd", "rev"], eps=1e-5, atol=1e-8, rtol=1e-8)
    round_trip = lambda x: rotation.log(rotation.exp(x) @ rotation.exp(0.3 * x))
    check_grads(round_trip, (v,), order=1, modes=["fwd", "rev"], eps=1e-5, atol=1e-8, rtol=1e-8)


@pytest.mark.slow
def test_the_derivative_at_zero_is_the_cross_product():
    # d exp(v)/dv_i at 0 is skew(e_i), and log's inverse of it.
    derivative = jax.jacfwd(rotation.exp)(jnp.zeros(3))
    for i in range(3):
        np.testing.assert_allclose(derivative[..., i], rotation.skew(jnp.eye(3)[i]))
    back = jax.jacfwd(rotation.log)(jnp.eye(3))
    # ½ (m₂₁ − m₁₂) and so on.
    expected = np.zeros((3, 3, 3))
    for i, j, k in [(0, 2, 1), (1, 0, 2), (2, 1, 0)]:
        expected[i, j, k], expected[i, k, j] = 0.5, -0.5
    np.testing.assert_allclose(back, expected, atol=1e-15)


@pytest.mark.slow
def test_second_derivatives_are_finite_at_zero():
    second = jax.hessian(lambda v: rotation.exp(v)[0, 0])(jnp.zeros(3))
    # R₀₀ = 1 − (v₁² + v₂²)/2 + …
    np.testing.assert_allclose(second, np.diag([0.0, -1.0, -1.0]), atol=1e-15)


def test_about_turns_by_the_right_hand_rule():
    turned = rotation.about(np.array([0.0, 0.0, 1.0]), np.pi / 2) @ jnp.array([1.0, 0.0, 0.0])
    np.testing.assert_allclose(turned, [0.0, 1.0, 0.0], atol=3e-16)


def test_skew_is_the_cross_product_and_unskew_its_inverse():
    a, b = np.random.default_rng(0).normal(size=(2, 3))
    np.testing.assert_allclose(rotation.skew(a) @ b, np.cross(a, b), rtol=1e-14)
    np.testing.assert_allclose(rotation.unskew(rotation.skew(a)), a)
