"""`ix.fit` on arrays of many devices, and `ix.derivatives` of what it found."""

import jax
import numpy as np
import pytest

import inertiax as ix
from inertiax.fleet.solve.batch import fit_fleet
from inertiax.physics.temperature import Constant


pytestmark = pytest.mark.compiled_quickly


GRAVITY = 9.81
DEVICES, DWELLS = 40, 24


@pytest.fixture(scope="module")
def made():
    random = np.random.default_rng(5)
    up = random.normal(size=(DEVICES, DWELLS, 3))
    up *= GRAVITY / np.linalg.norm(up, axis=-1, keepdims=True)
    bias = 0.05 * random.normal(size=(DEVICES, 3))
    matrix = 0.01 * np.tril(random.normal(size=(DEVICES, 3, 3)))
    accel = up + np.einsum("nij,ndj->ndi", matrix, up) + bias[:, None]
    accel += 1e-4 * random.normal(size=accel.shape)
    rate = random.normal(size=(DEVICES, DWELLS, 3))
    gyro = 1.01 * rate + 0.02 + 1e-5 * random.normal(size=rate.shape)
    return accel, gyro, rate, bias


@pytest.fixture(scope="module")
def found(made):
    accel, gyro, rate, _ = made
    dwells = ix.Dwells.from_arrays(accel, gyro, reference_gyro=rate, sigma=(1e-4, 1e-5))
    estimators = {"accel": ix.Invariant(gravity=GRAVITY), "gyro": ix.ReferenceGyro(gravity=GRAVITY)}
    return ix.fit(dwells, **estimators)


@pytest.mark.slow
def test_truth_is_found_within_its_covariance(made, found):
    assert found.succeeded.shape == (DEVICES,) and found.succeeded.all()
    calibration = found.calibration
    assert calibration.covariance.shape == (DEVICES, 21, 21)
    assert not np.any(calibration.covariance[:, :9, 9:])
    block = calibration.block("accel.bias")
    sigma = np.sqrt(np.diagonal(block.covariance, axis1=1, axis2=2))
    z = (block.mean - made[3]) / sigma
    # 120 independent normals: their standard deviation is within 4 of its own sigmas of 1.
    assert abs(z.std() - 1.0) < 4.0 / np.sqrt(2.0 * z.size)
    np.testing.assert_allclose(calibration.block("gyro.scale").mean, 0.01, atol=2e-5)


@pytest.mark.slow
def test_a_device_alone_is_that_of_the_batch(made, found):
    accel = made[0]
    one = ix.fit(ix.Dwells.from_arrays(accel[3], sigma=1e-4), accel=ix.Invariant(gravity=GRAVITY))
    assert one.succeeded.shape == () and bool(one.succeeded)
    many = found.calibration.accel.curve.coefficients[3]
    np.testing.assert_allclose(one.calibration.accel.curve.coefficients, many, atol=1e-9)


@pytest.mark.slow
def test_padding_may_hold_anything(made):
    accel = made[0][:4].copy()
    valid = np.arange(DWELLS) < 20
    estimator = ix.Invariant(gravity=GRAVITY)
    want = ix.fit(ix.Dwells.from_arrays(accel[:, :20], sigma=1e-4), accel=estimator).calibration
    accel[:, 20:] = np.nan
    got = ix.fit(ix.Dwells.from_arrays(accel, sigma=1e-4, valid=valid), accel=estimator).calibration
    np.testing.assert_allclose(got.coefficients, want.coefficients, atol=1e-9)
    # The fleet's own entry, whose dwells are not checked.
    accel[:, 20:] = 0.0
    whole = ix.Dwells.from_arrays(made[0][:4], sigma=1e-4, valid=valid)
    zero = jax.tree.map(np.asarray, whole)
    object.__setattr__(zero, "accel", accel)
    fit = fit_fleet(estimator, Constant(), zero)
    np.testing.assert_allclose(fit.parameters, want.coefficients, atol=1e-9)


def test_positions_that_do_not_determine_the_model_do_not_succeed(made):
    four = np.tile(made[0][:2, :4], (1, 6, 1))
    fit = ix.fit(ix.Dwells.from_arrays(four, sigma=1e-4), accel=ix.Invariant(gravity=GRAVITY))
    assert not fit.succeeded.any() and "do not determine" in fit.reasons[0]


@pytest.mark.slow
def test_derivatives_by_gravity_are_those_of_solving_again(made, found):
    step = 1e-4
    table = ix.derivatives(found, [ix.sources.gravity(step), ix.sources.output_noise()])
    assert table.by_source[0].shape == (DEVICES, 21, 1)
    dwells = ix.Dwells.from_arrays(made[0], sigma=1e-4)
    ends = [
        ix.fit(dwells, accel=ix.Invariant(gravity=GRAVITY + s)).calibration.coefficients
        for s in (step, -step)
    ]
    # The true g being larger than stated is the stated one being smaller.
    np.testing.assert_allclose(
        table.by_source[0][:, :9, 0], (ends[1] - ends[0]) / 2.0, rtol=2e-3, atol=1e-9
    )
    # What the dwells' noise contributes is the fit's own covariance, but for scatter that was found.
    own = np.sqrt(np.diagonal(found.calibration.covariance[:, :9, :9], axis1=1, axis2=2))
    quiet = np.asarray(found.accel.scatter) == 0.0
    assert quiet.sum() > DEVICES // 2
    # The estimator weighs a dwell's noise along its output, as if the scale factors were one; these are off by 2 %.
    np.testing.assert_allclose(table.sigma[quiet, 1, :9], own[quiet], rtol=0.03)


@pytest.mark.slow
def test_derivatives_are_mapped_over_devices(found):
    sources = [ix.sources.gravity(1e-4)]
    whole = ix.derivatives(found, sources)
    mapped = jax.jit(jax.vmap(lambda f: ix.derivatives(f, sources)))(found)
    np.testing.assert_allclose(mapped.by_source[0], whole.by_source[0], rtol=1e-8, atol=1e-12)
