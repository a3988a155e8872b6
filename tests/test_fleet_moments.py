"""Sums over dwells in the frame of the specific force, and chunks of lanes in one call."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from fleet_data import COLUMNS, directions, dwell_means, GRAVITY, parameters, ROWS
from inertiax.estimators import Invariant
from inertiax.fleet import fit_invariant
from inertiax.fleet.solve.invariant import fit_chunks, predicted
from inertiax.fleet.solve.moments import monomials, normal_matrix, squares, total
from inertiax.fleet.solve.refined_noise import refined_sigma
from inertiax.fleet.solve.thermal_rows import _products_of, normal_matrices
from inertiax.physics.temperature import CubicSpline, Polynomial
from inertiax.reduction.dwells import Dwells


DIRECTIONS = ((0, 0), (1, 0), (2, 0), (1, 1), (2, 1), (2, 2))


def _sums(u: np.ndarray, weight: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """JᵀJ and −Jᵀr in the frame of `u`."""
    phi, length = monomials(jnp.asarray(u)), np.linalg.norm(u, axis=0)
    normal = normal_matrix(phi, jnp.asarray((weight / length) ** 2))
    return np.asarray(normal), np.asarray(total(phi, jnp.asarray(weight**2 * (1 - 1 / length))))


@pytest.mark.slow
@pytest.mark.parametrize("dwells", [18, 50])  # in one expression, and in three parts
def test_moments_are_the_normal_matrix_of_numerical_derivatives(dwells):
    rng = np.random.default_rng(4)
    u = rng.normal(0, 1, (3, dwells, 5))
    u *= (1.0 + rng.normal(0, 1e-3, (dwells, 5))) / np.linalg.norm(u, axis=0)
    weight = rng.uniform(0.5, 2.0, (dwells, 5))

    def residual(step: np.ndarray, lane: int) -> np.ndarray:
        change = np.zeros((3, 3))
        change[tuple(zip(*DIRECTIONS, strict=True))] = step[3:]
        moved = u[:, :, lane] - step[:3, None] - change @ u[:, :, lane]
        return weight[:, lane] * (np.linalg.norm(moved, axis=0) - 1.0)

    normal, pull = _sums(u, weight)
    for lane in range(5):
        jacobian = np.stack(
            [(residual(h, lane) - residual(-h, lane)) / 2e-5 for h in 1e-5 * np.eye(9)], axis=1
        )
        # Central differences of a step 1e-5 are good to 1e-10.
        np.testing.assert_allclose(normal[:, :, lane], jacobian.T @ jacobian, atol=1e-8)
        np.testing.assert_allclose(
            pull[:, lane], -jacobian.T @ residual(np.zeros(9), lane), atol=1e-9
        )


@pytest.mark.parametrize("dwells", [4, 18, 50])
def test_squares_are_the_symmetric_product_of_numpy(dwells):
    rows = np.random.default_rng(5).normal(size=(9, dwells, 6))
    with jax.enable_x64(True):
        found = np.asarray(squares(jnp.asarray(rows)))
    # Sums of up to 50 products of numbers of size 1, in another order.
    np.testing.assert_allclose(found, np.einsum("idb,jdb->ijb", rows, rows), rtol=0, atol=1e-13)


@pytest.mark.slow
def test_chunks_are_the_batch_and_those_not_used_are_left_out():
    rng = np.random.default_rng(6)
    made = [dwell_means(rng, parameters(rng, 0), 2)[0] for _ in range(12)]
    outputs = np.stack(made) + rng.normal(0, 1e-4, (12, *made[0].shape))
    lanes = outputs.reshape(3, 4, -1, 3).transpose(0, 3, 2, 1)
    weights = np.full((3, lanes.shape[2], 4), 1e4)
    gravity = jnp.asarray(GRAVITY)
    fit = jax.jit(fit_chunks)(lanes, weights, gravity, jnp.int32(2))
    one = jax.jit(fit_invariant)
    for k in range(2):
        alone = one(lanes[k], weights[k], gravity)
        # The same program but for what the compiler joins: rounding.
        np.testing.assert_allclose(fit.parameters[k], alone.parameters, rtol=0, atol=1e-12)
        assert bool(alone.converged.all()) and bool(fit.converged[k].all())
    assert not np.asarray(fit.parameters[2]).any() and not np.asarray(fit.converged[2]).any()

    # Errors of a fifth, and six faces, whose repeats differ by their noise alone; the same program.
    truth = rng.uniform(-0.2, 0.2, (4, 9))
    matrix = np.tile(np.eye(3), (4, 1, 1))
    matrix[:, ROWS, COLUMNS] += truth[:, 3:]
    force = np.resize(GRAVITY * directions(), (lanes.shape[2], 3))
    far = np.einsum("lij,dj->idl", matrix, force) + GRAVITY * truth.T[:3, None]
    found = one(far, weights[0], gravity)
    assert bool(found.converged.all())
    np.testing.assert_allclose(np.asarray(found.parameters) / UNITS, truth, atol=1e-10)
    faces = np.resize(force[:6], force.shape).T[:, :, None] + rng.normal(0, 1e-4, far.shape)
    found = one(faces, weights[0], gravity)
    assert not found.converged.any() and np.isnan(found.covariance).all()


# The first form: `estimators.Invariant`, one dwell at a time ------------------------------------------


def _one(output: np.ndarray) -> Dwells:
    zero = jnp.zeros(())
    label = jnp.zeros((), int)
    return Dwells(
        zero, zero, zero, zero, label, label, jnp.ones((), bool),
        accel=jnp.asarray(output), accel_covariance=jnp.eye(3),
    )  # fmt: skip


@pytest.fixture(scope="module")
def first_form():
    """Outputs of 18 rests, parameters, and the estimator's |a| − g with its derivatives."""
    rng = np.random.default_rng(11)
    theta = parameters(rng, 0)
    outputs = dwell_means(rng, theta, 1)[0] + rng.normal(0, 1e-2, (18, 3))
    estimator = Invariant(GRAVITY)
    misfit = lambda v, output: estimator.misfit(v, _one(output))[0][0]
    both = jax.jit(jax.vmap(jax.value_and_grad(misfit), in_axes=(None, 0)))
    return outputs, theta[0], *(np.asarray(x) for x in both(jnp.asarray(theta[0]), outputs))


UNITS = np.r_[
    np.full(3, GRAVITY), np.ones(6)
]  # of a parameter in the batched forms, which count in g


def test_predicted_is_the_estimators_residual(first_form):
    outputs, theta, misfit, jacobian = first_form
    size, columns = jax.jit(predicted)(list(theta / UNITS), list(outputs.T / GRAVITY))
    # Rounding of some thirty operations.
    np.testing.assert_allclose((size - 1.0) * GRAVITY, misfit, rtol=0, atol=1e-13)
    np.testing.assert_allclose(-np.stack(columns, axis=1), jacobian * UNITS / GRAVITY, atol=1e-14)


@pytest.mark.slow
def test_the_frame_of_moments_gives_the_estimators_normal_matrix(first_form):
    outputs, theta, misfit, jacobian = first_form
    matrix = np.eye(3)
    matrix[ROWS, COLUMNS] += theta[3:]
    force = np.linalg.solve(matrix, (outputs - theta[:3]).T) / GRAVITY
    normal, pull = (x[..., 0] for x in _sums(force[:, :, None], np.ones((18, 1))))
    # A step β, G of the frame moves the parameters by (E + Γ) β and (E + Γ) G.
    move = np.zeros((9, 9))
    move[:3, :3] = matrix
    for k, (i, j) in enumerate(DIRECTIONS):
        change = np.zeros((3, 3))
        change[i, j] = 1.0
        move[3:, 3 + k] = (matrix @ change)[ROWS, COLUMNS]
    own = jacobian * UNITS / GRAVITY @ move
    np.testing.assert_allclose(normal, own.T @ own, rtol=0, atol=1e-12)
    np.testing.assert_allclose(pull, -own.T @ misfit / GRAVITY, rtol=0, atol=1e-13)


@pytest.mark.parametrize(
    "basis", [Polynomial(3, -10.0, 40.0), CubicSpline(np.array([-10.0, 5.0, 20.0, 40.0]))]
)
def test_thermal_normal_matrices_are_those_of_the_kronecker_rows(basis):
    """Also where products of two functions of the basis are means of two others, as Chebyshev's are."""
    rng = np.random.default_rng(5)
    temperature, rows = rng.uniform(-10.0, 40.0, (4, 30)), rng.normal(size=(4, 9, 30))
    with jax.enable_x64(True):
        products, pairs = _products_of(basis)
        over = np.asarray(jax.vmap(jax.vmap(products))(temperature)).transpose(2, 1, 0)
        given = over, rows.transpose(1, 2, 0)
        found = np.asarray(jax.jit(lambda o, r: normal_matrices(o, r, pairs))(*given))
        phi = np.asarray(jax.vmap(jax.vmap(basis))(temperature))
    for k in range(4):
        design = np.stack([np.kron(p, g) for p, g in zip(phi[k], rows[k].T, strict=True)])
        np.testing.assert_allclose(found[:, :, k], design.T @ design, rtol=0, atol=1e-11)


@pytest.mark.slow
def test_refined_noise_is_that_of_compensated_dwells():
    """`Invariant.misfit` of dwells that `Invariant.compensate` refined, at no further error."""
    rng = np.random.default_rng(9)
    count, rests = 3, 20
    basis = Polynomial(1, 0.0, 40.0)
    outputs = rng.standard_normal((count, rests, 3))
    outputs *= GRAVITY / np.linalg.norm(outputs, axis=-1, keepdims=True)
    root = 1e-3 * rng.standard_normal((count, rests, 3, 3))
    temperature = rng.uniform(0.0, 40.0, (count, rests))
    dwells = Dwells.from_arrays(outputs, temperature=temperature, sigma=root @ root.mT)
    coefficients = rng.normal(0.0, 0.03, (count, 2, 9))
    coefficients[2] = np.nan  # of a device that was not solved
    own = np.full((count, rests, 1), 7.0)
    found = refined_sigma(basis, dwells, coefficients.reshape(count, -1), own)
    estimator = Invariant(gravity=GRAVITY)
    with jax.enable_x64(True):
        for k in range(2):
            for n in range(rests):
                one = jax.tree.map(lambda x, k=k, n=n: jnp.asarray(x[k, n]), dwells)
                vector = np.array([1.0, temperature[k, n] / 20.0 - 1.0]) @ coefficients[k]
                _, sigma = estimator.misfit(np.zeros(9), estimator.compensate(vector, one))
                np.testing.assert_allclose(found[k, n], sigma, rtol=1e-12)
    np.testing.assert_array_equal(found[2], own[2])
