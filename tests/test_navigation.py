"""The strapdown navigator against closed forms; its derivatives against finite differences."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from inertiax.calibration.calibration import Calibration, TriadCalibration
from inertiax.navigation.strapdown import (
    coefficients_of,
    error_sensitivity,
    errors,
    ideal_data,
    ImuData,
    navigate,
    radii,
    refine,
    State,
    transport_rate,
    with_coefficients,
)
from inertiax.physics import earth, rotation
from inertiax.physics.error_model import distort_accel, distort_gyro
from inertiax.physics.temperature import Curve, Polynomial


LATITUDE = float(np.deg2rad(55.0))
START = jnp.array([LATITUDE, 0.5, 200.0])
ACCEL_NAMES = tuple(f"accel.bias[{i}]" for i in range(3)) + tuple(
    f"accel.matrix[{i},{j}]" for i in range(3) for j in range(i + 1)
)
GYRO_NAMES = tuple(f"gyro.bias[{i}]" for i in range(3)) + tuple(
    f"gyro.matrix[{i},{j}]" for i in range(3) for j in range(3)
)


def _path(t):
    """A vehicle at up to 60 m/s that turns, pitches and rolls."""
    heading = 0.4 + 0.8 * jnp.sin(2e-2 * t)
    speed = 60.0 * jnp.sin(1e-2 * t) ** 2
    climb = 2.0 * jnp.sin(3e-2 * t)
    velocity = jnp.stack([speed * jnp.sin(heading), speed * jnp.cos(heading), climb])
    up, east, north = (
        jnp.array([0.0, 0.0, 1.0]),
        jnp.array([1.0, 0.0, 0.0]),
        jnp.array([0.0, 1.0, 0.0]),
    )
    attitude = rotation.about(up, -heading) @ rotation.about(east, 0.1 * jnp.sin(5e-2 * t))
    return velocity, attitude @ rotation.about(north, 0.3 * jnp.sin(4e-2 * t))


def _standing(t):
    return jnp.zeros(3) * t, rotation.exp(jnp.array([0.1, 0.2, 0.3]) + 0.0 * t)


def _at(states, row):
    return jax.tree.map(lambda x: x[row], states)


def _last(states):
    return _at(states, -1)


# Compiled once for all tests: 600 samples, whatever their step.
RUN = eqx.filter_jit(navigate)
IDEAL = eqx.filter_jit(ideal_data)


def _ideal(path, step):
    step = jnp.asarray(step)
    force, rate, start, truth = IDEAL(path, START, 600, step)
    data = ImuData(force, rate, jnp.linspace(20.0, 40.0, len(force)), step)
    return data, start, truth


def _keep(accel, gyro, temperature):
    del temperature
    return accel, gyro


def test_radii_are_those_of_wgs84():
    # Poles: a²/b; equator: a (1 − e²) and a.
    meridian, normal = radii(jnp.asarray(0.5 * np.pi))
    assert float(meridian) == pytest.approx(6399593.6258, abs=1e-3)
    assert float(normal) == pytest.approx(6399593.6258, abs=1e-3)
    meridian, normal = radii(jnp.asarray(0.0))
    assert float(meridian) == pytest.approx(6335439.3273, abs=1e-3)
    assert float(normal) == pytest.approx(6378137.0)


def test_transport_rate_going_east_by_hand():
    # 100 m/s east at 45°: Ω up = v tan φ / R_N.
    rate = transport_rate(jnp.array([100.0, 0.0, 0.0]), jnp.array([np.pi / 4, 0.0, 0.0]))
    normal = float(radii(jnp.asarray(np.pi / 4))[1])
    np.testing.assert_allclose(rate, [0.0, 100.0 / normal, 100.0 / normal], rtol=1e-12)


@pytest.mark.slow
def test_ideal_triads_at_rest_stay_where_they_are():
    data, start, truth = _ideal(_standing, 1.0)
    # What they read is gravity and Earth rate (an independent formula).
    force, rate = earth.rest_readings(start.attitude, earth.gravity(LATITUDE, 200.0), LATITUDE)
    np.testing.assert_allclose(data.accel[0], force, rtol=1e-12)
    np.testing.assert_allclose(data.gyro[0], rate, rtol=1e-9, atol=1e-18)
    off = errors(_last(RUN(_keep, data, start)), _last(truth))
    # 600 steps that each leave out (Ω h)³/6 = 6e-14 rad of the level frame's turn: 4e-11 rad.
    assert np.max(np.abs(off[:3])) < 1e-4 and np.max(np.abs(off[6:])) < 5e-11


@pytest.mark.slow
def test_ideal_triads_follow_a_moving_vehicle():
    offs = []
    for step, row in ((0.2, 299), (0.1, 599)):  # both after a minute
        data, start, truth = _ideal(_path, step)
        offs.append(np.asarray(errors(_at(RUN(_keep, data, start), row), _at(truth, row))))
    # Second order: a quarter of the error at half the step, and centimetres over kilometres.
    assert np.linalg.norm(offs[1][:3]) < 0.05
    assert np.linalg.norm(offs[0][:3]) / np.linalg.norm(offs[1][:3]) == pytest.approx(4.0, rel=0.15)


@pytest.mark.slow
def test_accelerometer_bias_makes_a_schuler_oscillation():
    # Titterton and Weston, ch. 12: x(t) = b / ω_s² (1 − cos ω_s t), ω_s² = g / R, over a part of a period.
    data, start, truth = _ideal(_standing, 1.0)
    bias = 1e-4
    east = bias * jnp.asarray(start.attitude)[0][None, :]  # in the case frame
    biased = eqx.tree_at(lambda d: d.accel, data, data.accel + east)
    off = errors(_last(RUN(_keep, biased, start)), _last(truth))
    schuler = float(earth.gravity(LATITUDE, 200.0)) / (
        float(radii(jnp.asarray(LATITUDE))[1]) + 200.0
    )
    expected = bias / schuler * (1.0 - np.cos(np.sqrt(schuler) * 600.0))
    # The Earth's turning couples the channels, by about ω_ie t = 0.04 squared.
    assert float(off[0]) == pytest.approx(expected, rel=0.01)


# Calibration inside ------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def calibration():
    rng = np.random.default_rng(0)
    basis = Polynomial(1, 0.0, 60.0)
    sizes = lambda names: np.array([1.0 if "bias" in n else 0.1 for n in names])

    def triad(names, bias, estimator):
        coefficients = 1e-2 * bias * rng.normal(size=(2, len(names))) * sizes(names)
        return TriadCalibration(
            Curve(basis, jnp.asarray(coefficients)), jnp.eye(2 * len(names)), names, estimator
        )

    return Calibration(
        gravity=9.81,
        accel=triad(ACCEL_NAMES, 1.0, "invariant"),
        gyro=triad(GYRO_NAMES, 1.0, "reference"),
    )


def _measured(calibration, data):
    """Raw outputs of a device whose errors are exactly the calibration's."""

    def one(force, rate, temperature):
        accel = distort_accel(calibration.accel_errors(temperature), force)
        gyros = calibration.gyro_errors(temperature)
        return accel, distort_gyro(gyros, rate, force, calibration.gravity)

    accel, gyro = jax.vmap(one)(data.accel, data.gyro, data.temperature)
    return ImuData(accel, gyro, data.temperature, data.step)


@pytest.mark.slow
def test_calibration_inside_the_loop_restores_the_ideal_run(calibration):
    data, start, truth = _ideal(_path, 0.1)
    plain = RUN(_keep, data, start)
    inside = RUN(calibration, _measured(calibration, data), start)
    off = np.abs(errors(_last(inside), _last(plain)))
    assert off[:3].max() < 1e-6 and off[6:].max() < 1e-12
    without = RUN(_keep, _measured(calibration, data), start)
    assert np.abs(errors(_last(without), _last(plain)))[:3].max() > 1.0


@pytest.fixture(scope="module")
def moving(calibration):
    """Raw outputs of the moving vehicle, its start and true end, and ∂(errors at the end)/∂(coefficients)."""
    data, start, truth = _ideal(_path, 0.1)
    raw, end = _measured(calibration, data), _last(truth)
    exact = eqx.filter_jit(error_sensitivity)(calibration, raw, start, end)
    return raw, start, end, np.asarray(exact)


@pytest.mark.slow
def test_sensitivities_match_finite_differences_to_1e_5(calibration, moving):
    raw, start, end, exact = moving
    values = coefficients_of(calibration)
    assert exact.shape == (9, 42) and np.all(np.isfinite(exact))
    compare = jax.jit(errors)

    def final(v):
        return np.asarray(compare(_last(RUN(with_coefficients(calibration, v), raw, start)), end))

    numeric = np.empty_like(exact)
    for k in range(len(values)):
        gyro_bias = k >= 18 and (k - 18) % 12 < 3
        h = 1e-5 if gyro_bias else 1e-4
        f = [final(values.at[k].add(m * h)) for m in (-2, -1, 1, 2)]
        numeric[:, k] = (f[0] - 8.0 * f[1] + 8.0 * f[2] - f[3]) / (12.0 * h)
    # Relative to the largest sensitivity of the same output to the same parameter's kind: position,
    # velocity and attitude errors, each as a vector.
    for rows in (slice(0, 3), slice(3, 6), slice(6, 9)):
        size = np.linalg.norm(exact[rows], axis=0)
        difference = np.linalg.norm(numeric[rows] - exact[rows], axis=0)
        seen = (
            size > 1e-9 * size.max()
        )  # accelerometers do not turn the attitude but by transport rate
        assert seen.sum() >= 24
        assert np.max(difference[seen] / size[seen]) < 1e-5


@pytest.mark.slow
def test_navigator_goes_through_vmap_and_reverse_mode(calibration, moving):
    raw, start, end, exact = moving

    def miss(values):
        states = navigate(with_coefficients(calibration, values), raw, start)
        return jnp.sum(errors(_last(states), end)[:3])

    values = coefficients_of(calibration)
    run = jax.jit(jax.vmap(jax.grad(miss)))
    many = run(jnp.stack([values, values]))
    np.testing.assert_allclose(many[0], exact[:3].sum(axis=0), rtol=1e-9, atol=1e-9)
    np.testing.assert_array_equal(many[0], many[1])


@pytest.mark.slow
def test_refinement_from_position_fixes_finds_a_changed_bias(calibration):
    data, start, truth = _ideal(_path, 0.2)
    raw = _measured(calibration, data)
    # Since calibration two things have moved: the second accelerometer's bias and the first gyro's.
    columns = np.zeros((42, 3))
    columns[1, 0] = 1e-3  # accel.bias[1], m/s²
    columns[18, 1] = 1e-5  # gyro.bias[0], rad/s
    columns[2, 2] = 1e-3  # accel.bias[2], which has not moved
    moved = np.array([1.5, -0.7, 0.0])
    old = with_coefficients(calibration, coefficients_of(calibration) - columns @ moved)
    every = np.arange(49, 600, 50)
    fixes = jax.tree.map(lambda x: x[every], truth)

    def residual(states):
        found = jax.tree.map(lambda x: x[every], states)
        return (jax.vmap(errors)(found, fixes)[:, :3] / 0.1).reshape(-1)

    def coefficients_and_solution(values):
        refined, solution = refine(with_coefficients(old, values), raw, start, residual, columns)
        return coefficients_of(refined), solution

    run = jax.jit(coefficients_and_solution)
    found, solution = run(coefficients_of(old))
    refined = with_coefficients(old, found)
    assert bool(solution.succeeded)
    sigma = np.sqrt(np.diagonal(solution.covariance))
    assert np.all(np.abs(solution.parameters - moved) < 3.0 * sigma)
    assert np.all(sigma < 0.5)
    # The run after refinement is better than before by far.
    before, after = (
        np.abs(errors(_last(RUN(c, raw, start)), _last(truth)))[:3].max() for c in (old, refined)
    )
    assert after < 0.1 * before


def test_starting_state_is_a_pytree_of_four_arrays():
    state = State(jnp.eye(3), jnp.zeros(3), START)
    assert len(jax.tree.leaves(state)) == 4
    np.testing.assert_array_equal(state.place, START)
