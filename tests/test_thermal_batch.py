"""Devices on plans of their own are calibrated over temperature together as each is alone."""

import jax
import numpy as np
import pytest
from scipy.optimize import least_squares

import inertiax as ix


GRAVITY = 9.8096
SIGMA = 1e-3  # m/s²


def _fleet(rests: int, devices: int = 48, seed: int = 5):
    rng = np.random.default_rng(seed)
    up = rng.normal(size=(devices, rests, 3))
    up /= np.linalg.norm(up, axis=-1, keepdims=True)
    temperature = rng.uniform(-10.0, 50.0, (devices, rests))
    warm = (temperature[..., None] - 20.0) / 30.0
    accel = GRAVITY * up * [1.01, 0.99, 1.02] + 0.1 + 0.02 * warm
    return accel + SIGMA * rng.normal(size=up.shape), temperature


def _by_scipy(accel, temperature, degree, low, high):
    """Coefficients of nine parameters over the Chebyshev basis, by Levenberg and Marquardt."""
    x = (2.0 * temperature - low - high) / (high - low)
    basis = np.polynomial.chebyshev.chebvander(x, degree)

    def misfit(c):
        p = basis @ c.reshape(degree + 1, 9)
        matrix = np.zeros((len(x), 3, 3))
        matrix[:, [0, 1, 1, 2, 2, 2], [0, 0, 1, 0, 1, 2]] = p[:, 3:]
        force = np.linalg.solve(matrix + np.eye(3), (accel - p[:, :3])[..., None])[..., 0]
        return (np.linalg.norm(force, axis=1) - GRAVITY) / SIGMA

    return least_squares(misfit, np.zeros(9 * (degree + 1)), x_scale="jac", method="lm").x


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
        outside = _by_scipy(accel[k], temperature[k], degree, low, high)
        covariance = np.asarray(fit.calibration.accel.covariance[k])
        sigma = np.sqrt(np.diagonal(covariance) / (1.0 + (fit.accel.scatter[k] / SIGMA) ** 2))
        off = np.abs(np.asarray(curve.coefficients[k]).ravel() - outside) / sigma
        # Where scatter was found the weights change alike for all rests of one noise, and with them nothing.
        assert off.max() < 1e-2


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
