"""Equations (1) and (3) against hand calculations and NumPy."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from inertiax.physics.error_model import (
    AccelerometerErrors,
    compensate_accel,
    compensate_gyro,
    compensate_gyro_as_printed,
    distort_accel,
    distort_gyro,
    GyroErrors,
    solve3,
)


GRAVITY = 9.8


def _errors(getkey):
    accel = AccelerometerErrors(
        0.03 * jax.random.normal(getkey(), (3,)),
        jnp.tril(2e-3 * jax.random.normal(getkey(), (3, 3))),
    )
    gyro = GyroErrors(
        1e-5 * jax.random.normal(getkey(), (3,)),
        2e-3 * jax.random.normal(getkey(), (3, 3)),
        1e-5 * jax.random.normal(getkey(), (3, 3)),
    )
    return accel, gyro


def test_distort_accel_by_hand():
    # x: 9.8 * 1.001 + 0.02; y: 9.8 * 0.002 - 0.01; z: 9.8 * 0.003 + 0.
    errors = AccelerometerErrors(
        jnp.array([0.02, -0.01, 0.0]),
        jnp.array([[0.001, 0.0, 0.0], [0.002, -0.001, 0.0], [0.003, 0.0, 0.004]]),
    )
    output = distort_accel(errors, jnp.array([9.8, 0.0, 0.0]))
    np.testing.assert_allclose(output, [9.8298, 0.0096, 0.0294], rtol=1e-14)


def test_distort_gyro_by_hand():
    # 1 rad/s about z with 1 g along x: Theta column 2, D column 0, bias.
    errors = GyroErrors(
        jnp.array([1e-3, 0.0, 0.0]),
        jnp.zeros((3, 3)).at[:, 2].set(jnp.array([0.01, 0.02, 0.03])),
        jnp.zeros((3, 3)).at[:, 0].set(jnp.array([4e-3, 5e-3, 6e-3])),
    )
    rate, force = jnp.array([0.0, 0.0, 1.0]), jnp.array([9.8, 0.0, 0.0])
    output = distort_gyro(errors, rate, force, GRAVITY)
    np.testing.assert_allclose(output, [0.015, 0.025, 1.036], rtol=1e-14)


def test_cramer_is_numpys_solve():
    rng = np.random.default_rng(0)
    for _ in range(20):
        matrix = np.eye(3) + 0.2 * rng.normal(size=(3, 3))
        vector = rng.normal(size=3)
        expected = np.linalg.solve(matrix, vector)
        np.testing.assert_allclose(
            solve3(jnp.asarray(matrix), jnp.asarray(vector)), expected, 1e-12
        )


@pytest.mark.slow
def test_compensate_inverts_distort(getkey):
    accel, gyro = _errors(getkey)
    force, rate = jax.random.normal(getkey(), (3,)) * 10.0, jax.random.normal(getkey(), (3,))
    refined = compensate_accel(accel, distort_accel(accel, force))
    np.testing.assert_allclose(refined, force, rtol=1e-14, atol=1e-14)
    output = distort_gyro(gyro, rate, force, GRAVITY)
    refined_rate = compensate_gyro(gyro, output, refined, GRAVITY)
    np.testing.assert_allclose(refined_rate, rate, rtol=1e-13, atol=1e-15)


def test_printed_compensation_is_off_by_the_stated_term(getkey):
    accel, gyro = _errors(getkey)
    force, rate = jnp.array([3.0, -4.0, 8.0]), jnp.array([0.1, 0.2, -0.3])
    raw = distort_accel(accel, force)
    output = distort_gyro(gyro, rate, force, GRAVITY)
    printed = compensate_gyro_as_printed(gyro, output, raw, GRAVITY)
    # -(E + Theta)^-1 D (Gamma a + a0) / g, by NumPy.
    raw_minus_true = np.asarray(accel.matrix) @ force + accel.bias
    expected = -np.linalg.solve(
        np.eye(3) + gyro.matrix, np.asarray(gyro.g_sensitivity) @ raw_minus_true / GRAVITY
    )
    np.testing.assert_allclose(printed - rate, expected, rtol=1e-8)
    assert np.max(np.abs(expected)) > 1e-9  # it is a real error, not round-off
