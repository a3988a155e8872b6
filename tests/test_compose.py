"""Equation (6): the group axioms, and what its two misprints do."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from inertiax.physics.composition import (
    as_affine,
    compose_accel,
    compose_accel_as_printed,
    compose_gyro,
    compose_gyro_as_printed,
    compose_imu,
    inverse_accel,
    inverse_gyro,
)
from inertiax.physics.error_model import (
    AccelerometerErrors,
    compensate_accel,
    compensate_gyro,
    distort_accel,
    distort_gyro,
    GyroErrors,
)


GRAVITY = 9.815179
SEEDS = range(8)
# Round-off of a few 3 x 3 products, relative to numbers of order 1.
TOLERANCE = dict(rtol=1e-12, atol=1e-15)


def _accel(key):
    bias, matrix = jax.random.split(key)
    # 30 mg and a few mrad: a pendulous accelerometer triad before calibration.
    return AccelerometerErrors(
        0.3 * jax.random.normal(bias, (3,)), jnp.tril(5e-3 * jax.random.normal(matrix, (3, 3)))
    )


def _gyro(key):
    bias, matrix, d = jax.random.split(key, 3)
    return GyroErrors(
        1e-4 * jax.random.normal(bias, (3,)),
        5e-3 * jax.random.normal(matrix, (3, 3)),
        1e-4 * jax.random.normal(d, (3, 3)),
    )


def _assert_same(left, right):
    for a, b in zip(jax.tree.leaves(left), jax.tree.leaves(right), strict=True):
        np.testing.assert_allclose(a, b, **TOLERANCE)


GROUPS = {
    "accel": (_accel, compose_accel, inverse_accel, AccelerometerErrors.zero),
    "gyro": (_gyro, compose_gyro, inverse_gyro, GyroErrors.zero),
}


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("group", GROUPS)
def test_group_axioms(group, seed):
    draw, compose, inverse, zero = GROUPS[group]
    a, b, c = (draw(k) for k in jax.random.split(jax.random.PRNGKey(seed), 3))
    _assert_same(compose(compose(a, b), c), compose(a, compose(b, c)))
    _assert_same(compose(a, zero()), a)
    _assert_same(compose(zero(), a), a)
    _assert_same(compose(a, inverse(a)), zero())
    _assert_same(compose(inverse(a), a), zero())


@pytest.mark.parametrize("seed", SEEDS)
def test_compensating_twice_is_compensating_with_the_composition(seed):
    keys = jax.random.split(jax.random.PRNGKey(seed), 6)
    a0, a1, g0, g1 = _accel(keys[0]), _accel(keys[1]), _gyro(keys[2]), _gyro(keys[3])
    output = 10.0 * jax.random.normal(keys[4], (3,))
    twice = compensate_accel(a1, compensate_accel(a0, output))
    once = compensate_accel(compose_accel(a0, a1), output)
    np.testing.assert_allclose(once, twice, rtol=1e-12)
    rate, force = jax.random.normal(keys[5], (3,)), twice
    twice = compensate_gyro(g1, compensate_gyro(g0, rate, force, GRAVITY), force, GRAVITY)
    once = compensate_gyro(compose_gyro(g0, g1), rate, force, GRAVITY)
    np.testing.assert_allclose(once, twice, rtol=1e-12)


@pytest.mark.parametrize("seed", SEEDS)
def test_both_triads_compose_as_one_affine_map(seed):
    keys = jax.random.split(jax.random.PRNGKey(seed), 6)
    first, second = (_accel(keys[0]), _gyro(keys[1])), (_accel(keys[2]), _gyro(keys[3]))
    force, rate = 10.0 * jax.random.normal(keys[4], (3,)), jax.random.normal(keys[5], (3,))
    # True -> seen by stage 1 -> seen by stage 0, each stage with its own force in the D term.
    between = distort_accel(second[0], force)
    rate_between = distort_gyro(second[1], rate, force, GRAVITY)
    expected = distort_gyro(first[1], rate_between, between, GRAVITY)
    accel, gyro = compose_imu(first, second, GRAVITY)
    np.testing.assert_allclose(distort_accel(accel, force), distort_accel(first[0], between), 1e-12)
    np.testing.assert_allclose(distort_gyro(gyro, rate, force, GRAVITY), expected, rtol=1e-12)


def test_composition_is_numpys_product_of_homogeneous_matrices(getkey):
    a, b = _accel(getkey()), _accel(getkey())
    expected = np.asarray(as_affine(a.bias, a.matrix)) @ np.asarray(as_affine(b.bias, b.matrix))
    both = compose_accel(a, b)
    np.testing.assert_allclose(as_affine(both.bias, both.matrix), expected, **TOLERANCE)


def test_printed_bias_line_is_off_by_twice_the_matrix(getkey):
    a, b = _accel(getkey()), _accel(getkey())
    off = np.asarray(compose_accel_as_printed(a, b).bias - compose_accel(a, b).bias)
    m0 = np.eye(3) + np.asarray(a.matrix)
    np.testing.assert_allclose(off, (np.linalg.inv(m0) - m0) @ np.asarray(b.bias), rtol=1e-9)
    first_order = -2.0 * np.asarray(a.matrix) @ np.asarray(b.bias)
    # What is left is of second order in the matrix, here 5e-3.
    assert np.max(np.abs(off - first_order)) < 0.05 * np.max(np.abs(first_order))
    gyro_a, gyro_b = _gyro(getkey()), _gyro(getkey())
    printed, exact = compose_gyro_as_printed(gyro_a, gyro_b), compose_gyro(gyro_a, gyro_b)
    np.testing.assert_array_equal(printed.g_sensitivity, exact.g_sensitivity)
    assert np.max(np.abs(printed.bias - exact.bias)) > 1e-8


@pytest.mark.slow
@pytest.mark.parametrize("compose", [compose_accel, compose_accel_as_printed])
def test_exact_and_printed_composition_reach_the_same_fixed_point(compose, getkey):
    # Stage k+1 sees what stage k left over, halved: an estimator that takes half of what remains.
    truth, estimate = _accel(getkey()), AccelerometerErrors.zero()
    for _ in range(60):
        left = compose_accel(inverse_accel(estimate), truth)
        half = AccelerometerErrors(0.5 * left.bias, 0.5 * left.matrix)
        estimate = compose(estimate, half)
    _assert_same(estimate, truth)
