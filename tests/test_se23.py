"""SE₂(3) against SciPy's matrix exponential, hand values and derivatives by finite differences."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.linalg

from inertiax.navigation import se23


# Angles below and above the change from series to closed forms, at zero, and near half a turn.
ANGLES = [0.0, 1e-9, 1e-3, 0.5, 0.999, 1.001, 2.0, 3.1]
EXP, LOG = jax.jit(se23.exp), jax.jit(se23.log)


def _vector(angle, seed=0):
    rng = np.random.default_rng(seed)
    axis = rng.normal(size=3)
    return np.concatenate([angle * axis / np.linalg.norm(axis), rng.normal(size=6) * 3.0])


def _cross(v):
    return np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])


def _algebra(xi):
    """The 5 × 5 matrix whose exponential the group's is, written from the definition."""
    top = np.column_stack([_cross(xi[:3]), xi[3:6], xi[6:]])
    return np.vstack([top, np.zeros((2, 5))])


@pytest.mark.parametrize("angle", ANGLES)
def test_exponential_is_scipys(angle):
    xi = _vector(angle)
    np.testing.assert_allclose(EXP(xi).matrix(), scipy.linalg.expm(_algebra(xi)), atol=2e-14)


@pytest.mark.parametrize("angle", ANGLES)
def test_logarithm_inverts_the_exponential(angle):
    xi = _vector(angle, 1)
    np.testing.assert_allclose(LOG(EXP(xi)), xi, atol=1e-12)


def test_quarter_turn_by_hand():
    # J(φ) of a quarter turn about z takes e_x to (2/π)(1, 1, 0): the mean of a turning unit vector.
    pose = EXP(np.array([0.0, 0.0, np.pi / 2, 1.0, 0.0, 0.0, 0.0, 0.0, 2.0]))
    np.testing.assert_allclose(pose.attitude, [[0, -1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-15)
    np.testing.assert_allclose(pose.velocity, [2 / np.pi, 2 / np.pi, 0.0], atol=1e-15)
    np.testing.assert_allclose(pose.position, [0.0, 0.0, 2.0], atol=1e-15)


def test_product_and_inverse_are_the_matrices():
    a, b = EXP(_vector(0.7, 2)), EXP(_vector(1.9, 3))
    np.testing.assert_allclose(
        se23.compose(a, b).matrix(), np.asarray(a.matrix()) @ np.asarray(b.matrix()), atol=1e-14
    )
    np.testing.assert_allclose(
        se23.inverse(a).matrix(), np.linalg.inv(np.asarray(a.matrix())), atol=1e-13
    )


@pytest.mark.parametrize("angle", [0.0, 0.8, 2.5])
def test_adjoint_conjugates(angle):
    pose, xi = EXP(_vector(angle, 4)), _vector(0.3, 5)
    x = np.asarray(pose.matrix())
    expected = x @ scipy.linalg.expm(_algebra(xi)) @ np.linalg.inv(x)
    moved = np.asarray(se23.adjoint(pose)) @ xi
    np.testing.assert_allclose(scipy.linalg.expm(_algebra(moved)), expected, atol=1e-11)


def _numeric_left_jacobian(xi):
    """From SciPy alone: (expm(ξ + δ) expm(ξ)⁻¹ − E)/δ by central differences."""
    back = scipy.linalg.expm(-_algebra(xi))
    columns, h = [], 1e-5
    for k in range(9):
        d = np.eye(9)[k] * h
        up, down = (scipy.linalg.expm(_algebra(xi + s * d)) @ back for s in (1.0, -1.0))
        m = (up - down) / (2.0 * h)
        columns.append(np.concatenate([[m[2, 1], m[0, 2], m[1, 0]], m[:3, 3], m[:3, 4]]))
    return np.array(columns).T


@pytest.mark.parametrize("angle", ANGLES)
def test_jacobians_against_finite_differences(angle):
    xi = _vector(angle, 6)
    left = np.asarray(se23.left_jacobian(xi))
    # Central differences with a step of 1e-5 err by 1e-10 times third derivatives (up to 30 here).
    np.testing.assert_allclose(left, _numeric_left_jacobian(xi), atol=5e-9)
    # J_r(ξ) = J_l(−ξ), and J_l = Ad J_r: the filter's reset takes the one for the other.
    right = np.asarray(se23.left_jacobian(-jnp.asarray(xi)))
    np.testing.assert_allclose(np.asarray(se23.adjoint(EXP(xi))) @ right, left, atol=1e-12)


@pytest.mark.slow
def test_gradients_are_finite_at_zero_and_agree_with_the_jacobian():
    zero = jnp.zeros(9)
    derivative = jax.jacfwd(lambda x: se23.exp(x).matrix())(zero)
    assert np.all(np.isfinite(derivative))
    np.testing.assert_allclose(derivative[:3, 3, 3:6], np.eye(3), atol=1e-15)
    back = jax.jacrev(lambda x: se23.log(se23.exp(x)))(zero)
    np.testing.assert_allclose(back, np.eye(9), atol=1e-14)
    second = jax.jacfwd(lambda x: se23.left_jacobian(x))(zero)
    # To first order J_l = E + ½ ad: ∂J/∂φ_x of the rotation block is half the cross product by e_x.
    np.testing.assert_allclose(second[:3, :3, 0], 0.5 * _cross([1.0, 0, 0]), atol=1e-15)


@pytest.mark.slow
@pytest.mark.parametrize("angle", [1e-4, 0.05, 0.9, 1.1])
def test_single_precision_keeps_its_digits(angle):
    xi = _vector(angle, 7)
    low = se23.left_jacobian(jnp.asarray(xi, jnp.float32))
    assert low.dtype == jnp.float32
    np.testing.assert_allclose(low, se23.left_jacobian(xi), atol=3e-6)
