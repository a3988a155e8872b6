"""Degenerate motions of Yang et al. (2023) are reported, each with the coefficients that it hides and no others.

A model of constant coefficients flies motions that are given by what the case feels, so that a specific force or a
rate along one of its axes can be held constant while all else varies.

**Reference:** Yang, Geneva, Zuo and Huang, IEEE Trans. Robotics 39 (2023), 3479-3498, the table of primitive
degenerate motions of IMU intrinsics.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import inertiax.navigation as navigation
from inertiax.calibration.calibration import Calibration, TriadCalibration
from inertiax.navigation.filter import Correction
from inertiax.navigation.segment import Transition
from inertiax.physics.temperature import Constant, Curve, Polynomial


SAMPLES, STEP, SEGMENTS = 20, 0.05, 60
FRAME = navigation.LevelFrame(0.85, 300.0)
NOISE = navigation.ImuNoise(navigation.TriadNoise(white=1e-4), navigation.TriadNoise(white=1e-5))
LOWER = tuple((i, j) for i in range(3) for j in range(i + 1))
FULL = tuple((i, j) for i in range(3) for j in range(3))
ACCEL = tuple(f"accel.bias[{i}]" for i in range(3)) + tuple(
    f"accel.matrix[{i},{j}]" for i, j in LOWER
)
GYRO = tuple(f"gyro.bias[{i}]" for i in range(3)) + tuple(
    f"gyro.{kind}[{i},{j}]" for kind in ("matrix", "g_sensitivity") for i, j in FULL
)
# Biases as little known as columns by their share of the outputs, so that neither hides in the other.
SIGMA = {"accel.bias": 5e-2, "accel.matrix": 1e-2, "gyro.bias": 1e-2, "gyro.matrix": 1e-2}
SIGMA["gyro.g_sensitivity"] = 1e-2
TIME = (np.arange(SAMPLES * SEGMENTS) + 0.5) * STEP


def _filter(basis):
    def triad(names):
        sigma = np.tile([SIGMA[n.split("[")[0]] for n in names], basis.size)
        curve = Curve(basis, jnp.zeros((basis.size, len(names))))
        return TriadCalibration(curve, jnp.diag(jnp.asarray(sigma) ** 2), names, "reference")

    made = Calibration(9.81, triad(ACCEL), triad(GYRO), temperature_range=(0.0, 50.0))
    return navigation.Filter(made, "*", noise=NOISE, frame=FRAME, samples=SAMPLES)


def _felt():
    """Specific force (m/s²) and rate (rad/s) of which all components vary, at frequencies of their own."""
    waves = lambda *hertz: np.stack([np.sin(2 * np.pi * f * TIME + f) for f in hertz], axis=1)
    force = np.array([1.0, -2.0, 9.8]) + 3.0 * waves(0.23, 0.31, 0.41) + waves(0.53, 0.61, 0.67)
    return force, 0.2 + 0.8 * waves(0.19, 0.29, 0.37) + 0.3 * waves(0.43, 0.47, 0.59)


@jax.jit
def _run(filter_, start, data, fixes, valid):
    return filter_.run(start, data, [navigation.Position(fixes, 0.01, valid)])


def _seen(filter_, force, rate, temperature):
    """What a run shows whose fixes are where the outputs themselves lead, so that no estimate moves."""
    data = navigation.ImuData(force, rate, temperature, np.asarray(STEP))
    start = filter_.start(
        np.eye(3), np.zeros(3), np.zeros(3),
        attitude_sigma=1e-2, velocity_sigma=0.1, position_sigma=0.1,
    )  # fmt: skip
    blind = _run(filter_, start, data, jnp.zeros((SEGMENTS, 3)), jnp.zeros(SEGMENTS, bool))
    path = blind.estimate.navigation.position
    track = _run(filter_, start, data, path, jnp.ones(SEGMENTS, bool))
    return navigation.observability(filter_, track)


@pytest.fixture(scope="module")
def constants():
    return _filter(Constant())


def _matrix_parameters(found):
    """What is hidden, without the biases, which share a direction with every hidden column."""
    return {n for n in found.parameters if "bias" not in n}


def _column(kind, places, axis):
    return {f"{kind}[{i},{j}]" for i, j in places if j == axis}


@pytest.mark.slow
def test_a_motion_of_all_axes_shows_every_coefficient(constants):
    found = _seen(constants, *_felt(), np.full(len(TIME), 20.0))
    assert found.unobservable == ()
    # Not by a hair: far above the threshold of 0.01.
    assert found.information[0] > 1.0


@pytest.mark.slow
@pytest.mark.parametrize("axis", range(3))
def test_a_constant_rate_hides_its_column_of_the_gyros_matrix(constants, axis):
    force, rate = _felt()
    rate[:, axis] = 0.5
    found = _seen(constants, force, rate, np.full(len(TIME), 20.0))
    assert _matrix_parameters(found) == _column("gyro.matrix", FULL, axis)
    assert {n for n in found.parameters if "bias" in n} == {f"gyro.bias[{i}]" for i in range(3)}
    # Three rows of the column, each proportional to its bias.
    assert int(np.sum(found.information < 0.01)) == 3
    assert f"gyro.matrix[0,{axis}]" in found.statement()


@pytest.mark.slow
@pytest.mark.parametrize("axis", range(3))
def test_a_constant_force_hides_its_column_of_matrix_and_g_sensitivity(constants, axis):
    force, rate = _felt()
    force[:, axis] = 5.0
    found = _seen(constants, force, rate, np.full(len(TIME), 20.0))
    want = _column("accel.matrix", LOWER, axis) | _column("gyro.g_sensitivity", FULL, axis)
    assert _matrix_parameters(found) == want
    assert int(np.sum(found.information < 0.01)) == len(want)


@pytest.mark.slow
def test_standing_still_hides_all_but_what_bias_and_gravity_fix(constants):
    force, rate = np.tile([0.0, 0.0, 9.8], (len(TIME), 1)), np.zeros((len(TIME), 3))
    found = _seen(constants, force, rate, np.full(len(TIME), 20.0))
    want = {n for n in (*ACCEL, *GYRO) if "matrix[" in n and n.startswith("gyro")}
    assert want <= set(found.parameters)


@pytest.mark.slow
def test_a_constant_temperature_hides_slopes_and_a_changing_one_shows_them():
    filter_ = _filter(Polynomial(1, 0.0, 50.0))
    cold = _seen(filter_, *_felt(), np.full(len(TIME), 10.0))
    # One combination of the two coefficients of each parameter.
    assert int(np.sum(cold.information < 0.01)) == len((*ACCEL, *GYRO))
    assert set(cold.parameters) == {*ACCEL, *GYRO}
    ramp = _seen(filter_, *_felt(), 50.0 * TIME / TIME[-1])
    assert ramp.unobservable == ()


def _felt_beside_a_velocity(slopes):
    """A track in which each measurement is v + s c of a velocity v and one coefficient c, of variance one; 32 bits."""
    triad = TriadCalibration(Curve(Constant(), np.zeros((1, 1))), np.eye(1), ACCEL[:1], "static")
    filter_ = navigation.Filter(Calibration(9.81, triad), "*", noise=NOISE, frame=FRAME)
    start = filter_.start(
        np.eye(3), np.zeros(3), np.zeros(3), attitude_sigma=1.0, velocity_sigma=1.0, position_sigma=1.0
    )  # fmt: skip
    zero, steady = jnp.zeros, jnp.eye(9)

    def one(slope):
        row = zero((1, 10)).at[0, 3].set(1.0).at[0, 9].set(slope)
        applied = Correction(
            zero((10, 1)), row, zero(1), zero((1, 1)), steady, jnp.ones(1), zero(()), jnp.array(True)
        )  # fmt: skip
        moved = Transition(steady, zero((9, 1)), zero(0), zero((9, 9)))
        return zero(()), start.estimate, zero((10, 10)), moved, (applied,)

    time, *others = jax.vmap(one)(slopes.astype(np.float32))
    return filter_, navigation.Track(start, time, *others, jnp.zeros(()), start)


@pytest.mark.slow
def test_in_32_bits_a_run_shows_what_it_shows_in_64():
    # Beside v of prior variance 1 the information is Σs² − (Σs)²/(n + 1), of which 32 bits leave one digit.
    slopes = np.tile([1000.0, 1001.0], 5000)
    want = np.sum(slopes**2) - np.sum(slopes) ** 2 / (len(slopes) + 1)
    with jax.enable_x64(False):
        found = navigation.observability(*_felt_beside_a_velocity(slopes))
    assert found.information[0] == pytest.approx(want, rel=1e-6)


def test_states_that_are_known_exactly_are_not_shown_by_a_run():
    names = tuple(f"accel.bias[{i}] of φ0" for i in range(3))
    turned = np.array([[0.6, 0.8, 0.0], [-0.8, 0.6, 0.0]])  # the third has no prior variance
    made = lambda share, hidden: navigation.Observability(
        names, np.array([5.0, 9.0]), turned, share, np.ones(3), hidden
    )
    said = made(np.zeros(3), ()).statement()
    assert (
        said
        == "The run's motion shows all 2 calibration states (1 without prior variance left out)."
    )
    said = made(np.array([0.5, 0.0, 0.0]), names[:1]).statement()
    assert "combinations of 1 of 2 calibration states unobservable (1 without" in said
