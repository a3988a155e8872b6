"""Gyros on a rate table over −40…+70 °C: covariance against Monte Carlo, the paper's procedure, the rig."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from inertiax.estimators import ReferenceGyro, ReferenceGyroRig
from inertiax.physics.earth import EARTH_RATE, earth_rate, rest_readings
from inertiax.physics.error_model import (
    compensate_gyro,
    compensate_gyro_as_printed,
    distort_accel,
    distort_gyro,
)
from inertiax.physics.temperature import Constant
from inertiax.procedure.single_device import iterate_one, joint_fit_one
from inertiax.procedure.thermal_iterations import iterate, joint_fit, PaperIteration
from inertiax.simulate.bench import simulate_dwells
from inertiax.simulate.motion import turns_about_three_axes
from inertiax.simulate.plan import PAPER_GRAVITY, paper_set
from inertiax.simulate.triad import Device, draw_accelerometers, draw_gyros, GYRO_PARAMETERS


TEMPERATURES = tuple(float(t) for t in np.linspace(-40.0, 70.0, 12))
DEGREE = 2


def _plan(*, change: float = 4.0, drift: str = "centred"):
    turns = turns_about_three_axes(float(np.deg2rad(30.0)))
    return paper_set(2, temperatures=TEMPERATURES, change=change, drift=drift, turns=turns)


def _device():
    return Device(gyro=draw_gyros(jax.random.PRNGKey(0), degree=DEGREE))


# The stated covariance --------------------------------------------------------------------------------


@pytest.mark.slow
def test_every_parameter_errs_as_its_covariance_says():
    # Bias, Θ and D, quadratic over the range: 63 coefficients, 200 runs.
    runs = 200
    device, plan = _device(), _plan()
    truth = device.gyro.curve.series
    estimator = ReferenceGyro(gravity=PAPER_GRAVITY, g_sensitivity=True)
    dwells_of = eqx.filter_jit(lambda key: simulate_dwells(key, plan, device)[0])
    errors = []
    for key in jax.random.split(jax.random.PRNGKey(1), runs):
        solution = joint_fit_one(estimator, truth.basis, jax.tree.map(np.asarray, dwells_of(key)))
        assert bool(solution.succeeded)
        error = np.asarray(solution.curve.coefficients - truth.coefficients).ravel()
        errors.append(error / np.sqrt(np.diagonal(solution.covariance)))
    variance, mean = np.mean(np.square(errors), axis=0), np.mean(errors, axis=0)
    low, high = chi2.ppf([1e-5, 1 - 1e-5], runs) / runs
    assert len(variance) == 63
    assert low < min(variance) and max(variance) < high, (min(variance), max(variance))
    assert abs(np.mean(variance) - 1.0) < 0.05
    assert np.max(np.abs(mean)) * np.sqrt(runs) < 4.5


# The paper's procedure ----------------------------------------------------------------------------------


@pytest.mark.slow
def test_the_papers_procedure_converges_with_gyros_as_with_accelerometers():
    device, plan = _device(), _plan()
    dwells = simulate_dwells(jax.random.PRNGKey(1), plan, device)[0]
    basis = device.gyro.curve.series.basis
    estimator = ReferenceGyro(gravity=PAPER_GRAVITY, g_sensitivity=True)
    paper = PaperIteration.plan(estimator, basis, dwells)
    solution = iterate(paper, dwells)
    joint = joint_fit_one(estimator, basis, dwells)
    assert bool(solution.succeeded) and bool(joint.succeeded)
    sigma = np.sqrt(np.diagonal(joint.covariance)).reshape(basis.size, -1)
    history = np.asarray(solution.history)
    after = np.max(np.abs(history - np.asarray(solution.curve.coefficients)) / sigma, axis=(1, 2))
    # The first pass is the traditional calibration and leaves the 4 °C of drift in, tens of sigmas; two
    # passes reach the noise (as with accelerometers), and a third is at the fixed point.
    assert after[1] > 20.0 and after[2] < 3.0 and after[3] < 1e-2
    # It weighs experiments, the joint fit dwells: they agree within the noise.
    difference = np.abs(solution.curve.coefficients - joint.curve.coefficients) / sigma
    assert np.max(difference) < 1.0
    assert after[3] < 0.1 * after[2]  # the spectral radius, by the last step that is above rounding
    # The default is the joint fit.
    default = iterate_one(estimator, basis, dwells)
    assert bool(default.succeeded)
    assert np.max(np.abs(default.curve.coefficients - joint.curve.coefficients) / sigma) < 0.05


@pytest.mark.slow
def test_driven_from_the_host_the_passes_are_the_same():
    device, plan = _device(), _plan()
    dwells = simulate_dwells(jax.random.PRNGKey(2), plan, device)[0]
    basis = device.gyro.curve.series.basis
    estimator = ReferenceGyro(gravity=PAPER_GRAVITY, g_sensitivity=True)
    ours, compiled = joint_fit_one(estimator, basis, dwells), joint_fit(estimator, basis, dwells)
    sigma = np.sqrt(np.diagonal(compiled.covariance)).reshape(basis.size, -1)
    difference = np.abs(ours.curve.coefficients - compiled.curve.coefficients) / sigma
    assert np.max(difference) < 1e-6
    np.testing.assert_allclose(np.diagonal(ours.covariance), sigma.ravel() ** 2, rtol=1e-6)
    np.testing.assert_allclose(ours.residuals, compiled.residuals, atol=1e-6)


# Exact and printed compensation of D ----------------------------------------------------------------------


@pytest.mark.slow
def test_the_printed_compensation_errs_by_d_times_the_accelerometers_errors():
    device = Device(
        accel=draw_accelerometers(jax.random.PRNGKey(3), grade="consumer"),
        gyro=draw_gyros(jax.random.PRNGKey(4), grade="consumer"),
    )
    assert device.accel is not None and device.gyro is not None
    accel, gyro = device.accel.errors(60.0), device.gyro.errors(60.0)
    rng = np.random.default_rng(0)
    left: list[float] = []
    compiled = [
        jax.jit(f)
        for f in (distort_accel, distort_gyro, compensate_gyro, compensate_gyro_as_printed)
    ]
    distort, distort_rate, compensate, compensate_as_printed = compiled
    for _ in range(20):
        force, rate = (
            PAPER_GRAVITY * Rotation.random(random_state=rng).apply([0, 0, 1]),
            rng.normal(size=3),
        )
        raw = distort(accel, force)
        output = distort_rate(gyro, rate, force, PAPER_GRAVITY)
        exact = compensate(gyro, output, force, PAPER_GRAVITY)
        printed = compensate_as_printed(gyro, output, raw, PAPER_GRAVITY)
        np.testing.assert_allclose(exact, rate, atol=1e-14)
        d, theta = np.asarray(gyro.g_sensitivity), np.eye(3) + np.asarray(gyro.matrix)
        expected = -np.linalg.solve(theta, d @ (np.asarray(raw) - force) / PAPER_GRAVITY)
        np.testing.assert_allclose(np.asarray(printed) - rate, expected, atol=1e-14)
        left.append(float(np.linalg.norm(expected)))
    # A consumer sensor: 0.1 °/s/g times 0.1 to 3 % of g, some degrees an hour.
    assert 1.0 < np.rad2deg(max(left)) * 3600.0 < 100.0


# Earth rate and the rig -----------------------------------------------------------------------------------


@pytest.mark.slow
def test_earth_rate_in_the_reference_is_that_of_site_and_attitude():
    latitude = float(np.deg2rad(55.57))
    level = np.asarray(earth_rate(latitude))
    np.testing.assert_allclose(
        level, EARTH_RATE * np.array([0, np.cos(latitude), np.sin(latitude)])
    )
    turned = Rotation.from_euler("z", 90, degrees=True).as_matrix()  # case x to the north
    _, rate = rest_readings(jnp.asarray(turned), 9.8, latitude)
    np.testing.assert_allclose(rate, [level[1], 0.0, level[2]], atol=1e-19)
    # And the simulated plan has it in its rests' reference, whatever the attitude.
    dwells = simulate_dwells(None, _plan(), _device())[0]
    resting = np.asarray(dwells.position) >= 0
    rates = np.linalg.norm(np.asarray(dwells.reference_gyro)[resting], axis=1)
    np.testing.assert_allclose(rates, EARTH_RATE, rtol=1e-12)


MOUNTING = np.array([8e-4, -5e-4, 1.1e-3])  # rad
RATE_ERROR = 4e-5


@jax.jit
def _distorted(errors, rate, force):
    return jax.vmap(lambda w, a: distort_gyro(errors, w, a, PAPER_GRAVITY))(rate, force)


def _on_a_faulty_rig(seed: int):
    """Dwells at one temperature whose references leave out mounting and rate error, and the truth."""
    device = Device(
        accel=draw_accelerometers(jax.random.PRNGKey(7), degree=0),
        gyro=draw_gyros(jax.random.PRNGKey(8), degree=0),
    )
    turns = turns_about_three_axes(float(np.deg2rad(30.0)))
    plan = paper_set(3, temperatures=(20.0, 20.0), change=0.0, turns=turns)
    dwells, _ = simulate_dwells(None, plan, device)
    assert device.gyro is not None
    errors = device.gyro.errors(20.0)
    turn = Rotation.from_rotvec(MOUNTING)
    planned_force, planned_rate = (
        np.asarray(dwells.reference_accel),
        np.asarray(dwells.reference_gyro),
    )
    rng = np.random.default_rng(seed)
    sigma_a = np.sqrt(np.asarray(dwells.accel_covariance)[:, 0, 0])[:, None]
    sigma_g = np.sqrt(np.asarray(dwells.gyro_covariance)[:, 0, 0])[:, None]
    force = turn.apply(planned_force.copy())
    rate = (1.0 + RATE_ERROR) * turn.apply(planned_rate.copy())
    output = np.asarray(_distorted(errors, rate, force))
    dwells = eqx.tree_at(
        lambda d: (d.accel, d.gyro),
        dwells,
        (
            force + sigma_a * rng.normal(size=force.shape),
            output + sigma_g * rng.normal(size=force.shape),
        ),
    )
    return dwells, errors


@pytest.mark.slow
def test_mounting_and_rate_error_as_nuisance_parameters_set_theta_right():
    dwells, truth = _on_a_faulty_rig(0)
    n = dwells.num_dwells
    rigid = ReferenceGyro(gravity=PAPER_GRAVITY, g_sensitivity=True)
    rig = ReferenceGyroRig(
        gravity=PAPER_GRAVITY, rate_uncertainty=5e-5, num_dwells=n, g_sensitivity=True
    )
    true = np.asarray(rigid.pack(truth))
    assert rig.names[:21] == rigid.names and len(true) == len(GYRO_PARAMETERS)
    off = {}
    for name, estimator in (("rigid", rigid), ("rig", rig)):
        solution = joint_fit_one(estimator, Constant(), dwells)
        assert bool(solution.succeeded)
        found = np.asarray(solution.curve.coefficients[0])
        off[name] = found[:21] - true, np.sqrt(np.diagonal(solution.covariance))
    # Left out, the mounting stands in Θ's skew part, rad for rad.
    skew = off["rigid"][0][3:12].reshape(3, 3)
    np.testing.assert_allclose([skew[2, 1], skew[0, 2], skew[1, 0]], MOUNTING, atol=2e-5)
    error, sigma = off["rig"]
    assert np.all(np.abs(error) < 4.0 * sigma[:21])
    # The scale factors are as uncertain as the table's rate, and no further off.
    diagonal = sigma[[3, 7, 11]]
    assert np.all((4.9e-5 < diagonal) & (diagonal < 6e-5))
    # The mounting is told by gravity on 42 dwells, each far better than a second of arc.
    assert np.all(np.abs(found[-3:] - MOUNTING) < 4.0 * sigma[-3:]) and np.all(sigma[-3:] < 1e-6)


@pytest.mark.slow
def test_the_rig_estimator_refuses_to_iterate():
    dwells, _ = _on_a_faulty_rig(1)
    rig = ReferenceGyroRig(
        gravity=PAPER_GRAVITY, rate_uncertainty=5e-5, num_dwells=dwells.num_dwells
    )
    with pytest.raises(ValueError, match="for `joint_fit`"):
        iterate_one(rig, Constant(), dwells)
