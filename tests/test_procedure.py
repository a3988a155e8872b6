"""The procedures over temperature: convergence, divergence, agreement, derivatives."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from inertiax.estimators import Invariant, ReferenceGyro
from inertiax.physics.temperature import CubicSpline, Curve, Polynomial
from inertiax.procedure import thermal_iterations
from inertiax.procedure.convergence import convergence_rate, pass_jacobian, rate_warning
from inertiax.procedure.experiment_sets import ExperimentPass
from inertiax.procedure.single_device import iterate_one, joint_fit_one
from inertiax.procedure.thermal_iterations import (
    dwell_residuals,
    GaussNewtonIteration,
    PaperIteration,
)
from inertiax.reduction.dwells import experiment_rows
from inertiax.simulate.bench import simulate_dwells
from inertiax.simulate.motion import turns_about_three_axes
from inertiax.simulate.plan import PAPER_GRAVITY, paper_set
from inertiax.simulate.triad import Device, draw_accelerometers, draw_gyros


iterate = eqx.filter_jit(thermal_iterations.iterate)
joint_fit = eqx.filter_jit(thermal_iterations.joint_fit)

ESTIMATOR = Invariant(gravity=PAPER_GRAVITY)
# One range for all plans of this file, so that every test uses the same compiled programs.
BASIS = Polynomial(6, -70.0, 75.0)


@pytest.fixture(scope="module")
def device():
    return Device(accel=draw_accelerometers(jax.random.PRNGKey(0)))


def _dwells(device, number, drift, *, seed=1):
    key = None if seed is None else jax.random.PRNGKey(seed)
    return simulate_dwells(key, paper_set(number, drift=drift), device)[0]


def _passes(procedure, dwells, start=None):
    """The paper's iteration from the closed-form start or another: one program for both."""
    if start is None:
        start = thermal_iterations.start_curve(procedure.estimator, procedure.basis, dwells)
    return iterate(procedure, dwells, start=start)


def _greatest_error(coefficients, device):
    """Greatest error of the curves in m/s² and relative, where every plan has data."""
    grid = jnp.linspace(-50.0, 55.0, 106)
    fitted = jax.vmap(Curve(BASIS, coefficients))(grid)
    truth = jax.vmap(device.accel.curve)(grid)
    error = np.abs(np.asarray(fitted - truth))
    return float(error[:, :3].max()), float(error[:, 3:].max())


@pytest.mark.slow
@pytest.mark.parametrize("number", [1, 2, 3])
@pytest.mark.parametrize("drift", ["centred", "alternating", "settling"])
def test_default_is_as_good_as_the_joint_fit_on_every_plan(drift, number, device):
    dwells = _dwells(device, number, drift)
    default = iterate(GaussNewtonIteration(ESTIMATOR, BASIS), dwells)
    joint = joint_fit(ESTIMATOR, BASIS, dwells)
    assert bool(default.succeeded) and bool(joint.succeeded)
    sigma = np.sqrt(np.diagonal(joint.covariance)).reshape(7, 9)
    difference = np.abs(default.curve.coefficients - joint.curve.coefficients) / sigma
    # They weigh the same misfits in frames that differ by Γ, 1e-3 to 1e-2.
    assert np.max(difference) < 0.05
    # The same passes from the host, which stop at steps of 1e-6 sigma as well.
    host = iterate_one(ESTIMATOR, BASIS, dwells)
    assert bool(host.succeeded)
    apart = (host.curve.coefficients - default.curve.coefficients) / sigma
    assert np.max(np.abs(apart)) < 1e-5
    np.testing.assert_allclose(host.covariance, default.covariance, rtol=1e-5)


@pytest.mark.slow
def test_without_noise_the_paper_iteration_finds_the_truth(device):
    dwells = _dwells(device, 2, "centred", seed=None)
    solution = _passes(PaperIteration.plan(ESTIMATOR, BASIS, dwells), dwells)
    assert bool(solution.succeeded)
    bias, matrix = _greatest_error(solution.curve.coefficients, device)
    assert bias < 1e-9 and matrix < 1e-9
    # And the traditional calibration, its first pass, does not: 4 °C at 80 ppm/°C.
    bias, matrix = _greatest_error(solution.history[1], device)
    assert bias > 5e-5 and matrix > 2e-5


@pytest.mark.slow
def test_two_iterations_reach_the_noise_floor_at_4_degrees(device):
    dwells = _dwells(device, 2, "centred")
    solution = _passes(PaperIteration.plan(ESTIMATOR, BASIS, dwells), dwells)
    after_two, converged = solution.history[3], solution.curve.coefficients
    sigma = np.sqrt(np.diagonal(solution.covariance)).reshape(7, 9)
    assert np.max(np.abs(after_two - converged) / sigma) < 1.0


@pytest.mark.slow
@pytest.mark.parametrize("number, rate_range", [(2, (0.3, 0.6)), (1, (1.5, 3.0))])
def test_predicted_rate_is_the_observed_rate(number, rate_range, device):
    # Noise free, so that the fixed point is the truth: start a little off it and watch the steps
    # shrink (4 °C) or grow (15 °C). The dominant eigenvalues may be a pair, so average over many.
    dwells = _dwells(device, number, "alternating", seed=None)
    procedure = PaperIteration.plan(ESTIMATOR, BASIS, dwells)
    truth = joint_fit(ESTIMATOR, BASIS, dwells).curve.coefficients
    rate = convergence_rate(procedure, truth, dwells)
    assert rate_range[0] < rate.radius < rate_range[1]
    off = truth + 1e-6 * jnp.asarray(np.random.default_rng(0).normal(size=truth.shape))
    solution = _passes(procedure, dwells, start=off)
    steps = np.asarray(solution.step_sizes)[5:]
    steps = steps[(steps > 1e-5) & (steps < 1e3)]
    assert len(steps) >= 5
    observed = (steps[-1] / steps[0]) ** (1.0 / (len(steps) - 1))
    assert abs(rate.radius / observed - 1.0) < 0.1


@pytest.mark.slow
def test_divergent_plan_is_predicted_and_named(device):
    dwells = _dwells(device, 1, "alternating")
    procedure = PaperIteration.plan(ESTIMATOR, BASIS, dwells)
    solution = _passes(procedure, dwells)
    assert not bool(solution.succeeded)
    answer = joint_fit(ESTIMATOR, BASIS, dwells).curve.coefficients
    rate = convergence_rate(procedure, answer, dwells)
    assert rate.radius > 1.5
    # The pass' derivative on the host: automatic differentiation of the compiled pass gives the same.
    on_host = ExperimentPass(ESTIMATOR, BASIS, dwells).jacobian(answer)
    exact = np.asarray(pass_jacobian(procedure, answer, dwells))
    assert on_host is not None
    assert np.max(np.abs(on_host - exact)) < 1e-5 * np.max(np.abs(exact))
    warning = rate_warning(procedure, rate, dwells)
    assert warning is not None
    assert "diverges on this plan (spectral radius" in warning
    assert "°C inside an experiment" in warning and "looks like accel." in warning
    default = GaussNewtonIteration(ESTIMATOR, BASIS)
    rate = convergence_rate(default, iterate(default, dwells).curve.coefficients, dwells)
    assert rate.radius < 0.01
    assert rate_warning(default, rate, dwells) is None


@pytest.mark.slow
def test_spline_temperature_model_recovers_the_truth(device):
    dwells = _dwells(device, 2, "centred", seed=None)
    basis = CubicSpline(tuple(np.linspace(-57.0, 62.0, 9)))
    solution = iterate_one(ESTIMATOR, basis, dwells)
    assert bool(solution.succeeded)
    # A fixed point of the compiled pass as well.
    found = jnp.asarray(solution.curve.coefficients)
    again = eqx.filter_jit(GaussNewtonIteration(ESTIMATOR, basis).refine)(found, dwells)
    np.testing.assert_allclose(again, found, rtol=0.0, atol=1e-9)
    grid = jnp.linspace(-50.0, 55.0, 106)
    error = jax.vmap(solution.curve)(grid) - jax.vmap(device.accel.curve)(grid)
    # A natural spline with 15 °C between knots cannot be exact; 1e-5 m/s² and 1 ppm is its error here.
    assert np.max(np.abs(error)) < 1e-4


@pytest.mark.slow
def test_gyros_go_through_the_same_procedure():
    device = Device(gyro=draw_gyros(jax.random.PRNGKey(3)))
    plan = paper_set(1, turns=turns_about_three_axes(float(np.deg2rad(30.0))))
    dwells, _ = simulate_dwells(None, plan, device)
    estimator = ReferenceGyro(gravity=PAPER_GRAVITY, g_sensitivity=True)
    basis = Polynomial(6, -70.0, 75.0)
    solution = iterate(GaussNewtonIteration(estimator, basis), dwells)
    assert bool(solution.succeeded)
    grid = jnp.linspace(-50.0, 55.0, 22)
    fitted, truth = jax.vmap(solution.curve)(grid), jax.vmap(device.gyro.curve)(grid)
    np.testing.assert_allclose(fitted, truth, atol=1e-11)


@pytest.mark.slow
def test_padding_changes_nothing(device):
    dwells = _dwells(device, 1, "centred")
    # As many rows as without, so that no other program is needed; the host fits the fewer.
    own = dwells.num_dwells - 7
    padded = dwells[np.concatenate([np.arange(own), np.zeros(7, int)])]
    valid = np.arange(dwells.num_dwells) < own
    padded = eqx.tree_at(lambda d: d.valid, padded, jnp.asarray(valid))
    with_padding = joint_fit(ESTIMATOR, BASIS, padded)
    plain = joint_fit_one(ESTIMATOR, BASIS, dwells[:own])
    np.testing.assert_allclose(
        with_padding.curve.coefficients, plain.curve.coefficients, rtol=1e-9, atol=1e-13
    )
    np.testing.assert_allclose(with_padding.covariance, plain.covariance, rtol=1e-6)
    assert not np.any(np.asarray(with_padding.residuals)[~valid])


@pytest.mark.slow
def test_experiments_are_grouped_and_padded(device):
    dwells = _dwells(device, 2, "centred")[:40]  # 18 + 18 + 4
    rows, kept = experiment_rows(dwells)
    assert rows.shape == (3, 18)
    assert kept.sum(axis=1).tolist() == [18, 18, 4]
    assert set(rows[2]) == {36, 37, 38, 39}


def test_too_few_experiments_for_the_degree(device):
    dwells = _dwells(device, 2, "centred")[: 18 * 5]
    message = "5 experiments cannot determine curves with 7 coefficients; lower the temperature degree to 4"
    with pytest.raises(ValueError, match=message):
        PaperIteration.plan(ESTIMATOR, BASIS, dwells)


@pytest.mark.slow
def test_whitened_residuals_have_unit_variance(device):
    dwells = _dwells(device, 1, "centred")
    solution = joint_fit(ESTIMATOR, BASIS, dwells)
    residuals = dwell_residuals(ESTIMATOR, solution.curve, dwells)
    dof = dwells.num_dwells - 63
    # χ² with 171 degrees of freedom: standard deviation √(2/171) = 0.11 of its mean.
    assert abs(float(jnp.sum(residuals**2)) / dof - 1.0) < 0.35


def _answer(estimator, dwells):
    return thermal_iterations.iterate(
        GaussNewtonIteration(estimator, Polynomial(2, -70.0, 75.0)), dwells, tolerance=1e-9
    ).curve.coefficients


def _perturbed(dwells, steps):
    """Estimator and dwells with all measurements, all temperatures and g moved along fixed directions."""
    direction = jnp.asarray(np.random.default_rng(0).normal(size=dwells.num_dwells))
    accel = dwells.accel + steps[0] * direction[:, None] * jnp.array([[1.0, -2.0, 0.5]])
    temperature = dwells.temperature + steps[1] * direction
    dwells = eqx.tree_at(lambda d: (d.accel, d.temperature), dwells, (accel, temperature))
    return eqx.tree_at(lambda e: e.gravity, ESTIMATOR, ESTIMATOR.gravity + steps[2]), dwells


STEPS = {"accel": 1e-4, "temperature": 1e-2, "gravity": 1e-4}


# Those of the joint fit are compared in `test_sensitivity.py`; in reverse and under vmap in `test_solve.py`.
@pytest.mark.slow
def test_derivatives_of_the_answer_are_finite_differences():
    device = Device(accel=draw_accelerometers(jax.random.PRNGKey(0), degree=2))
    plan = paper_set(1, temperatures=(-55.0, -25.0, 5.0, 35.0, 60.0))
    dwells = simulate_dwells(jax.random.PRNGKey(1), plan, device)[0]
    answer = lambda steps: _answer(*_perturbed(dwells, steps))
    # One program for values and derivatives along any direction.
    run = lambda steps, tangent: jax.jvp(answer, (steps,), (tangent,))
    along = jax.jit(run)
    zero = jnp.zeros(3)
    for unit, (which, h) in zip(jnp.eye(3), STEPS.items(), strict=True):
        exact = along(zero, unit)[1]
        # Fourth-order central differences.
        f = [along(k * h * unit, unit)[0] for k in (-2.0, -1.0, 1.0, 2.0)]
        numeric = (f[0] - 8.0 * f[1] + 8.0 * f[2] - f[3]) / (12.0 * h)
        # Relative to the largest derivative of the same unit: biases, then matrix elements. A derivative
        # that should vanish (of a bias with respect to g) is judged by its effect on a 1 g reading.
        size = np.abs(exact) * np.array([1.0] * 3 + [PAPER_GRAVITY] * 6)
        error = np.abs(numeric - exact) * np.array([1.0] * 3 + [PAPER_GRAVITY] * 6)
        assert np.max(error) < 1e-6 * np.max(size), which
