"""The least-squares entry and its linear solver against NumPy, SciPy and certified values."""

import jax
import jax.numpy as jnp
import lineax as lx
import numpy as np
import optimistix as optx
import pytest
import scipy.optimize

from hard_limit import run_limited
from inertiax.numerics.least_squares import (
    cholesky,
    cholesky_solve,
    DenseNormal,
    least_squares,
    levenberg_marquardt,
    spd_inverse,
)


@pytest.mark.parametrize("size", [1, 3, 9, 12, 13, 63])  # unrolled up to 12, a loop beyond
def test_cholesky_is_numpys(size):
    rng = np.random.default_rng(size)
    tall = rng.normal(size=(3 * size, size))
    matrix = tall.T @ tall
    right = rng.normal(size=(size, 2))
    lower = cholesky(jnp.asarray(matrix))
    np.testing.assert_allclose(lower, np.linalg.cholesky(matrix), rtol=1e-10, atol=1e-12)
    for b in (right, right[:, 0]):
        x = cholesky_solve(lower, jnp.asarray(b))
        np.testing.assert_allclose(x, np.linalg.solve(matrix, b), rtol=1e-9)
    np.testing.assert_allclose(spd_inverse(jnp.asarray(matrix)), np.linalg.inv(matrix), 1e-8, 1e-12)


@pytest.mark.parametrize("size", [9, 30])
def test_dense_normal_is_numpys_least_squares(size):
    rng = np.random.default_rng(0)
    # Columns of very different units, as biases and scale factors have.
    units = 10.0 ** rng.uniform(-6, 6, size)
    matrix = rng.normal(size=(50, size)) * units
    right = rng.normal(size=50)
    operator = lx.MatrixLinearOperator(jnp.asarray(matrix))
    ours = lx.linear_solve(operator, jnp.asarray(right), DenseNormal()).value
    # NumPy does not scale, so it is given the columns in like units; 1e-16 cond^2 is left.
    expected = np.linalg.lstsq(matrix / units, right, rcond=None)[0] / units
    np.testing.assert_allclose(ours, expected, rtol=1e-11)


def _decay(p, args):
    time, value = args
    return p[0] * (1.0 - jnp.exp(-p[1] * time)) - value


def _misra1a():
    """NIST StRD nonlinear regression data set Misra1a (lower difficulty)."""
    value = [10.07, 14.73, 17.94, 23.93, 29.61, 35.18, 40.02, 44.82, 50.76, 55.05, 61.01, 66.40]
    value += [75.47, 81.78]
    time = [77.6, 114.9, 141.1, 190.8, 239.9, 289.0, 332.8, 378.4, 434.8, 477.3, 536.8, 593.1]
    time += [689.1, 760.0]
    return jnp.asarray(time), jnp.asarray(value)


@pytest.mark.parametrize("start", [(500.0, 1e-4), (250.0, 5e-4)])
def test_certified_values_of_misra1a(start):
    solution = least_squares(
        _decay, jnp.asarray(start), _misra1a(), solver=levenberg_marquardt(), max_steps=200
    )
    # Certified: b1 = 2.3894212918E+02, b2 = 5.5015643181E-04, residual sum of squares
    # 1.2455138894E-01, standard deviations 2.7070075241E+00 and 7.2668688436E-06.
    assert bool(solution.succeeded)
    np.testing.assert_allclose(solution.parameters, [2.3894212918e02, 5.5015643181e-04], 1e-8)
    rss = float(jnp.sum(solution.residuals**2))
    np.testing.assert_allclose(rss, 1.2455138894e-01, rtol=1e-9)
    deviations = np.sqrt(np.diagonal(solution.covariance) * rss / 12.0)
    np.testing.assert_allclose(deviations, [2.7070075241, 7.2668688436e-06], rtol=1e-6)


def test_agrees_with_scipy_near_the_solution():
    args = _misra1a()
    expected = scipy.optimize.least_squares(
        lambda p: np.asarray(_decay(p, args)), [240.0, 5.5e-4], x_scale=[1.0, 1e-6], xtol=1e-15
    )
    ours = least_squares(_decay, jnp.array([240.0, 5.5e-4]), args)
    np.testing.assert_allclose(ours.parameters, expected.x, rtol=1e-7)


def test_outcomes_are_data():
    args = _misra1a()
    start = jnp.array([240.0, 5.5e-4])
    assert bool(least_squares(_decay, start, args).succeeded)
    out_of_steps = least_squares(_decay, jnp.array([500.0, 1e-4]), args, max_steps=2)
    assert not bool(out_of_steps.succeeded)
    assert bool(out_of_steps.result == optx.RESULTS.nonlinear_max_steps_reached)
    bad = (args[0], args[1].at[3].set(jnp.nan))
    assert not bool(least_squares(_decay, start, bad).succeeded)
    # Two parameters that only appear as a sum: rank 1.
    singular = least_squares(lambda p, a: (p[0] + p[1]) * a[0] - a[1], jnp.ones(2), args)
    assert not bool(singular.succeeded)


def test_a_bad_member_does_not_spoil_a_batch():
    time, value = _misra1a()
    values = jnp.stack([value, value.at[0].set(jnp.nan), 1.01 * value])
    solve = lambda v: least_squares(_decay, jnp.array([240.0, 5.5e-4]), (time, v))
    batch = jax.vmap(solve)(values)
    assert batch.succeeded.tolist() == [True, False, True]
    # The amplitude scales with the data, the rate does not.
    np.testing.assert_allclose(batch.parameters[2] / batch.parameters[0], [1.01, 1.0], rtol=1e-7)


@pytest.mark.parametrize("transform", ["plain", "jit", "vmap", "reverse"])
def test_gradient_through_the_solve(transform):
    time, value = _misra1a()
    solve = lambda v: least_squares(_decay, jnp.array([240.0, 5.5e-4]), (time, v)).parameters
    if transform == "jit":
        jacobian = jax.jit(jax.jacfwd(solve))(value)
    elif transform == "vmap":
        jacobian = jax.vmap(jax.jacfwd(solve))(value[None, :])[0]
    elif transform == "reverse":
        jacobian = jax.jacrev(solve)(value)
    else:
        jacobian = jax.jacfwd(solve)(value)
    for row in (0, 7, 13):
        step = 1e-3
        up, down = solve(value.at[row].add(step)), solve(value.at[row].add(-step))
        # Central differences of step 1e-3 in 50: truncation about (2e-5)^2.
        np.testing.assert_allclose(jacobian[:, row], (up - down) / (2 * step), rtol=1e-6)


BATCHES = """
import time
from inertiax.reduction.dwells import Dwells
from inertiax.estimators import Invariant
from inertiax.procedure.thermal_iterations import joint_fit
from inertiax.physics.temperature import Constant
import optimistix as optx
from inertiax.estimators.invariant import ellipsoid_start
from inertiax.numerics.least_squares import least_squares

rng = np.random.default_rng(0)
count, n, g = {count}, 18, 9.8
u = rng.normal(size=(count, n, 3)); u *= g / np.linalg.norm(u, axis=-1, keepdims=True)
matrix = np.eye(3) + np.tril(3e-3 * rng.normal(size=(count, 3, 3)))
bias = 0.05 * rng.normal(size=(count, 3))
outputs = np.einsum("kij,knj->kni", matrix, u) + bias[:, None, :]
estimator = Invariant(gravity=g)

def one(a):
    zero = jnp.zeros(n)
    dwells = Dwells(zero, zero, zero, zero, jnp.zeros(n, int), jnp.arange(n), jnp.ones(n, bool),
                    accel=a, accel_covariance=jnp.tile(1e-10 * jnp.eye(3), (n, 1, 1)))
    return joint_fit(estimator, Constant(), dwells)

solution = jax.jit(jax.vmap(one))(jnp.asarray(outputs))
assert bool(solution.succeeded.all()), solution.succeeded.sum()
error = solution.curve.coefficients[:, 0, :3] - bias
assert float(jnp.abs(error).max()) < 1e-8, float(jnp.abs(error).max())
print("done")
"""


@pytest.mark.parametrize("count", [1, 300, 1000, 4096])
def test_no_hang_at_any_batch_size(count):
    assert run_limited(BATCHES.format(count=count), seconds=120.0) == "done\n"


def test_derivative_of_the_solution_where_two_columns_are_nearly_alike():
    rng = np.random.default_rng(0)
    design, measured = rng.normal(size=(40, 4)), rng.normal(size=40)
    design[:, 3] = design[:, 0] + 1e-3 * design[:, 3]
    condition = np.linalg.cond(design / np.linalg.norm(design, axis=0))
    assert 1e3 < condition < 3e3

    def solution(size):
        return least_squares(lambda p, a: design @ p - a * measured, jnp.zeros(4), size).parameters

    expected = np.linalg.lstsq(design, measured, rcond=None)[0]
    # The derivative solves with the Hessian by its normal equations: rounding times the condition to the fourth.
    bound = 10.0 * condition**4 * np.finfo(float).eps
    assert bound < 0.05
    for derivative in (jax.jacfwd(solution)(1.3), jax.jacrev(solution)(1.3)):
        np.testing.assert_allclose(derivative, expected, rtol=bound)
