"""Devices on plans of their own are calibrated over temperature together as each is alone."""

import equinox as eqx
import jax
import numpy as np
import pytest
from scipy.optimize import least_squares

import inertiax as ix
from inertiax.fleet import fit_thermal_invariant


GRAVITY = 9.8096
SIGMA = 1e-3  # m/s²
solved = eqx.filter_jit(fit_thermal_invariant)


def _fleet(rests: int, devices: int = 48, seed: int = 5):
    rng = np.random.default_rng(seed)
    up = rng.normal(size=(devices, rests, 3))
    up /= np.linalg.norm(up, axis=-1, keepdims=True)
    temperature = rng.uniform(-10.0, 50.0, (devices, rests))
    warm = (temperature[..., None] - 20.0) / 30.0
    accel = GRAVITY * up * [1.01, 0.99, 1.02] + 0.1 + 0.02 * warm
    return accel + SIGMA * rng.normal(size=up.shape), temperature


def _by_scipy(accel, temperature, degree, low, high):
    """Nine parameters over the Chebyshev basis, by Levenberg and Marquardt."""
    x = (2.0 * temperature - low - high) / (high - low)
    basis = np.polynomial.chebyshev.chebvander(x, degree)

    def misfit(c):
        p = basis @ c.reshape(degree + 1, 9)
        matrix = np.zeros((len(x), 3, 3))
        matrix[:, [0, 1, 1, 2, 2, 2], [0, 0, 1, 0, 1, 2]] = p[:, 3:]
        force = np.linalg.solve(matrix + np.eye(3), (accel - p[:, :3])[..., None])[..., 0]
        return (np.linalg.norm(force, axis=1) - GRAVITY) / SIGMA

    return least_squares(misfit, np.zeros(9 * (degree + 1)), x_scale="jac", method="lm")


@pytest.mark.slow
@pytest.mark.parametrize(("rests", "degree", "lost"), [(24, 1, 0), (30, 2, 1)])
def test_a_fleet_in_random_attitudes_is_calibrated_as_by_scipy(rests, degree, lost):
    # 24 rests have 24 equations for 18 unknowns, 30 rests 30 for 27: there one of 48 may be left.
    accel, temperature = _fleet(rests)
    with jax.enable_x64(True):
        dwells = ix.Dwells.from_arrays(accel, sigma=SIGMA, temperature=temperature)
        fit = ix.fit(dwells, accel=ix.Invariant(gravity=GRAVITY), degree=degree)
    done = np.asarray(fit.succeeded)
    assert (~done).sum() <= lost, fit.reasons
    curve = fit.calibration.accel.curve
    for k in np.flatnonzero(done)[:6]:
        low, high = float(np.ravel(curve.basis.low)[0]), float(np.ravel(curve.basis.high)[0])
        outside = _by_scipy(accel[k], temperature[k], degree, low, high).x
        covariance = np.asarray(fit.calibration.accel.covariance[k])
        sigma = np.sqrt(np.diagonal(covariance) / (1.0 + (fit.accel.scatter[k] / SIGMA) ** 2))
        off = np.abs(np.asarray(curve.coefficients[k]).ravel() - outside) / sigma
        # Where scatter was found the weights change alike for all rests of one noise, and with them nothing.
        assert off.max() < 1e-2


@pytest.mark.slow
def test_an_answer_does_not_depend_on_the_others_of_its_batch():
    accel, temperature = _fleet(30, devices=20)
    temperature[:, 0], temperature[:, 1] = (
        -10.0,
        50.0,
    )  # one range for all, so that coefficients compare

    def fitted(which):
        with jax.enable_x64(True):
            dwells = ix.Dwells.from_arrays(
                accel[which], sigma=SIGMA, temperature=temperature[which]
            )
            fit = ix.fit(dwells, accel=ix.Invariant(gravity=GRAVITY), degree=1)
        assert np.all(fit.succeeded)
        return np.asarray(fit.calibration.accel.curve.coefficients)

    together, alone = fitted(np.arange(20)), fitted(np.array([7]))
    np.testing.assert_allclose(together[7], alone[0], atol=1e-8)  # 1e-5 of a standard deviation
    np.testing.assert_allclose(together, fitted(np.arange(20)[::-1])[::-1], atol=1e-8)


@pytest.mark.parametrize(("error", "within"), [(0.01, 0.015), (0.02, 0.015), (0.05, 0.015)])
@pytest.mark.slow
def test_uncertainties_are_those_of_the_minimum(error, within):
    # 18 attitudes at each of seven temperatures. The normal matrix that a batch of devices is solved with is made near
    # the minimum, by a first step in 32 bits, and anew where that was not near (`FAR`).
    rng = np.random.default_rng(11)
    faces = np.concatenate([np.eye(3), -np.eye(3)])
    edges = np.array([faces[i] + faces[j] for i in range(6) for j in range(i) if i != j + 3])
    up = np.tile(np.concatenate([faces, edges / np.sqrt(2.0)]), (7, 1))
    temperature = np.repeat(np.linspace(-30.0, 70.0, 7), 18) + rng.uniform(-2, 2, (16, 126))
    warm = (temperature[..., None] - 20.0) / 50.0
    scale = 1.0 + error * rng.normal(size=(16, 1, 3)) * (1.0 + 0.3 * warm)
    accel = (
        GRAVITY * up * scale + 10.0 * error * rng.normal(size=(16, 1, 3)) + 1.5 * error * warm**2
    )
    accel += SIGMA * rng.normal(size=accel.shape)
    basis = ix.Polynomial(3, -32.0, 72.0)
    with jax.enable_x64(True):
        weights = np.full(temperature.shape, 1.0 / SIGMA)
        given = map(jax.numpy.asarray, (accel, temperature, weights, GRAVITY))
        fit = solved(*given, basis)
    assert np.all(fit.converged)
    for k in range(16):
        outside = _by_scipy(accel[k], temperature[k], 3, basis.low, basis.high)
        covariance = np.linalg.inv(outside.jac.T @ outside.jac)
        sigma = np.sqrt(np.diagonal(covariance))
        assert np.abs((fit.parameters[k] - outside.x) / sigma).max() < 1e-4  # SciPy's own tolerance
        found = np.sqrt(np.diagonal(np.asarray(fit.covariance[k])))
        np.testing.assert_allclose(found, sigma, rtol=within)
