"""The least-squares entry and its linear solver against NumPy, SciPy and certified values."""

import jax
import jax.numpy as jnp
import lineax as lx
import numpy as np
import optimistix as optx
import pytest
import scipy.linalg
import scipy.optimize

from hard_limit import run_limited
from inertiax.numerics.dense_normal import DenseNormal
from inertiax.numerics.gauss_newton import linear_step, solve_on_host
from inertiax.numerics.least_squares import least_squares
from inertiax.numerics.linear_algebra import (
    cholesky,
    cholesky_solve,
    scaled_inverse,
    spd_inverse,
    symmetric_eigen,
)


@pytest.mark.slow
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


@pytest.mark.slow
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


@pytest.mark.slow
@pytest.mark.parametrize("start", [(500.0, 1e-4), (250.0, 5e-4)])
def test_certified_values_of_misra1a(start):
    solution = least_squares(_decay, jnp.asarray(start), _misra1a())
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


@pytest.mark.slow
def test_outcomes_are_data():
    args = _misra1a()
    start = jnp.array([240.0, 5.5e-4])
    solve = jax.jit(lambda start, args: least_squares(_decay, start, args))
    found = solve(start, args)
    assert bool(found.succeeded) and found.outcome == "converged"
    out_of_steps = least_squares(_decay, jnp.array([500.0, 1e-4]), args, max_steps=2)
    assert not bool(out_of_steps.succeeded)
    assert bool(out_of_steps.result == optx.RESULTS.nonlinear_max_steps_reached)
    assert "maximum number of steps" in out_of_steps.outcome
    bad = (args[0], args[1].at[3].set(jnp.nan))
    assert not bool(solve(start, bad).succeeded)
    # Two parameters that only appear as a sum: rank 1.
    singular = least_squares(lambda p, a: (p[0] + p[1]) * a[0] - a[1], jnp.ones(2), args)
    assert not bool(singular.succeeded)
    many = jax.tree.map(lambda x: jnp.stack([x, x]), found)
    with pytest.raises(ValueError, match=r"solution.outcome`: it is of one known solve"):
        many.outcome  # noqa: B018


@pytest.mark.slow
def test_a_bad_member_does_not_spoil_a_batch():
    time, value = _misra1a()
    values = jnp.stack([value, value.at[0].set(jnp.nan), 1.01 * value])
    solve = lambda v: least_squares(_decay, jnp.array([240.0, 5.5e-4]), (time, v))
    batch = jax.jit(jax.vmap(solve))(values)
    assert batch.succeeded.tolist() == [True, False, True]
    # The amplitude scales with the data, the rate does not.
    np.testing.assert_allclose(batch.parameters[2] / batch.parameters[0], [1.01, 1.0], rtol=1e-7)


ROWS, STEP = (0, 7, 13), 1e-3


def _misra1a_answer(value):
    start = jnp.array([240.0, 5.5e-4])
    return least_squares(_decay, start, (_misra1a()[0], value)).parameters


@pytest.fixture(scope="module")
def central_differences():
    """Of the answer by some rows of Misra1a; all solves in one program."""
    _, value = _misra1a()
    moves = STEP * jnp.eye(len(value))[jnp.array(ROWS)]
    solve = jax.jit(jax.vmap(_misra1a_answer))
    up, down = jnp.split(solve(jnp.concatenate([value[None] + moves, value[None] - moves])), 2)
    return np.asarray((up - down).T / (2 * STEP))


@pytest.mark.slow
@pytest.mark.parametrize("transform", ["jit", "vmap", "reverse"])
def test_gradient_through_the_solve(transform, central_differences):
    _, value = _misra1a()
    if transform == "jit":
        jacobian = jax.jit(jax.jacfwd(_misra1a_answer))(value)
    elif transform == "vmap":
        jacobian = jax.jit(jax.vmap(jax.jacfwd(_misra1a_answer)))(value[None, :])[0]
    else:
        jacobian = jax.jit(jax.jacrev(_misra1a_answer))(value)
    # Central differences of step 1e-3 in 50: truncation about (2e-5)^2.
    found = np.asarray(jacobian)[:, list(ROWS)]
    np.testing.assert_allclose(found, central_differences, rtol=1e-6)


BATCHES = """
from inertiax.reduction.dwells import Dwells
from inertiax.estimators import Invariant
from inertiax.procedure.thermal_iterations import joint_fit
from inertiax.physics.temperature import Constant

rng = np.random.default_rng(0)
most, n, g = 4096, 18, 9.8
u = rng.normal(size=(most, n, 3)); u *= g / np.linalg.norm(u, axis=-1, keepdims=True)
matrix = np.eye(3) + np.tril(3e-3 * rng.normal(size=(most, 3, 3)))
bias = 0.05 * rng.normal(size=(most, 3))
outputs = np.einsum("kij,knj->kni", matrix, u) + bias[:, None, :]
estimator = Invariant(gravity=g)

def one(a):
    zero = jnp.zeros(n)
    dwells = Dwells(zero, zero, zero, zero, jnp.zeros(n, int), jnp.arange(n), jnp.ones(n, bool),
                    accel=a, accel_covariance=jnp.tile(1e-10 * jnp.eye(3), (n, 1, 1)))
    return joint_fit(estimator, Constant(), dwells)

solve = jax.jit(jax.vmap(one))
solution = solve(jnp.asarray(outputs))
assert bool(solution.succeeded.all()), solution.succeeded.sum()
error = solution.curve.coefficients[:, 0, :3] - bias
assert float(jnp.abs(error).max()) < 1e-8, float(jnp.abs(error).max())
"""


@pytest.mark.slow
def test_no_hang_of_a_large_batch():
    run_limited(BATCHES, seconds=300.0)


@pytest.mark.slow
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
    for transform in (jax.jacfwd, jax.jacrev):
        derivative = jax.jit(transform(solution))(1.3)
        np.testing.assert_allclose(derivative, expected, rtol=bound)


# On the host --------------------------------------------------------------------------------------


@pytest.mark.parametrize("size", [1, 9, 63])
def test_the_scaled_inverse_is_scipys_in_any_units(size):
    rng = np.random.default_rng(size)
    units = 10.0 ** rng.uniform(-6, 6, size)
    tall = rng.normal(size=(3 * size, size))
    expected = scipy.linalg.inv(tall.T @ tall) / np.outer(units, units)
    ours = scaled_inverse((tall * units).T @ (tall * units))
    np.testing.assert_allclose(
        ours * np.outer(units, units), expected * np.outer(units, units), 1e-9
    )


@pytest.mark.parametrize(
    "inverse", [scaled_inverse, lambda n: np.asarray(spd_inverse(jnp.asarray(n)))]
)
def test_both_inverses_are_nan_where_the_rows_do_not_determine_the_unknowns(inverse):
    rng = np.random.default_rng(3)
    for column in range(9):
        design = rng.normal(size=(60, 9))
        others = np.delete(design, column, axis=1)
        design[:, column] = others @ rng.normal(size=8)
        assert np.all(np.isnan(inverse(design.T @ design)))
    assert np.all(np.isnan(inverse(np.diag([1.0, 0.0, 2.0]))))


def test_linear_step_is_the_least_squares_of_numpys_svd_in_any_units():
    rng = np.random.default_rng(0)
    design, residual = rng.normal(size=(60, 9)) * np.logspace(-6, 6, 9), rng.normal(size=60)
    expected, *_ = np.linalg.lstsq(design / np.logspace(-6, 6, 9), -residual)
    np.testing.assert_allclose(
        linear_step(design, residual) * np.logspace(-6, 6, 9), expected, rtol=1e-11
    )


def test_linear_step_is_nan_where_the_rows_do_not_determine_the_unknowns():
    rng = np.random.default_rng(1)
    design, residual = rng.normal(size=(60, 9)), rng.normal(size=60)
    copied, empty, unknown = design.copy(), design.copy(), design.copy()
    copied[:, 3] = 2.0 * design[:, 1]
    empty[:, 0] = 0.0
    unknown[5, 5] = np.nan
    for rows in (copied, empty, unknown, design[:8]):
        assert np.all(np.isnan(linear_step(rows, residual[: len(rows)])))
    # The last pivot is rounding of either sign: each of many combinations must be refused.
    for column in range(40):
        combined = rng.normal(size=(60, 9))
        others = np.delete(combined, column % 9, axis=1)
        combined[:, column % 9] = others @ rng.normal(size=8)
        assert np.all(np.isnan(linear_step(combined, residual)))
    # A column that differs from the others by a ten-thousandth is still told: 1e-8 of the normal matrix.
    copied[:, 3] += 1e-4 * design[:, 3]
    assert np.all(np.isfinite(linear_step(copied, residual)))


def test_gauss_newton_on_the_host_finds_the_certified_values_of_misra1a():
    time, value = (np.asarray(x) for x in _misra1a())

    def rows(p):
        fall = np.exp(-p[1] * time)
        return np.stack([1.0 - fall, p[0] * time * fall], axis=1), p[0] * (1.0 - fall) - value

    found = solve_on_host(rows, np.array([250.0, 5e-4]))
    assert found.converged and found.num_steps < 10
    # Residuals of 0.1 leave, at a last step of 1e-7 sigma, eight digits; the certified values have eleven.
    np.testing.assert_allclose(found.unknowns, [2.3894212918e02, 5.5015643181e-04], 1e-8)


def test_gauss_newton_on_the_host_tells_that_it_did_not_converge():
    # A Jacobian of the wrong sign: every step, however damped, goes uphill.
    found = solve_on_host(lambda x: (-np.ones((1, 1)), x), np.array([1.0]))
    assert not found.converged and found.unknowns == [1.0]
    singular = solve_on_host(lambda p: (np.ones((5, 2)), np.arange(5.0) - p.sum()), np.zeros(2))
    assert not singular.converged and np.all(np.isfinite(singular.unknowns))


def test_eigenvalues_in_turn_are_scipys_and_have_slopes():
    rng = np.random.default_rng(3)
    root = rng.normal(size=(2, 5, 4, 4))
    matrices = root @ root.swapaxes(-1, -2)
    turn = rng.normal(size=(4, 4))
    for values, vectors in (
        symmetric_eigen(matrices),
        symmetric_eigen(jnp.asarray(matrices)),
        jax.jit(jax.vmap(jax.vmap(symmetric_eigen)))(jnp.asarray(matrices)),
    ):
        whole = [[scipy.linalg.eigvalsh(m) for m in row] for row in matrices]
        np.testing.assert_allclose(values, whole, rtol=1e-10)
        again = (np.asarray(vectors) * np.asarray(values)[..., None, :]) @ np.swapaxes(
            vectors, -1, -2
        )
        np.testing.assert_allclose(again, matrices, rtol=1e-10, atol=1e-12)

    def root_of(m):
        values, vectors = symmetric_eigen(m)
        return jnp.sum(jnp.asarray(turn) * ((vectors * jnp.sqrt(values)[None]) @ vectors.T))

    slope = np.asarray(jax.vmap(jax.grad(root_of))(jnp.asarray(matrices[0])))
    outside = lambda m: np.sum(turn * np.real(scipy.linalg.sqrtm(m)))
    for m, found in zip(matrices[0], slope):
        move = 1e-6 * (turn + turn.T)
        finite = (outside(m + move) - outside(m - move)) / 2.0
        assert np.sum(found * move) == pytest.approx(finite, rel=1e-6)
