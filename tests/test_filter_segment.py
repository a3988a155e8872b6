"""The filter's gravity, noise and transitions, against closed forms and derivatives of the nonlinear step."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from inertiax.calibration.calibration import Calibration, TriadCalibration
from inertiax.navigation.calibration_states import calibration_states, place_of, selects
from inertiax.navigation.filter_state import (
    Estimate,
    navigation_error,
    reset_jacobian,
    retract,
)
from inertiax.navigation.level_frame import LevelFrame
from inertiax.navigation.process import drift, ImuNoise, slow_noise, TriadNoise
from inertiax.navigation.se23 import ExtendedPose
from inertiax.navigation.segment import advance, Samples
from inertiax.physics import rotation
from inertiax.physics.temperature import Curve, Polynomial


LATITUDE = 0.85
ACCEL = tuple(f"accel.bias[{i}]" for i in range(3)) + tuple(
    f"accel.matrix[{i},{j}]" for i in range(3) for j in range(i + 1)
)
GYRO = (
    *(f"gyro.bias[{i}]" for i in range(3)),
    *(f"gyro.matrix[{i},{j}]" for i in range(3) for j in range(3)),
    *(f"gyro.g_sensitivity[{i},{j}]" for i in range(3) for j in range(3)),
)
NOISE = ImuNoise(
    TriadNoise(white=6e-4, flicker=2e-4, walk=2e-6), TriadNoise(white=4e-5, flicker=7e-6, walk=5e-8)
)
FRAME = LevelFrame(LATITUDE, 300.0)


def _triad(names, sizes, basis, rng):
    one = np.array([sizes[n.split(".")[1].split("[")[0]] for n in names])
    sigma = np.concatenate([one * 0.7**a for a in range(basis.size)])
    mix = rng.normal(size=(len(sigma),) * 2)
    spread = np.eye(len(sigma)) + 0.1 * mix @ mix.T / len(sigma)
    unit = np.sqrt(np.diagonal(spread))
    covariance = spread * np.outer(sigma / unit, sigma / unit)
    curve = Curve(basis, jnp.asarray(rng.normal(size=(basis.size, len(names))) * one))
    return TriadCalibration(curve, jnp.asarray(covariance), names, "reference")


@pytest.fixture(scope="module")
def calibration():
    rng, basis = np.random.default_rng(3), Polynomial(1, 0.0, 50.0)
    return Calibration(
        gravity=9.81,
        accel=_triad(ACCEL, {"bias": 1e-2, "matrix": 1e-3}, basis, rng),
        gyro=_triad(
            GYRO,
            {"bias": 1e-3, "matrix": 1e-3, "g_sensitivity": 1e-4},
            Polynomial(2, 0.0, 50.0),
            rng,
        ),
        temperature_range=(0.0, 50.0),
    )


# Gravity and noise --------------------------------------------------------------------------------


def _ellipsoidal_gravity(position):
    """Down the plumb line of the point's own geodetic latitude, in NumPy: WGS 84, Somigliana."""
    a, f = 6378137.0, 1 / 298.257223563
    e2 = f * (2 - f)
    s, c = np.sin(LATITUDE), np.cos(LATITUDE)
    axes = np.array([[0, -s, c], [1, 0, 0], [0, c, s]])
    n = a / np.sqrt(1 - e2 * s**2)
    x, y, z = np.array([(n + 300) * c, 0, (n * (1 - e2) + 300) * s]) + axes @ position
    across, latitude = np.hypot(x, y), LATITUDE
    for _ in range(8):
        n = a / np.sqrt(1 - e2 * np.sin(latitude) ** 2)
        latitude = np.arctan2(z + e2 * n * np.sin(latitude), across)
    h = (across / np.cos(latitude) - n) / a
    sin2 = np.sin(latitude) ** 2
    k = (1 - f) * 9.8321849378 / 9.7803253359 - 1
    size = 9.7803253359 * (1 + k * sin2) / np.sqrt(1 - e2 * sin2)
    size *= 1 - 2 * h * (1 + f + 0.00344978650684 - 2 * f * sin2) + 3 * h**2
    up = np.array([x / across * np.cos(latitude), y / across * np.cos(latitude), np.sin(latitude)])
    return -size * axes.T @ up


@pytest.mark.parametrize("position", [(0, 0, 0), (3e3, -4e3, 2e3), (-4e4, 3e4, 8e3)])
def test_gravity_follows_the_plumb_line_over_the_ellipsoid(position):
    position = np.array(position, float)
    found = np.asarray(FRAME.gravity_at(position))
    # The page of the frame promises 1e-5 g at 50 km.
    np.testing.assert_allclose(found, _ellipsoidal_gravity(position), atol=1e-4)
    if np.linalg.norm(position) < 6e3:
        np.testing.assert_allclose(found, _ellipsoidal_gravity(position), atol=3e-6)


def test_surveyed_gravity_holds_at_the_origin():
    frame = LevelFrame(LATITUDE, 300.0, 9.8123)
    np.testing.assert_allclose(frame.gravity_at(np.zeros(3)), [0, 0, -9.8123], atol=1e-12)


def test_latitude_in_degrees_is_refused():
    with pytest.raises(ValueError, match="is in rad"):
        LevelFrame(48.0)
    with pytest.raises(ValueError, match="gravity"):
        LevelFrame(0.8, gravity=1.0)


def test_gauss_markov_sum_has_the_allan_deviation_of_flicker():
    flicker, times = 1e-4, np.array(NOISE.flicker_times)
    noise = ImuNoise(TriadNoise(0.0, flicker), TriadNoise(0.0), NOISE.flicker_times)
    slow = slow_noise(noise, jnp.asarray(1.0))
    unit = np.asarray(drift(np.eye(18)[0]))[0]
    variance = float(slow.start[0]) * unit**2
    tau = np.geomspace(20.0, 1000.0, 20)[:, None]
    # IEEE Std 952, Markov noise: σ²(τ) = 2 s² (τc/τ) (1 − τc/2τ (3 − 4 exp(−τ/τc) + exp(−2τ/τc))).
    r = tau / times
    allan = 2 * variance / r * (1 - (3 - 4 * np.exp(-r) + np.exp(-2 * r)) / (2 * r))
    deviation = np.sqrt(allan.sum(axis=1))
    expected = np.sqrt(2 * np.log(2) / np.pi) * flicker
    # A decade a process leaves a ripple; at twice the shortest time the sum begins to be whole.
    np.testing.assert_allclose(deviation, expected, rtol=0.12)


def test_drift_states_stay_stationary_and_walk_by_the_square_root_of_time():
    slow = slow_noise(NOISE, jnp.asarray(1.0))
    walk, flicker = np.arange(6), np.arange(6, 24)
    np.testing.assert_allclose(slow.decay[walk], 1.0)
    after = slow.decay**2 * slow.start + slow.variance
    np.testing.assert_allclose(after[flicker], slow.start[flicker], rtol=1e-12)
    np.testing.assert_allclose(slow.decay[6:12], np.exp(-0.1), rtol=1e-12)
    unit = np.asarray(drift(np.eye(24)[4]))[4]
    assert float(slow.variance[4]) * unit**2 == pytest.approx(5e-8**2, rel=1e-12)


def test_terms_left_out_have_no_states():
    assert ImuNoise(TriadNoise(0.1), TriadNoise(0.1)).count == 0
    assert ImuNoise(TriadNoise(0.1, turn_on=1e-3), TriadNoise(0.1)).count == 6
    assert NOISE.count == 24
    with pytest.raises(ValueError, match="one ratio"):
        ImuNoise(TriadNoise(0.1), TriadNoise(0.1), (10.0, 20.0, 100.0))


# States of the calibration ------------------------------------------------------------------------


def test_patterns_choose_parameters():
    assert selects("*.bias", "gyro.bias[1]") and not selects("*.bias", "gyro.matrix[0,0]")
    assert selects("accel.scale", "accel.matrix[1,1]")
    assert not selects("accel.scale", "accel.matrix[1,0]")
    assert selects("*.misalignment", "gyro.matrix[0,1]")
    assert selects("gyro.matrix[0,1]", "gyro.matrix[0,1]")
    assert place_of("gyro.g_sensitivity[2,1]") == (2, 5)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("patterns", "thermal", "count"),
    [("*", True, 9 * 2 + 21 * 3), ("*.bias", True, 3 * 2 + 3 * 3), ("*.bias", False, 6),
     (["*.bias", "*.scale"], False, 12), ((), True, 0)],
)  # fmt: skip
def test_number_of_states(calibration, patterns, thermal, count):
    assert len(calibration_states(calibration, patterns, thermal=thermal).names) == count


def test_unknown_pattern_and_effects_are_refused(calibration):
    with pytest.raises(ValueError, match=r"chooses none.*accel\.bias.*gyro\.misalignment"):
        calibration_states(calibration, "gyro.biass")


@pytest.mark.slow
def test_moved_curves_are_the_calibrations_with_the_coefficients_added(calibration):
    states = calibration_states(calibration, "*.bias")
    values = np.linspace(-1.0, 1.0, len(states.names))
    accel, gyro = states.moved(values)
    si = values * np.sqrt(np.diagonal(states.correlation)) * np.asarray(states.scale)
    # Accelerometers first, by function of temperature, then by parameter.
    expected = np.asarray(calibration.accel.curve.coefficients)[:, :3] + si[:6].reshape(2, 3)
    np.testing.assert_allclose(accel[:, :, 0], expected, rtol=1e-12)
    expected = np.asarray(calibration.gyro.curve.coefficients)[:, :3] + si[6:].reshape(3, 3)
    np.testing.assert_allclose(gyro[:, :, 0], expected, rtol=1e-12)
    np.testing.assert_allclose(gyro[:, 1, 2], calibration.gyro.curve.coefficients[:, 7])


def test_constants_of_a_reduced_filter_do_not_depend_on_temperature(calibration):
    states = calibration_states(calibration, "gyro.bias", thermal=False)
    before, after = states.moved(np.zeros(3))[1], states.moved(np.ones(3))[1]
    for t in (3.0, 44.0):
        basis = states.gyro.basis(jnp.asarray(t))
        moved = np.asarray(jnp.tensordot(basis, after - before, 1))[:, 0]
        np.testing.assert_allclose(moved, states.scale, rtol=1e-9)


def test_coefficients_without_variance_are_no_special_case(calibration):
    exact = eqx.tree_at(
        lambda c: c.gyro.covariance, calibration, jnp.zeros_like(calibration.gyro.covariance)
    )
    states = calibration_states(exact, "gyro.bias")
    assert np.all(np.isfinite(states.correlation)) and np.all(np.asarray(states.scale) == 0.0)


# One segment --------------------------------------------------------------------------------------


SAMPLES, STEP = 20, 0.01


@pytest.fixture(scope="module")
def segment(calibration):
    """A hard manoeuvre (2 g, 2 rad/s) of 0.2 s over 2 °C, and the step of the filter for it."""
    rng = np.random.default_rng(8)
    t = np.arange(SAMPLES + 1)[:, None] * STEP
    accel = np.array([3.0, -8.0, 12.0]) + 4.0 * np.sin(5.0 * t + np.array([0.0, 1.0, 2.0]))
    gyro = np.array([1.0, -2.0, 0.7]) + np.cos(4.0 * t + np.array([2.0, 0.0, 1.0]))
    samples = Samples(
        jnp.asarray(accel), jnp.asarray(gyro), jnp.asarray(20.0 + 10.0 * t[:, 0]), jnp.asarray(STEP)
    )
    states = calibration_states(calibration, "*")
    slow = slow_noise(NOISE, jnp.asarray(STEP * SAMPLES))
    pose = ExtendedPose(
        rotation.exp(jnp.array([0.4, -0.7, 1.9])),
        jnp.array([30.0, -10.0, 3.0]),
        jnp.array([900.0, 400.0, 50.0]),
    )
    estimate = Estimate(
        pose,
        jnp.asarray(rng.normal(size=24)),
        jnp.asarray(0.3 * rng.normal(size=len(states.names))),
    )

    @jax.jit
    def step(estimate, samples):
        return advance(estimate, samples, states, slow, FRAME, jnp.asarray(9.81))

    return estimate, samples, step


@pytest.mark.slow
def test_transition_is_the_derivative_of_the_nonlinear_step(segment):
    estimate, samples, step = segment
    after, transition = step(estimate, samples)

    @jax.jit
    @jax.jacfwd
    def derivative(error):
        moved, _ = step(retract(estimate, error), samples)
        return navigation_error(moved.navigation, after.navigation)

    size = 9 + 24 + estimate.calibration.shape[0]
    exact = np.asarray(derivative(jnp.zeros(size)))
    found = np.concatenate([transition.navigation, transition.others], axis=1)
    # Left out: change of the parameters within the segment in a response (2 °C of 50, times 1e-3), coning of a
    # response (2 rad/s × 0.01 s / 12, at the ends). Gravity's gradient leaves out the ellipsoid's shape (5e-3 of it).
    # Accelerometers turn the attitude by way of D alone, whose change over 2 °C is a hundredth of it.
    tolerance = np.full((9, found.shape[1]), 2e-3)
    tolerance[:, 6:9] = 1e-2
    tolerance[:3, 9:] = np.where(np.abs(exact[:3, 9:]).max(axis=0) < 1e-5, 2e-2, 2e-3)
    for rows in (slice(0, 3), slice(3, 6), slice(6, 9)):
        scale = np.abs(exact[rows]).max(axis=0)
        off = np.abs(found[rows] - exact[rows]).max(axis=0)
        assert np.all(off <= tolerance[rows][0] * scale)
    scale = np.abs(exact[3:6, :3]).max()
    np.testing.assert_allclose(found[3:6, :3], exact[3:6, :3], atol=1e-5 * scale)
    np.testing.assert_allclose(found[:9, 3:9], exact[:9, 3:9], atol=1e-8)


@pytest.mark.slow
def test_white_noise_is_the_samples_variance_through_the_step(segment):
    estimate, samples, step = segment
    after, transition = step(estimate, samples)

    @jax.jit
    @jax.jacfwd
    def derivative(outputs):
        pair = (s.at[1:].add(outputs[k]) for k, s in enumerate((samples.accel, samples.gyro)))
        moved, _ = step(estimate, Samples(*pair, samples.temperature, samples.step))
        return navigation_error(moved.navigation, after.navigation)

    slopes = np.asarray(derivative(jnp.zeros((2, SAMPLES, 3))))
    densities = np.array([6e-4, 4e-5])[None, :, None, None]
    scaled = (slopes * densities / np.sqrt(STEP)).reshape(9, -1)
    expected = scaled @ scaled.T
    unit = np.sqrt(np.diagonal(expected))
    found = np.asarray(transition.noise)
    # Coning and sculling terms, 2 rad/s × 0.01 s / 12 of a sample's response, are left out of the noise.
    np.testing.assert_allclose(
        found / np.outer(unit, unit), expected / np.outer(unit, unit), atol=0.02
    )


@pytest.mark.slow
def test_means_agree_with_forty_times_finer_steps(calibration):
    """Averages over 0.01 s of a smooth motion, integrated by 20 samples, against an ODE solver's fine steps."""
    states = calibration_states(
        eqx.tree_at(
            lambda c: [c.accel.curve.coefficients, c.gyro.curve.coefficients],
            calibration, replace_fn=jnp.zeros_like,
        ),
        (),
    )  # fmt: skip
    force = lambda t: np.array([2 * np.sin(3 * t), 1 + t, 9.0 + np.cos(5 * t)])
    rate = lambda t: np.array([np.cos(4 * t), 0.8 * np.sin(6 * t), 0.5 + t])
    fine = 40
    nodes = (np.arange(-fine, SAMPLES * fine) + 0.5) * STEP / fine
    read = lambda f: np.array([f(t) for t in nodes]).reshape(SAMPLES + 1, fine, 3).mean(axis=1)
    samples = Samples(
        jnp.asarray(read(force)), jnp.asarray(read(rate)), jnp.zeros(SAMPLES + 1), jnp.asarray(STEP)
    )
    start = ExtendedPose(jnp.eye(3), jnp.array([20.0, 5.0, 0.0]), jnp.array([100.0, 0.0, 10.0]))
    quiet = ImuNoise(TriadNoise(0.0), TriadNoise(0.0))
    slow = slow_noise(quiet, jnp.asarray(0.2))
    estimate = Estimate(start, jnp.zeros(0), jnp.zeros(0))
    after, _ = jax.jit(lambda e, s: advance(e, s, states, slow, FRAME, jnp.asarray(9.81)))(
        estimate, samples
    )
    turn, velocity, position = _runge_kutta(force, rate, start)
    # Third-order terms of Magnus' series, of which two samples know nothing: |ω|²|ω'| h⁴/96 = 4e-9 rad a sample and
    # as much of the force, 20 times; a force of 10 m/s² through such an attitude for 0.2 s.
    assert np.abs(np.asarray(rotation.log(after.navigation.attitude @ turn.T))).max() < 1e-7
    np.testing.assert_allclose(after.navigation.velocity, velocity, atol=3e-6)
    # Positions by the trapezium: f' h³/12 of 20 m/s³ a sample, 20 times.
    np.testing.assert_allclose(after.navigation.position, position, atol=4e-5)


def _runge_kutta(force, rate, start, count=2000):
    """The equations of motion in the Earth-fixed frame by Runge and Kutta's fourth order, in NumPy."""
    earth = 7.292115e-5 * np.array([0.0, np.cos(LATITUDE), np.sin(LATITUDE)])
    cross = lambda v: np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])

    def slope(t, x):
        c, v, p = x[:9].reshape(3, 3), x[9:12], x[12:]
        c_rate = c @ cross(rate(t)) - cross(earth) @ c
        v_rate = c @ force(t) + _ellipsoidal_gravity(p) - 2 * np.cross(earth, v)
        return np.concatenate([c_rate.reshape(-1), v_rate, v])

    h = STEP * SAMPLES / count
    x = np.concatenate([np.asarray(a).reshape(-1) for a in jax.tree.leaves(start)])
    for k in range(count):
        t = k * h
        a = slope(t, x)
        b = slope(t + h / 2, x + h / 2 * a)
        c = slope(t + h / 2, x + h / 2 * b)
        x = x + h / 6 * (a + 2 * b + 2 * c + slope(t + h, x + h * c))
    return x[:9].reshape(3, 3), x[9:12], x[12:]


@pytest.mark.slow
def test_reset_jacobian_is_the_derivative_of_the_error_from_the_moved_estimate():
    pose = ExtendedPose(rotation.exp(jnp.array([0.3, 0.2, -1.0])), jnp.ones(3), jnp.arange(3.0))
    estimate = Estimate(pose, jnp.zeros(0), jnp.zeros(0))
    move = jnp.array([0.02, -0.05, 0.3, 1.0, -2.0, 0.5, 3.0, 1.0, -4.0])
    moved = retract(estimate, move)
    derivative = jax.jacfwd(
        lambda e: navigation_error(retract(estimate, e).navigation, moved.navigation)
    )(move)
    np.testing.assert_allclose(reset_jacobian(move), derivative, atol=1e-12)
