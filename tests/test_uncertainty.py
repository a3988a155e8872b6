"""Covariance that does not trust the noise model; uncertainty of outputs at any temperature."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from inertiax.calibrate.observability import (
    _plain,
    curve_covariance_at,
    output_uncertainty,
    sandwich_covariance,
)
from inertiax.calibration.calibration import Calibration, TriadCalibration
from inertiax.estimators import Invariant, StaticAccel
from inertiax.physics.temperature import Constant, Curve, Polynomial
from inertiax.procedure.single_device import joint_fit_one
from inertiax.reduction.dwells import Dwells
from inertiax.simulate.bench import simulate_dwells
from inertiax.simulate.plan import PAPER_GRAVITY, paper_set
from inertiax.simulate.triad import Device, draw_accelerometers


def _rests(values, experiment=None):
    count = len(values)
    return Dwells(
        time=np.arange(float(count)),
        duration=np.ones(count),
        count=np.ones(count),
        temperature=np.linspace(-1.0, 1.0, count),
        experiment=np.arange(count) if experiment is None else experiment,
        position=np.zeros(count, int),
        valid=np.ones(count, bool),
        accel=values,
        accel_covariance=np.tile(np.eye(3), (count, 1, 1)),
    )


MEAN = StaticAccel(nominal=jnp.zeros(3))


def test_sandwich_of_a_mean_is_its_textbook_variance():
    # HC2 for a mean: Σ r² / (1 − 1/n) / n² = s² / n, the sample variance over n, per axis.
    values = np.random.default_rng(0).normal(size=(12, 3))
    curve = Curve(Constant(), jnp.asarray(values.mean(axis=0, keepdims=True)))
    found = sandwich_covariance(MEAN, curve, _rests(values))
    np.testing.assert_allclose(found, np.cov(values.T) / 12, rtol=1e-10)


def test_clustered_sandwich_of_a_mean_is_that_of_the_experiments_means():
    rng = np.random.default_rng(1)
    values = np.repeat(rng.normal(size=(10, 3)), 6, axis=0)  # an experiment's dwells err alike
    curve = Curve(Constant(), jnp.asarray(values.mean(axis=0, keepdims=True)))
    experiments = np.repeat(np.arange(10), 6)
    found = sandwich_covariance(MEAN, curve, _rests(values, experiments), by="experiment")
    np.testing.assert_allclose(found, np.cov(values[::6].T) / 10, rtol=1e-10)


@pytest.mark.slow
def test_sandwich_sees_noise_of_twice_the_stated_size():
    device = Device(accel=draw_accelerometers(jax.random.PRNGKey(0), degree=2))
    estimator, basis = Invariant(gravity=PAPER_GRAVITY), device.accel.curve.series.basis
    clean, _ = simulate_dwells(None, paper_set(2), device)
    noise = np.random.default_rng(2).normal(size=(234, 3)) * 2e-5  # stated: 1e-5
    dwells = eqx.tree_at(lambda d: d.accel, clean, np.asarray(clean.accel) + noise)
    solution = joint_fit_one(estimator, basis, dwells)
    robust = sandwich_covariance(estimator, solution.curve, dwells)
    ratio = np.sqrt(np.diagonal(robust) / np.diagonal(solution.covariance))
    # 234 dwells tell a deviation to 1/√468 = 5 % on average, a single coefficient's to about 10 %.
    assert np.mean(ratio) == pytest.approx(2.0, rel=0.12)
    assert np.all((ratio > 1.3) & (ratio < 2.8))
    # The grouped one exists, and is of the same size on average (13 groups: a fifth).
    grouped = sandwich_covariance(estimator, solution.curve, dwells, by="experiment")
    assert 1.0 < np.sqrt(np.mean(np.diagonal(grouped) / np.diagonal(solution.covariance))) < 3.0


def test_grouping_must_be_one_that_exists():
    curve = Curve(Constant(), jnp.zeros((1, 3)))
    with pytest.raises(ValueError, match="'dwell' or 'experiment'"):
        sandwich_covariance(MEAN, curve, _rests(np.zeros((4, 3))), by="day")
    with pytest.raises(ValueError, match="one experiment has no spread"):
        sandwich_covariance(
            MEAN, curve, _rests(np.zeros((4, 3)), np.zeros(4, int)), by="experiment"
        )


def _line_calibration():
    # Bias x by a line over 0…60 °C, variance of 1e-8 for both coefficients, uncorrelated.
    curve = Curve(Polynomial(1, 0.0, 60.0), jnp.zeros((2, 1)))
    triad = TriadCalibration(curve, 1e-8 * jnp.eye(2), ("accel.bias[0]",), "invariant")
    return Calibration(gravity=9.81, accel=triad, temperature_range=(0.0, 60.0))


@pytest.mark.parametrize("temperature, outside", [(30.0, False), (60.0, False), (90.0, True)])
def test_output_uncertainty_by_hand_and_extrapolation_is_flagged(temperature, outside):
    x = (temperature - 30.0) / 30.0
    found = eqx.filter_jit(output_uncertainty)(
        _line_calibration(), jnp.array([9.8, 0.0, 0.0]), jnp.zeros(3), jnp.asarray(temperature)
    )
    np.testing.assert_allclose(found.force, [1e-4 * np.sqrt(1.0 + x**2), 0.0, 0.0], rtol=1e-12)
    np.testing.assert_array_equal(found.rate, np.zeros(3))
    assert bool(found.extrapolated) is outside


def test_curve_covariance_at_one_temperature_by_hand():
    triad = _line_calibration().accel
    at = curve_covariance_at(triad.curve, triad.covariance, 60.0)
    assert float(at[0, 0]) == pytest.approx(2e-8)
    np.testing.assert_allclose(np.sqrt(np.diagonal(at)), triad.standard_deviations(60.0))


def test_what_is_unseen_is_told_alike_in_every_basis_of_the_same_space():
    # Unknowns 0 and 3 trade against each other, 1 and 2 are not seen at all.
    space = np.zeros((6, 3))
    space[[0, 3], 0], space[1, 1], space[2, 2] = np.array([0.8, 0.6]), 1.0, 1.0
    expected = np.zeros((6, 3))
    expected[[0, 3], 0], expected[1, 1], expected[2, 2] = np.array([1.0, 0.75]), 1.0, 1.0
    for seed in range(20):
        turn = np.linalg.qr(np.random.default_rng(seed).standard_normal((3, 3)))[0]
        assert np.allclose(_plain(space @ turn), expected, atol=1e-12)
