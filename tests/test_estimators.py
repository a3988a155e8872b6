"""Estimators: recovery of the truth, published optima, gauges."""

from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.optimize

from imu_tk_data import (
    GRAVITY,
    needs_recordings,
    NOMINAL,
    OFFSET,
    PUBLISHED,
    recordings,
    SIGMAS,
    to_imu_tk,
)
from inertiax.estimators import (
    ellipsoid_start,
    Invariant,
    ReferenceAccel,
    ReferenceGyro,
    StaticAccel,
    StaticGyro,
)
from inertiax.estimators.base import soften, whiten
from inertiax.physics.error_model import distort_accel, distort_gyro
from inertiax.physics.temperature import Constant
from inertiax.procedure.thermal_iterations import joint_fit
from inertiax.reduction.dwells import Dwells


def _dwells(getkey, num=24, sigma=1e-4):
    force = jax.random.normal(getkey(), (num, 3))
    force = GRAVITY * force / jnp.linalg.norm(force, axis=1, keepdims=True)
    rate = jax.random.normal(getkey(), (num, 3))
    zero = jnp.zeros(num)
    covariance = jnp.tile(sigma**2 * jnp.eye(3)[None], (num, 1, 1))
    return Dwells(
        time=zero,
        duration=zero,
        count=zero,
        temperature=zero,
        experiment=jnp.zeros(num, int),
        position=jnp.arange(num),
        valid=jnp.ones(num, bool),
        accel=force,
        accel_covariance=covariance,
        gyro=rate,
        gyro_covariance=covariance,
        reference_accel=force,
        reference_gyro=rate,
    )


CASES = {
    "invariant": Invariant(gravity=GRAVITY),
    "reference accel": ReferenceAccel(),
    "static accel": StaticAccel(nominal=jnp.zeros(3)),
    "reference gyro": ReferenceGyro(gravity=GRAVITY),
    "reference gyro with D": ReferenceGyro(gravity=GRAVITY, g_sensitivity=True),
    "static gyro": StaticGyro(gravity=GRAVITY),
    "static gyro with D": StaticGyro(gravity=GRAVITY, g_sensitivity=True),
}


def _distorted(estimator, truth, dwells):
    errors = estimator.unpack(truth)
    if estimator.triad == "accel":
        accel = jax.vmap(lambda f: distort_accel(errors, f))(dwells.reference_accel)
        return eqx.tree_at(lambda d: d.accel, dwells, accel)
    gyro = jax.vmap(lambda w, f: distort_gyro(errors, w, f, GRAVITY))(
        dwells.reference_gyro, dwells.reference_accel
    )
    return eqx.tree_at(lambda d: d.gyro, dwells, gyro)


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_recovers_the_truth_without_noise(name, getkey):
    estimator = CASES[name]
    dwells = _dwells(getkey)
    truth = 0.02 * jax.random.normal(getkey(), (estimator.num_parameters,))
    solution = joint_fit(estimator, Constant(), _distorted(estimator, truth, dwells))
    assert bool(solution.succeeded)
    np.testing.assert_allclose(solution.curve.coefficients[0], truth, atol=1e-10)


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_compensated_dwells_have_nothing_left(name, getkey):
    estimator = CASES[name]
    dwells = _dwells(getkey)
    truth = 0.02 * jax.random.normal(getkey(), (estimator.num_parameters,))
    refined = jax.vmap(lambda d: estimator.compensate(truth, d))(
        _distorted(estimator, truth, dwells)
    )
    np.testing.assert_allclose(refined.accel, dwells.accel, rtol=1e-12)
    np.testing.assert_allclose(refined.gyro, dwells.gyro, rtol=1e-12, atol=1e-13)


@pytest.mark.parametrize("name", CASES)
def test_names_say_where_the_parameters_are(name):
    estimator = CASES[name]
    for k, label in enumerate(estimator.names):
        errors = estimator.unpack(jnp.zeros(estimator.num_parameters).at[k].set(1.0))
        triad, entry = label.split(".")
        field, index = entry.rstrip("]").split("[")
        value = np.asarray(getattr(errors, field))
        assert triad == estimator.triad
        assert value[tuple(int(i) for i in index.split(","))] == 1.0
        assert np.sum(np.abs(value)) == 1.0


@pytest.mark.slow
def test_rotation_of_the_triad_is_the_gauge_of_the_invariant_estimator(getkey):
    # Any rotation of the compensated force leaves |a| alone, so a full matrix is not determined.
    rotation = np.linalg.qr(np.asarray(jax.random.normal(getkey(), (3, 3))))[0]
    force = np.asarray(jax.random.normal(getkey(), (3,)))
    np.testing.assert_allclose(np.linalg.norm(rotation @ force), np.linalg.norm(force), 1e-14)
    # The estimator's own form has no such direction left.
    estimator = Invariant(gravity=GRAVITY)
    jacobian = jax.vmap(lambda d: jax.jacfwd(estimator.residual)(jnp.zeros(9), d))(_dwells(getkey))
    assert np.linalg.matrix_rank(np.asarray(jacobian)[:, 0, :]) == 9


def test_closed_form_start_is_exact_without_noise(getkey):
    estimator = Invariant(gravity=GRAVITY)
    truth = 0.05 * jax.random.normal(getkey(), (9,))
    dwells = _distorted(estimator, truth, _dwells(getkey))
    start = ellipsoid_start(jnp.asarray(dwells.accel), dwells.valid, GRAVITY)
    np.testing.assert_allclose(start, truth, atol=1e-11)


def test_closed_form_start_gives_the_identity_where_there_is_no_ellipsoid(getkey):
    flat = _dwells(getkey).accel.at[:, 2].set(0.0)
    start = ellipsoid_start(flat, jnp.ones(len(flat), bool), GRAVITY)
    np.testing.assert_array_equal(start, np.zeros(9))


def test_whitening_is_numpys(getkey):
    square = np.asarray(jax.random.normal(getkey(), (3, 3)))
    covariance = square @ square.T
    residual = np.asarray(jax.random.normal(getkey(), (3,)))
    factor = np.linalg.cholesky(covariance + 0.25 * np.eye(3))
    expected = np.linalg.solve(factor, residual)
    ours = whiten(covariance, jnp.asarray(0.5), jnp.asarray(residual))
    np.testing.assert_allclose(ours, expected, rtol=1e-10)


def test_softened_residual_is_the_pseudo_huber_loss():
    residual = np.array([-50.0, -1.5, 0.0, 0.3, 4.0, 1e4])
    softened = np.asarray(soften(jnp.asarray(residual), 1.5))
    loss = 1.5**2 * (np.sqrt(1.0 + (residual / 1.5) ** 2) - 1.0)
    np.testing.assert_allclose(0.5 * softened**2, loss, rtol=1e-9)
    np.testing.assert_array_equal(np.sign(softened), np.sign(residual))


@pytest.mark.slow
def test_robust_option_withstands_a_bad_dwell(getkey):
    truth = 0.02 * jax.random.normal(getkey(), (9,))
    dwells = _distorted(Invariant(gravity=GRAVITY), truth, _dwells(getkey))
    dwells = eqx.tree_at(lambda d: d.accel, dwells, dwells.accel.at[5].add(0.5))
    error = {}
    for threshold in (None, 2.0):
        estimator = Invariant(gravity=GRAVITY, robust=threshold)
        solution = joint_fit(estimator, Constant(), dwells)
        error[threshold] = float(jnp.max(jnp.abs(solution.curve.coefficients[0] - truth)))
    # 0.5 m/s² is 5000 sigmas: least squares is dragged along, the robust fit by about 2 sigmas.
    assert error[2.0] < 5e-4 < 0.02 < error[None]


# The Xsens recording of imu_tk --------------------------------------------------------------------


@pytest.mark.slow
@needs_recordings
def test_published_optimum_of_the_xsens_recording():
    path = Path(str(recordings)) / "imu_tk-xsens" / "interval_means.txt"
    counts = np.loadtxt(path)
    force = jnp.asarray((counts - OFFSET) / NOMINAL)
    num = len(counts)
    zero = jnp.zeros(num)
    dwells = Dwells(
        zero,
        zero,
        zero,
        zero,
        jnp.zeros(num, int),
        jnp.arange(num),
        jnp.ones(num, bool),
        accel=force,
        accel_covariance=jnp.zeros((num, 3, 3)),
    )
    # No noise figures: equal weights, and the scale from the residuals.
    estimator = Invariant(gravity=GRAVITY, scatter=1e-3)
    solution = joint_fit(estimator, Constant(), dwells)
    vector = solution.curve.coefficients[0]
    misfit = jax.vmap(lambda d: estimator.misfit(vector, d)[0][0])(dwells)
    np.testing.assert_allclose(0.5 * jnp.sum(misfit**2), 1.82602351e-5, rtol=1e-8)
    ours = np.asarray(to_imu_tk(vector))
    published = np.concatenate([PUBLISHED[k] for k in ("misalignment", "scale", "bias")])
    np.testing.assert_allclose(ours, published, rtol=1e-6)
    variance = float(jnp.sum(misfit**2)) / (num - 9) / 1e-3**2
    jacobian = np.asarray(jax.jacfwd(to_imu_tk)(vector))
    deviations = np.sqrt(np.diagonal(jacobian @ solution.covariance @ jacobian.T) * variance)
    deviations[3:6] /= published[3:6]  # published as relative
    np.testing.assert_allclose(deviations, SIGMAS, rtol=0.05)  # two digits are published


@pytest.mark.slow
def test_invariant_solution_is_scipys(getkey):
    truth = 0.02 * jax.random.normal(getkey(), (9,))
    estimator = Invariant(gravity=GRAVITY)
    dwells = _distorted(estimator, truth, _dwells(getkey))
    noisy = dwells.accel + 1e-2 * jax.random.normal(getkey(), dwells.accel.shape)
    dwells = eqx.tree_at(lambda d: d.accel, dwells, noisy)

    def residual(p):
        lower = np.zeros((3, 3))
        lower[np.tril_indices(3)] = p[3:]
        force = np.linalg.solve(np.eye(3) + lower, (np.asarray(noisy) - p[:3]).T)
        return np.linalg.norm(force, axis=0) - GRAVITY

    expected = scipy.optimize.least_squares(residual, np.zeros(9), xtol=1e-15, ftol=1e-15)
    ours = joint_fit(estimator, Constant(), dwells).curve.coefficients[0]
    np.testing.assert_allclose(ours, expected.x, atol=1e-8)
